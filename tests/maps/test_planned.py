"""What follows from a map's plan."""

import numpy as np
import pytest

from tfm_cl.maps.planned import Making, MapPlan
from tfm_cl.maps.resolved import resolve
from tfm_cl.scene.settings import MapSettings


def planned(res, field, range_="visible"):
    return MapPlan(
        settings=resolve(MapSettings(basis="klt", res=res, range=range_)),
        field=field,
        made=Making(lambda: None),
        number_unit=1.0,
        density_weighting=1.0,
        extinction=1.0,
        clip=None,
    )


def texels_with_a_range(res, field):
    """Which lie between entries of which any has a range, [y, x]; as ``kernels/core/texels.h``."""
    size = len(field)
    place = np.clip((np.arange(res) + 0.5) / res * size - 0.5, 0, size - 1)
    low = np.minimum(place.astype(int), size - 2)
    has = field[..., 1] > field[..., 0]
    rows = has[low] | (has[low + 1] & (place > low)[:, None])
    return rows[:, low] | (rows[:, low + 1] & (place > low))


@pytest.mark.parametrize(("res", "size"), [(64, 64), (100, 64), (256, 64), (1024, 256), (8, 2)])
def test_no_ray_has_a_range_outside_of_the_window(rng, res, size):
    for density in (0.0, 2 / size**2, 0.5):
        field = np.zeros((size, size, 4), np.float32)
        field[..., :2] = np.where(rng.random((size, size, 1)) < density, (1, 2), (3, 3))

        x0, y0, x1, y1 = planned(res, field).window

        y, x = np.nonzero(texels_with_a_range(res, field))
        if len(x) == 0:
            assert (x0, y0, x1, y1) == (0, 0, 0, 0)
            continue
        assert 0 <= x0 <= x.min() <= x.max() < x1 <= res
        assert 0 <= y0 <= y.min() <= y.max() < y1 <= res
        assert x1 - x0 <= np.ptp(x) + 3
        assert y1 - y0 <= np.ptp(y) + 3


def test_rays_between_the_bounds_are_anywhere():
    assert planned(64, np.zeros((1, 1, 4), np.float32), "box").window == (0, 0, 64, 64)
