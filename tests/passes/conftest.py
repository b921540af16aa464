"""The passes run with one lane and with the device's."""

import pytest


@pytest.fixture
def renderer(renderer_of_lanes):
    """Replaces the renderer of the other tests."""
    return renderer_of_lanes
