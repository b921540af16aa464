"""What the commands say of files that hold more than one density, or other things."""

from pathlib import Path

import numpy as np
import pytest

SEVERAL = Path(__file__).resolve().parents[1] / "files" / "volume_io" / "data" / "several.vdb"


def test_a_shared_name_means_the_first_grid_and_a_warning_says_so(cli, tiny):
    for grid in ((), ("--grid", "density")):
        done = cli("render", SEVERAL, "-o", "a.npy", *tiny, *grid)
        assert done.code == 0, done.err
        assert "tfm: warning: " in done.err
        assert (
            "2 grids are named 'density'; this is 'density[0]', choose 'density[1]' with --grid" in done.err
        )
    done = cli("render", SEVERAL, "-o", "b.npy", *tiny, "--grid", "density[0]")
    assert (done.code, "warning" in done.err) == (0, False)
    np.testing.assert_array_equal(np.load("a.npy"), np.load("b.npy"))
    grids = {grid["name"]: grid["renders"] for grid in cli("info", SEVERAL, "--json").json["grids"]}
    assert list(grids) == ["density[0]", "density[1]", "shared", "mask", "velocity", ""]
    assert [renders == "yes" for renders in grids.values()] == [True, True, True, True, False, False]


@pytest.mark.slow
def test_vectors_colour_a_density(cli, tiny):
    refused = cli("render", SEVERAL, "-o", "a.npy", *tiny, "--grid", "velocity")
    assert refused.code == 2
    assert "--set volume.colour=NAME" in refused.err
    for name, colour in (("grey", ()), ("coloured", ("--set", "volume.colour=velocity"))):
        done = cli(
            "render",
            SEVERAL,
            "-o",
            f"{name}.npy",
            *tiny,
            "--grid",
            "density[0]",
            "--density-scale",
            "0.1",
            *colour,
        )
        assert done.code == 0, done.err
    # Red is what it was: its extinction is 1 times the density's; green and blue are 2 and 3 times.
    grey, coloured = np.load("grey.npy"), np.load("coloured.npy")
    np.testing.assert_allclose(coloured[..., 0], grey[..., 0], rtol=1e-3, atol=1e-5)
    assert (coloured[..., 2].max() > coloured[..., 1].max() > coloured[..., 0].max()).all()


def test_ct_data_render_through_a_window(cli, tiny):
    np.save("ct.npy", np.full((4, 4, 4), -300, np.int16))
    assert "volume.offset" in cli("render", "ct.npy", "-o", "a.npy", *tiny).err
    done = cli("render", "ct.npy", "-o", "a.npy", *tiny, "--set", "volume.window=-1000,400")
    assert done.code == 0, done.err
    assert np.load("a.npy").max() > 0
