"""What `tfm render` warns of on stderr."""

import numpy as np
import pytest
from scenes import blobs


@pytest.fixture
def lump(folder):
    """A scene file that leaves the density scale to its default, which is far too dense."""
    np.save(folder / "cloud.npy", 100 * blobs())
    path = folder / "scene.toml"
    path.write_text('[volume]\nfile = "cloud.npy"')
    return path


def test_a_missing_density_scale_is_told_before_rendering(render, lump):
    said = [line for line in render(lump, "-o", "a.npy").err.splitlines() if "warning" in line]
    assert len(said) == 1
    assert said[0].startswith(f"tfm: warning: {lump}: volume.density_scale is not given: 1 is used; ")
    assert "warning" in render(lump, "--print-config").err


def test_a_missing_density_scale_is_not_told_with_q_nor_where_it_is_given(render, lump):
    assert render(lump, "-o", "a.npy", "-q").err == ""
    for given in ("auto", "1"):
        assert "warning" not in render(lump, "-o", "a.npy", "--density-scale", given).err
