"""Phase functions on the device, by the macro that chooses among them."""

import numpy as np
import pytest
from every_phase import EVERY_PHASE
from kernel_calls import Calls
from scenes import make_scene
from tolerances import DEVICE_FUNCTION, FLOAT32

import tfm_cl as tfm
from tfm_cl.constants import FORWARD_DISK
from tfm_cl.device.media import media_on_device
from tfm_cl.device.structs.medium import medium_structs
from tfm_cl.scene.phases import PHASES, FournierForand, HenyeyGreenstein, Isotropic

pytestmark = pytest.mark.lanes

OF_CELLS = 3e-4
"""A table on the device, linear over cells of 0.02° to 0.03°, relative to the function: `PhaseMixture`'s, of
which a disk's edge lies in some cell, is left out there."""
OF_PEAKS = 10 * FLOAT32
"""Times 1 / (1 - |g|): a lobe's peak divides by (1 - |g|)³, and g is rounded once."""
OF_POWERS = 60 * FLOAT32
"""δ^-nu with δ up to 10⁶, of which the exponent is rounded, and differences divided by 1 - δ twice."""


def worst_error(phase):
    """Relative error that rounding, or the cells of a table, leave."""
    if phase.kernel_table() is not None:
        return OF_CELLS
    if isinstance(phase, FournierForand):
        return OF_POWERS
    lobes = [getattr(phase, name, 0.0) for name in ("g", "g1", "g2")]
    lobes += [phase.fit().g_hg] if hasattr(phase, "fit") else []
    return max(DEVICE_FUNCTION, OF_PEAKS / (1 - max(map(abs, lobes))))


def test_no_kind_is_forgotten():
    assert {type(phase) for phase in EVERY_PHASE} == set(PHASES.values())


@pytest.mark.parametrize(
    "phases",
    [[Isotropic()], [HenyeyGreenstein(0.3), HenyeyGreenstein(-0.99)], EVERY_PHASE],
    ids=["one", "a kind", "all"],
)
def test_phase_functions(launcher, phases):
    media = [tfm.Medium(phase=phase) for phase in phases]
    of_each_kind = {medium.phase.type: medium for medium in media}.values()
    scene = make_scene(volume=[tfm.BoxVolume(density=1, medium=medium) for medium in of_each_kind])
    on_device = media_on_device(launcher, scene, None)
    peaks = 1 - np.geomspace(1e-7, 0.1, 300)
    mu = np.concatenate([np.linspace(-1, 1, 999), peaks, -peaks, [1.0]]).astype(np.float32)
    # Between two places on a device's table the disk has an edge.
    mu = mu[np.abs((1 - mu) / (2 * FORWARD_DISK) - 1) > 0.1]

    defines = {name: on_device.defines[name] for name in ("TFM_PHASE(medium, mu, fibres)", "TFM_TANGENTS")}
    calls = Calls(
        launcher, "phase_functions.cl", on_device.headers, defines, {"media": medium_structs(media)}
    )
    values = calls("call_phase", mu, len(media), of_media=len(media))

    for phase, found in zip(phases, values.T, strict=True):
        error = np.abs(found / phase.evaluate(mu) - 1)
        assert error.max() <= worst_error(phase), phase
