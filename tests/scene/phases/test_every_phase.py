"""Phase functions in double precision: what they integrate to, and what is known of them in closed form."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from every_phase import EVERY_PHASE, ONE_OF_EACH_PHASE
from scipy import integrate
from tolerances import ROUNDED

import tfm_cl as tfm
from tfm_cl.constants import FORWARD_DISK
from tfm_cl.errors import SceneError
from tfm_cl.scene.phases import (
    PHASES,
    DoubleHenyeyGreenstein,
    Draine,
    FournierForand,
    HenyeyGreenstein,
    KajiyaKay,
    Mie,
    PhaseMixture,
    Rayleigh,
    TabulatedPhase,
    parse_phase,
)

QUADRATURE = 1e-8
"""Of an adaptive quadrature with its intervals chosen around peaks, nodes and the disk's edge."""
MU = np.linspace(-1, 1, 201)


def integral(phase, factor=lambda _mu: 1.0, start=0.0):
    """∫ p(μ) factor(μ) over the directions from an angle on."""
    disk = 2 * np.arcsin(np.sqrt(FORWARD_DISK))
    edges = [
        0,
        disk,
        0.01,
        0.1,
        0.5,
        1.5,
        3,
        np.pi,
        *np.arccos(np.clip(getattr(phase, "cosines", ()), -1, 1)),
    ]
    edges = np.unique([start, *(edge for edge in edges if edge > start)])

    def ring(angle):
        mu = np.cos(angle)
        return 2 * np.pi * np.sin(angle) * float(phase.evaluate(mu)) * factor(mu)

    return sum(integrate.quad(ring, low, high, epsabs=1e-10, limit=200)[0] for low, high in pairwise(edges))


@pytest.mark.parametrize("phase", EVERY_PHASE, ids=str)
def test_they_integrate_to_1(phase):
    assert integral(phase) == pytest.approx(1, abs=QUADRATURE)


def draine_mean(g, alpha):
    return g * (1 + alpha * (3 + 2 * g**2) / 5) / (1 + alpha * (1 + 2 * g**2) / 3)


def mie_mean(phase):
    fit = phase.fit()
    return (1 - fit.weight) * fit.g_hg + fit.weight * draine_mean(fit.g_draine, fit.alpha)


@pytest.mark.parametrize(
    ("phase", "mean"),
    [
        (DoubleHenyeyGreenstein(), 0.8 * 0.85 - 0.2 * 0.3),
        (Draine(g=-0.6, alpha=3.0), draine_mean(-0.6, 3.0)),
        *((Mie(diameter=d), mie_mean(Mie(diameter=d))) for d in (5.0, 50.0)),
        (TabulatedPhase(values=(0, 1)), 1 / 3),
        (PhaseMixture(phases=("hg:0.5", "hg:-0.9"), weights=(3, 1)), 0.15),
    ],
    ids=str,
)
def test_mean_cosines(phase, mean):
    assert integral(phase, lambda mu: mu) == pytest.approx(mean, abs=QUADRATURE)
    assert phase.mean_cosine == pytest.approx(mean, abs=1e-5)  # of ANGLES angles


@pytest.mark.parametrize("ior", [1.02, 1.33, 1 + np.sqrt(2 / 3), 2.0])
@pytest.mark.parametrize("backscatter", [1e-3, 0.1, 0.4])
def test_what_goes_backwards(ior, backscatter):
    """With ior 1 + √(2/3) the equation of nu is 0/0."""
    phase = FournierForand(ior=ior, backscatter=backscatter)
    assert integral(phase, start=np.pi / 2) == pytest.approx(backscatter, abs=QUADRATURE)
    assert (phase.evaluate(MU) > 0).all()


def test_the_series_goes_on_where_the_closed_form_ends():
    phase = FournierForand()
    s = (1 + np.array([-1.001, -0.999, 0.999, 1.001]) * 1e-3) / phase.numbers.delta_back
    outer, inner, other_inner, other_outer = np.log(phase.evaluate(1 - 2 * s))
    slope = (other_outer - outer) / (s[3] - s[0])
    assert inner - outer == pytest.approx(slope * (s[1] - s[0]), rel=1e-2)
    assert other_outer - other_inner == pytest.approx(slope * (s[3] - s[2]), rel=1e-2)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (Draine(g=0.6, alpha=0.0), HenyeyGreenstein(0.6)),
        (Draine(g=0.0, alpha=1.0), Rayleigh()),
        (DoubleHenyeyGreenstein(g1=0.7, weight=1.0), HenyeyGreenstein(0.7)),
        (TabulatedPhase(cosines=(1, 0.2, -1), values=(3.0, 3.0, 3.0)), parse_phase("isotropic")),
        (PhaseMixture(phases=("hg:0.85", "hg:-0.3"), weights=(8, 2)), DoubleHenyeyGreenstein()),
        (PhaseMixture(phases=("mie",), weights=(7,)), Mie()),
    ],
    ids=str,
)
def test_special_cases(one, other):
    assert np.allclose(one.evaluate(MU), other.evaluate(MU), rtol=ROUNDED)


