"""What is written does not depend on the rays a work-item."""

import pytest


@pytest.fixture(scope="session")
def renderer(one_lane_renderer):
    return one_lane_renderer
