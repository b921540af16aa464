"""The basis that learns."""

import numpy as np
import pytest
from tolerances import LEARNT

from tfm_cl.maps.bases.curves import CELLS, Curves
from tfm_cl.maps.bases.klt import KLT
from tfm_cl.maps.resolved import resolve
from tfm_cl.scene.settings import MapSettings


@pytest.mark.parametrize("fit", ["visibility", "l2"])
def test_what_is_learnt_has_no_scale(fit):
    """Also of densities near the end of float32, which are deeper than their squares fit."""
    rising = np.cumsum(np.random.default_rng(3).uniform(size=(40, CELLS + 1)), axis=1)
    rising -= rising[:, :1]
    choices = resolve(MapSettings(basis="klt", coeffs=3, fit=fit, res=8, steps=8))
    found = [KLT.functions(choices, Curves(rising * scale, 0.1 / scale)).modes for scale in (1.0, 1e38)]
    assert np.isfinite(found[1]).all()
    spans = [np.linalg.qr(modes.astype(np.float64))[0] for modes in found]
    assert np.abs(spans[0] @ spans[0].T - spans[1] @ spans[1].T).max() < LEARNT
