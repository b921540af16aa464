"""Bounds of shadow maps, against the texels that they bound."""

import numpy as np
import pytest

from tfm_cl.constants import SHADOW_FIRST_LEVEL
from tfm_cl.render.shadow_pyramid import bounds_res, bounds_size, shadow_bounds


def levels(res, numbers):
    """Entries [size, size, 2] of each level."""
    size, first = int(bounds_res(res)), 0
    while size >= 1:
        yield numbers[first : first + 2 * size**2].reshape(size, size, 2)
        first, size = first + 2 * size**2, size // 2
    assert first == len(numbers)


@pytest.mark.parametrize("res", [1, 2, 3, 4, 13, 16, 17, 48, 100, 128])
def test_entries_are_the_bounds_of_their_texels(rng, res):
    maps = rng.uniform(0.1, 9, (3, res, res)).astype(np.float32)
    maps[rng.random(maps.shape) < 0.1] = np.inf

    found = shadow_bounds(maps)

    assert found.shape == (3, bounds_size(res))
    for texels, numbers in zip(maps, found, strict=True):
        for k, level in enumerate(levels(res, numbers), SHADOW_FIRST_LEVEL):
            for y, x in np.ndindex(*level.shape[:2]):
                part = texels[y << k : (y + 4) << k, x << k : (x + 4) << k]
                expected = (part.min(), part.max()) if part.size else (np.inf, -np.inf)
                assert tuple(level[y, x]) == expected


@pytest.mark.parametrize("res", [1, 3, 5, 48, 1000, 1024, 8192])
def test_a_square_of_any_size_has_an_entry(res):
    finest = int(bounds_res(res))
    for width in range(res):
        k = SHADOW_FIRST_LEVEL
        while width > 3 << k:
            k += 1
        assert finest >> (k - SHADOW_FIRST_LEVEL) >= 1
        assert ((res - 1) >> k) < finest >> (k - SHADOW_FIRST_LEVEL)


def test_sizes_of_many_maps():
    sizes = np.array([1, 32, 48, 1024])

    assert (bounds_res(sizes) == [4, 8, 16, 256]).all()
    assert bounds_size(sizes).tolist() == [2 * (4 * n * n - 1) // 3 for n in (4, 8, 16, 256)]
