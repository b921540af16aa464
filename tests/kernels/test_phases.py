"""Phase functions on the device, by the macro that chooses among them."""

import numpy as np
import pytest
from kernel_calls import Calls
from scenes import make_scene
from scipy import integrate
from tolerances import FLOAT32

import tfm_cl as tfm
from tfm_cl.device.media import media_on_device
from tfm_cl.device.structs.medium import medium_structs
from tfm_cl.scene.phases import PHASES, HenyeyGreenstein, Isotropic, KajiyaKay

pytestmark = pytest.mark.lanes

EVERY_PHASE = [Isotropic(), *(HenyeyGreenstein(g) for g in (-0.99, -0.4, 0.0, 0.3, 0.8, 0.99)), KajiyaKay()]


def test_no_kind_is_forgotten():
    assert {type(phase) for phase in EVERY_PHASE} == set(PHASES.values())


@pytest.mark.parametrize(
    "phases", [[EVERY_PHASE[0]], EVERY_PHASE[1:], EVERY_PHASE], ids=["one", "a kind", "all"]
)
def test_phase_functions(launcher, phases):
    media = [tfm.Medium(phase=phase) for phase in phases]
    scene = make_scene(volume=[tfm.BoxVolume(density=1, medium=medium) for medium in media])
    on_device = media_on_device(launcher, scene, None)
    mu = np.concatenate([np.linspace(-1, 1, 999), [1.0]]).astype(np.float32)

    defines = {name: on_device.defines[name] for name in ("TFM_PHASE(medium, mu, fibres)", "TFM_TANGENTS")}
    calls = Calls(
        launcher, "phase_functions.cl", on_device.headers, defines, {"media": medium_structs(media)}
    )
    values = calls("call_phase", mu, len(media), of_media=len(media))

    for phase, found in zip(phases, values.T, strict=True):
        # The peak divides by (1 - |g|)³, and g is rounded once.
        worst = 10 * FLOAT32 / (1 - abs(getattr(phase, "g", 0.0)))
        assert np.allclose(found, phase.evaluate(mu), rtol=worst)


@pytest.mark.parametrize("phase", EVERY_PHASE, ids=str)
def test_phase_functions_integrate_to_1(phase):
    integral, _ = integrate.quad(lambda mu: float(phase.evaluate(mu)), -1, 1, epsabs=1e-9, limit=1000)

    assert 2 * np.pi * integral == pytest.approx(1, abs=1e-6)
