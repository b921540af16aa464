"""What is learnt of a light's rays before its map is built."""

import numpy as np

from tfm_cl.maps.probe import some_of

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
