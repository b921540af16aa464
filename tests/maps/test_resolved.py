"""From what is asked of a map to what is built: nothing is left open, and it can be asked for again."""

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.given import functions_text
from tfm_cl.maps.resolved import ResolvedMap, resolve

OPEN = ("basis", "coeffs", "target", "fit", "range", "lookup")


@pytest.mark.parametrize("basis", ["auto", *BASES])
def test_a_basis_chooses_its_own_way(basis):
    resolved = resolve(tfm.MapSettings(basis=basis))
    best = BASES[resolved.basis]

    assert "auto" not in {getattr(resolved, name) for name in OPEN}
    assert (resolved.target, resolved.fit) == (best.defaults.target, best.defaults.fit)
    assert (resolved.range, resolved.lookup) == (best.defaults.range, best.defaults.lookup)
    assert resolved.coeffs in best.counts
    assert resolved.density_weighting is None


@pytest.mark.parametrize("basis", BASES)
def test_what_was_resolved_is_resolved_the_same_again(basis):
    resolved = resolve(tfm.MapSettings(basis=basis, bytes_=40, storage="f16", blur=0.0, slicing="gamma"))
    again = resolved.request()

    assert again.bytes_ is None
    assert resolve(again) == resolved
    assert list(resolved.to_dict()) == list(tfm.MapSettings().to_dict())


def test_what_is_given_stays():
    settings = tfm.MapSettings(
        basis="hcos",
        coeffs=3,
        density_weighting=4.0,
        target="optical-depth",
        fit="l2",
        range="global",
        lookup="reconstruct",
        res=99,
        steps=7,
        storage="u8",
        blur=2.0,
        blur_kernel="box",
    )
    assert resolve(settings).request() == settings


def test_functions_that_are_given():
    text = functions_text(np.linspace([0, 1], [1, 0], 65, dtype=np.float32))
    given = tfm.MapSettings(coeffs=2, functions=text)
    resolved = resolve(given)
    assert (resolved.functions, resolved.learns, resolve(resolved.request())) == (text, False, resolved)
    assert resolve(given.replace(functions="")).learns

    for other, said in (
        ({"coeffs": 3}, r"map\.functions: should be 65×3 values for basis 'klt' with coeffs = 3; set it to"),
        ({"fit": "l2"}, r"map\.functions: basis 'klt' takes none with fit 'l2' and slicing 'uniform'; set"),
        ({"basis": "dct"}, r"map\.functions: basis 'dct' takes none with fit 'l2'"),
    ):
        with pytest.raises(SceneError, match=said):
            resolve(given.replace(**other))


def test_a_weighted_fit_is_of_few_numbers():
    many = tfm.MapSettings(basis="slices", coeffs=33, fit="visibility")
    with pytest.raises(SceneError, match=r"map\.coeffs = 33: fit = 'visibility' finds up to 32; set"):
        resolve(many)
    assert resolve(many.replace(fit="l2")).coeffs == 33
    room = {"coeffs": "auto", "bytes_": 1000, "range": "box"}
    assert [resolve(many.replace(fit=fit, **room)).coeffs for fit in ("visibility", "l2")] == [32, 250]


def test_numbers_for_what_the_scene_decides():
    settings = tfm.MapSettings(res="auto", steps="auto")
    resolved = resolve(settings, res=77, steps=5)
    assert (resolved.res, resolved.steps) == (77, 5)
    with pytest.raises(ValueError, match="still open"):
        resolve(settings)


@pytest.mark.parametrize(("range_", "share"), [("box", 0.0), ("visible", 16 / 16)])
def test_bytes_count_the_ranges(range_, share):
    for room in (8, 24, 60):
        resolved = resolve(tfm.MapSettings(basis="dct", bytes_=room + share, range=range_, res=1024))
        assert resolved.coeffs == room // 4
        assert resolved.bytes_per_texel == 4 * resolved.coeffs + share
    with pytest.raises(SceneError, match=rf"basis 'dct' needs at least {4 + share:g}"):
        resolve(tfm.MapSettings(basis="dct", bytes_=3.5, range=range_, res=1024))


def test_a_weighting_beyond_what_may_be_asked_for_is_written_down():
    """Media of tiny sigmas get one; what was done is told all the same."""
    resolved = resolve(tfm.MapSettings(basis="dct")).replace(density_weighting=1e9)
    assert isinstance(resolved, ResolvedMap)
    assert resolved.to_dict()["density_weighting"] == 1e9