@pytest.mark.parametrize(
    "phase",
    [
        PhaseMixture(phases=("hg:0.9999",), weights=(1,)),
        lambda: TabulatedPhase(cosines=(-1, 0.5, 0.50001, 0.50002, 1), values=(0, 0, 1, 0, 0)),
    ],
    ids=["lobe", "spike"],
)
def test_peaks_that_the_device_would_miss_are_refused(phase):
    with pytest.raises(SceneError, match="has peaks narrower than tables on the device"):
        (phase() if callable(phase) else phase).read_files()


def test_half_backwards_is_rayleigh_off_the_disk():
    found = FournierForand(ior=1.4, backscatter=0.5).evaluate(MU[:-1])
    assert np.allclose(found, Rayleigh().evaluate(MU[:-1]), rtol=1e-10)


def test_droplets_of_20_micrometres():
    """As published implementations of the fit have them."""
    assert Mie().fit() == pytest.approx((0.99461, 0.59379, 27.1137, 0.49816), rel=1e-4)


@pytest.mark.parametrize("phase", ONE_OF_EACH_PHASE, ids=lambda phase: phase.type)
def test_tables_make_the_same_again(phase):
    again = parse_phase(phase.to_dict())
    for _ in range(2):
        assert again == phase  # whatever they have worked out so far
        assert np.array_equal(again.evaluate(MU), phase.evaluate(MU))
        assert (again.kernel_table() is None) == (phase.kernel_table() is None)
    assert hash(tfm.Medium(phase=phase)) == hash(tfm.Medium(phase=phase.to_dict()))


@pytest.mark.parametrize("name", PHASES)
def test_every_parameter_has_a_default_on_the_command_line(name):
    kind = PHASES[name]
    assert kind.usage().partition(":")[0] == name
    if name not in {"table", "mix"}:
        assert parse_phase(name) == kind()


@pytest.mark.parametrize("name", PHASES)
def test_the_help_and_the_guide_know_it(name):
    assert PHASES[name].usage() in str(tfm.Medium.model_fields["phase"].description)
    guide = (Path(__file__).parents[3] / "docs/guide/media.md").read_text(encoding="utf-8")
    assert f"| `{PHASES[name].usage()}` |" in guide or f'`type = "{name}"`' in guide


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("double-hg:0.9:-0.2:0.7", DoubleHenyeyGreenstein(g1=0.9, g2=-0.2, weight=0.7)),
        ("double-hg::-0.2", DoubleHenyeyGreenstein(g2=-0.2)),
        ("draine:0.3", Draine(g=0.3)),
        ("mie:8", Mie(diameter=8.0)),
        ("fournier-forand:1.1:0.02", FournierForand(ior=1.1, backscatter=0.02)),
        ("kajiya-kay::20", KajiyaKay(exponent=20.0)),
        ("table:a:b.txt", TabulatedPhase(file="a:b.txt")),
    ],
)
def test_texts(text, expected):
    assert parse_phase(text) == expected


NO_MIXTURE = {"type": "mix", "phases": ["mie"]}


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ("isotropic:1", "takes no parameter; got 'isotropic:1'"),
        ("rayleigh:1", "takes no parameter; got 'rayleigh:1'"),
        ("draine:0.5:1:2", "takes g and alpha, as in draine:0.5:1; got 'draine:0.5:1:2'"),
        ("mie:fog", "takes the droplets' diameter in micrometres, as in mie:20; got 'mie:fog'"),
        ("mie:4.9", "medium.phase.diameter = 4.9: should be greater than or equal to 5"),
        ("fournier-forand:1.33:0.6", "medium.phase.backscatter = 0.6: should be less than or equal to 0.5"),
        ("table", "takes a file with a cosine and a value in every line, as in table:measured.txt"),
        ("mix:1", 'is a table, as { type = "mix", phases = '),
        ({"type": "table"}, "medium.phase: a table has either a file or values (and cosines)"),
        ({"type": "table", "file": "a", "values": [1, 2]}, "a table has either a file or values"),
        ({"type": "table", "values": [1]}, "should hold 2 to 65,536 cosines and as many values; got 1 and 1"),
        ({"type": "table", "values": [1, -2]}, "values should be finite and ≥ 0; at cosine 1 is -2"),
        ({**NO_MIXTURE, "weights": [1], "phases": [NO_MIXTURE]}, "a mixture cannot be part of another"),
        ({**NO_MIXTURE, "weights": 1}, "medium.phase.weights = 1: should be a list"),
        ({**NO_MIXTURE, "weights": [1, 2]}, "needs as many weights as phases; got 1 and 2"),
        ({**NO_MIXTURE, "weights": [0]}, "medium.phase.weights = [0.0]: should be ≥ 0, and not all 0"),
        ({**NO_MIXTURE, "weights": [1e308] * 2, "phases": ["mie"] * 2}, "should be ≥ 0, and not all 0"),
        ({**NO_MIXTURE, "weights": [1], "phases": ["kajiya-kay"]}, "kajiya-kay': depends on how strands lie"),
        ({**NO_MIXTURE, "weights": [1], "phases": ["mie:1"]}, "medium.phase.diameter = 1.0: should be"),
        ({**NO_MIXTURE, "weights": [], "phases": []}, "medium.phase.phases = ()"),
    ],
    ids=str,
)
def test_faults(given, fault):
    with pytest.raises(SceneError) as caught:
        tfm.Medium(phase=given)
    assert len(caught.value.args) == 1
    assert fault in str(caught.value)
