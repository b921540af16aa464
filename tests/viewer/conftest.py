"""Fixtures of the viewer's tests."""

import pytest
from viewing import Studio


@pytest.fixture
def studio(tmp_path):
    """A loop whose renderers need no device; closed at the end."""
    studio = Studio(tmp_path)
    yield studio
    studio.close()
