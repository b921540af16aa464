"""From lanes to memory and back, each lane to a place of its own."""

import numpy as np
import pytest
from kernel_calls import Calls

pytestmark = pytest.mark.lanes

COUNT = 1003
"""Not a multiple of any number of lanes."""
MISSING = -7.0
ROW, LARGEST_TILE = 4, 16
"""Lanes."""


@pytest.fixture
def stored(launcher, rng):
    """What went in, and what `call_store` made of it."""
    values = rng.integers(0, 1000, (COUNT, 4)).astype(np.float32)
    # Where all lanes of a tile are wanted, those of a row have places side by side.
    places, wanted = np.arange(COUNT), rng.random(COUNT) < 0.6
    in_rows = COUNT // ROW * ROW
    places[:in_rows] = rng.permutation(places[:in_rows].reshape(-1, ROW)).ravel()
    wanted[np.arange(COUNT) // LARGEST_TILE % 3 == 0] = True
    before = rng.integers(0, 100, (COUNT, 4)).astype(np.float32)
    flags = (rng.random(COUNT) < 0.5).astype(np.uint8) * rng.integers(1, 256, COUNT).astype(np.uint8)
    sizes = {"singles": (), "pairs": (2,), "fours": (4,), "added": (4,), "counts": (), "loaded": (5,)}
    upload = launcher.upload
    buffers = {
        name: upload(
            name, np.resize(before, (COUNT, *size)).astype(np.uint32 if name == "counts" else np.float32)
        )
        for name, size in sizes.items()
    }
    items = -(-COUNT // launcher.lanes)
    sums = launcher.zeros("sums", 4 * items)
    Calls(launcher, "store_functions.cl").run(
        "call_store",
        COUNT,
        values=values,
        places=places.astype(np.float32),
        wanted=wanted.astype(np.float32),
        **{"from": before},
        flags=flags,
        **buffers,
        sums=sums,
        missing=MISSING,
    )
    found = {
        name: launcher.download(buffers[name], (COUNT, *size), np.uint32 if name == "counts" else np.float32)
        for name, size in sizes.items()
    }
    found["sums"] = launcher.download(sums, (items,), np.uint32)
    return values, places, wanted, before, flags, found


@pytest.mark.parametrize(("name", "size"), [("singles", 1), ("pairs", 2), ("fours", 4)])
def test_wanted_lanes_write_and_no_others(stored, name, size):
    values, places, wanted, before, _, found = stored
    expected = np.resize(before, (COUNT, size))
    expected[places[wanted]] = values[wanted, :size]
    assert (found[name].reshape(COUNT, size) == expected).all()


def test_wanted_lanes_add_and_no_others(stored):
    values, places, wanted, before, _, found = stored
    fours, counts = before.copy(), np.resize(before, COUNT)
    fours[places[wanted]] += values[wanted]
    counts[places[wanted]] += values[wanted, 0]
    assert (found["added"] == fours).all()
    assert (found["counts"] == counts).all()


def test_wanted_lanes_read_and_others_have_what_is_missing(stored):
    _, places, wanted, before, flags, found = stored
    expected = np.where(wanted[:, None], before[places], MISSING)
    assert (found["loaded"][:, :4] == expected).all()
    assert (found["loaded"][:, 4] == (wanted & (flags[places] > 0))).all()


def test_the_sum_of_the_wanted_lanes(launcher, stored):
    values, _, wanted, _, _, found = stored
    counted = np.zeros(len(found["sums"]) * launcher.lanes)
    counted[:COUNT] = values[:, 0] * wanted
    assert (found["sums"] == counted.reshape(-1, launcher.lanes).sum(axis=1)).all()
