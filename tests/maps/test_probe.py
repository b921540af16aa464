"""What is learnt of a light's rays before its map is built."""

import numpy as np
import pytest

from tfm_cl.maps.probe import Probe, some_of

MOST = 40


def chosen(rays):
    return set(zip(*(index.tolist() for index in some_of(rays, MOST)), strict=True))


def test_few_of_the_rays_that_are_learnt_from_change_with_a_medium(rng):
    rays = rng.random((16, 16)) < 0.5
    before = chosen(rays)
    assert len(before) == MOST
    assert all(rays[place] for place in before)
    y, x = np.argwhere(rays)[3]
    rays[y, x] = False
    rays[tuple(np.argwhere(~rays)[7])] = True
    assert len(before - chosen(rays)) <= 2


def test_all_of_few():
    rays = np.zeros((16, 16), bool)
    rays[3, 5] = rays[5, 3] = True
    assert chosen(rays) == {(3, 5), (5, 3)}
    assert chosen(np.zeros((4, 4), bool)) == set()


@pytest.mark.parametrize("density", [0.0, 0.005, 0.1, 1.0])
def test_ranges_hold_those_of_their_neighbours(rng, density):
    size = 24
    dense = rng.random((size, size)) < density
    dense[:9] = False
    begin = rng.uniform(1, 2, (size, size)).astype(np.float32)
    probe = Probe(begin, np.where(dense, begin + 1, begin), begin - 1, begin, begin + 3)

    field = probe.field

    nothing = min(begin[dense], default=0)
    for y, x in np.ndindex(size, size):
        near = None
        for away in (1, 2):  # the neighbours, or else theirs
            around = np.s_[max(y - away, 0) : y + away + 1, max(x - away, 0) : x + away + 1]
            if near is None and dense[around].any():
                near = begin[around][dense[around]]
        low, high = (nothing, nothing) if near is None else (near.min(), near.max() + np.float32(1))
        slope, last = (begin[y, x] - 1, begin[y, x] + 3) if dense[y, x] else (0, high)
        assert field[y, x].tolist() == [low, high, slope, last]
