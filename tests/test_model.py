"""What the scene's sections share: strict types, one-line errors, tables and back."""

from fractions import Fraction

import numpy as np
import pytest
from pydantic import ValidationError

import tfm_cl as tfm
from tfm_cl.errors import SceneError, unknown_key
from tfm_cl.scene.scene_file import SECTIONS
from tfm_cl.scene.settings import ImageSettings

SPOT = {"from": (1, 2, 3), "to": (0, 0, 0)}


def test_points_may_be_lists_tuples_or_arrays():
    for point in ([1, 2, 3], (1.0, 2.0, 3.0), np.array([1, 2, 3]), np.array([1, 2, 3], np.float32)):
        camera = tfm.Camera(from_=point, to=(0, 0, 0))
        assert camera.from_ == (1.0, 2.0, 3.0)
        assert all(type(item) is float for item in camera.from_)


@pytest.mark.parametrize(
    "point",
    [
        1,
        (1, 2),
        (1, 2, 3, 4),
        "1,2,3",
        (1, 2, "3"),
        (1, 2, None),
        (1, 2, True),
        (1, 2, np.nan),
        (1, 2, np.inf),
        (1, 2, 1e16),
        (1, 2, 10**400),
        (1, 2, 3j),
        (1, 2, Fraction(1, 2)),
        np.eye(3),
        {"x": 1},
        None,
    ],
)
def test_what_is_no_point(point):
    with pytest.raises(SceneError, match=r"^camera\.from = .*should be three (finite )?numbers"):
        tfm.Camera(from_=point, to=(0, 0, 0))


def test_one_number_is_grey():
    assert tfm.Medium(sigma_s=2).sigma_s == (2.0, 2.0, 2.0)
    assert tfm.Medium(sigma_s=np.array([1, 2, 3])).sigma_s == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("colour", [-1, (1, -1e-9, 1), (1, 2), "white", np.nan, 1e26, True, 10**400])
def test_what_is_no_colour(colour):
    with pytest.raises(SceneError, match=r"^medium\.sigma_s = .*: should be"):
        tfm.Medium(sigma_s=colour)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: tfm.MapSettings(coefs=3),
            "unknown key 'coefs' in [map]; did you mean 'coeffs'? known: basis, ",
        ),
        (
            lambda: tfm.MapSettings(coeffs="8"),
            "map.coeffs = '8': should be a whole number from 1 to 512, or 'auto'",
        ),
        (
            lambda: tfm.MapSettings(coeffs=8.0),
            "map.coeffs = 8.0: should be a whole number from 1 to 512, or 'auto'",
        ),
        (
            lambda: tfm.MapSettings(coeffs=0),
            "map.coeffs = 0: should be a whole number from 1 to 512, or 'auto'",
        ),
        (
            lambda: tfm.MapSettings(basis="slices", coeffs=513),
            "map.coeffs = 513: should be a whole number from 1 to 512, or 'auto'",
        ),
        (lambda: tfm.MapSettings(coeffs=33), "map: coeffs = 33: basis 'klt' has 1 to 32 coefficients"),
        (
            lambda: tfm.MapSettings(basis="slices-cubic", coeffs=33),
            "map: coeffs = 33: basis 'slices-cubic' has 1 to 32 coefficients",
        ),
        (
            lambda: tfm.MapSettings(res=8193),
            "map.res = 8193: should be a whole number from 1 to 8192, or 'auto'",
        ),
        (
            lambda: tfm.MapSettings(steps=8.0),
            "map.steps = 8.0: should be a whole number from 1 to 100000, or 'auto'",
        ),
        (
            lambda: tfm.MarchSettings(steps=0),
            "march.steps = 0: should be a whole number from 1 to 100000, or",
        ),
        (lambda: tfm.MarchSettings(steps=True), "march.steps = True: should be a whole number"),
        (lambda: tfm.MarchSettings(steps="all"), "march.steps = 'all': should be a whole number"),
        (lambda: tfm.MarchSettings(cutoff=1), "march.cutoff = 1: should be less than 1"),
        (lambda: tfm.MarchSettings(cutoff=-1e-9), "march.cutoff = -1e-09: should be greater than or equal"),
        (lambda: tfm.SphereSolid(radius=0), "solid.radius = 0: should be greater than or equal to 1e-15"),
        (lambda: tfm.MarchSettings(voxels="f64"), "march.voxels = 'f64': should be 'f32', 'f16' or 'u8'"),
        (lambda: tfm.MarchSettings(skip_empty="no"), "march.skip_empty = 'no': should be a valid boolean"),
        (lambda: tfm.MapSettings(storage="f64"), "map.storage = 'f64': should be 'f32', 'f16' or 'u8'"),
        (lambda: tfm.MarchSettings(max_stretch=np.inf), "march.max_stretch = inf: should be a finite number"),
        (lambda: tfm.SpotLight(**SPOT, cone=90), "light.cone = 90: should be less than 90"),
        (lambda: tfm.SpotLight(to=(0, 0, 0)), "light.from is missing"),
        (lambda: tfm.SpotLight(**SPOT, blend=1.5), "light.blend = 1.5: should be less than or equal to 1"),
        (lambda: tfm.Camera(to=(0, 0, 0)), "camera.from is missing"),
        (lambda: tfm.Camera(**SPOT, res=(0, 1)), "camera.res = (0, 1): should be at least 1×1"),
        (
            lambda: tfm.Medium(phase="snow"),
            "medium.phase = 'snow': unknown phase function 'snow'; known: isotropic, hg",
        ),
        (lambda: tfm.Medium(phase=7), "medium.phase = 7: should be a name, as"),
        (lambda: tfm.Medium(self=1), "unknown key 'self' in [medium]; "),
        (lambda: tfm.Medium(**{"a\nb": 1}), r"unknown key 'a\nb' in [medium]; "),
    ],
)
def test_an_error_is_one_line_with_section_key_and_value(make, message):
    with pytest.raises(SceneError) as raised:
        make()
    line = str(raised.value)
    assert line.startswith(message)
    assert "\n" not in line


def test_a_long_value_is_shortened():
    with pytest.raises(SceneError) as raised:
        tfm.Camera(from_=[0.5] * 100_000, to=(0, 0, 0))
    assert len(str(raised.value)) < 200


@pytest.mark.parametrize(
    ("make", "faults"),
    [
        (lambda: tfm.MapSettings(coeffs=0, steps=0), {"map.coeffs = 0", "map.steps = 0"}),
        (lambda: tfm.MapSettings(coefs=1, steps=0), {"map.steps = 0", "unknown key 'coefs' in [map]"}),
        (
            lambda: tfm.Medium(sigma_s=-1, phase={"type": "hg", "g": 2, "h": 3}),
            {"medium.sigma_s = -1", "medium.phase.g = 2", "unknown key 'h' in [medium.phase]"},
        ),
        # One fault, not a key that is unknown and another that is missing.
        (lambda: tfm.Camera(form=(1, 2, 3), to=(0, 0, 0)), {"unknown key 'form' in [camera]"}),
        (
            lambda: tfm.Camera.from_table({"from_": [1, 2, 3], "to": [0, 0, 0]}),
            {"unknown key 'from_' in [camera]"},
        ),
    ],
)
def test_every_fault_has_its_line(make, faults):
    with pytest.raises(SceneError) as raised:
        make()
    assert {line.split(":")[0].split(";")[0] for line in raised.value.args} == faults


def test_center_is_centre():
    sphere = tfm.SphereSolid(center=(1, 2, 3))
    assert sphere == tfm.SphereSolid(centre=(1, 2, 3))
    assert tfm.SphereVolume(center=(1, 2, 3)).centre == (1, 2, 3)
    assert sphere.replace(center=(4, 5, 6)).centre == (4, 5, 6)
    assert sphere.to_dict()["centre"] == [1, 2, 3]
    with pytest.raises(SceneError, match=r"^solid: has both center and centre, which are one; keep one$"):
        tfm.SphereSolid(center=(1, 2, 3), centre=(1, 2, 3))
    with pytest.raises(SceneError, match=r"^unknown key 'center' in \[camera\]"):
        tfm.Camera(**SPOT, center=(1, 2, 3))


def test_sections_are_frozen():
    with pytest.raises(ValidationError, match="frozen"):
        tfm.Medium().sigma_s = (1, 1, 1)


def test_replace_checks_again():
    camera = tfm.Camera(**SPOT)
    assert camera.replace(fov=30).fov == 30
    assert camera.fov == 40
    assert camera.replace(from_=(9, 9, 9)).from_ == (9, 9, 9)
    with pytest.raises(SceneError, match="same point"):
        camera.replace(from_=(0, 0, 0))
    with pytest.raises(SceneError, match=r"camera\.fov"):
        camera.replace(fov=180)


@pytest.mark.parametrize(
    "section",
    [
        tfm.Camera(**SPOT, fov=30, res=(7, 5)),
        tfm.Medium(sigma_s=(1, 2, 3), phase=tfm.HenyeyGreenstein(0.25)),
        tfm.SpotLight(**SPOT, cone=12, blend=0.5, intensity=3),
        tfm.MapSettings(density_weighting="auto", storage="f16"),
        tfm.MapSettings(res="auto", steps="auto"),
        tfm.MarchSettings(method="dual"),
        tfm.MarchSettings(steps="auto", cutoff=0.0, skip_empty=False, voxels="u8"),
        ImageSettings(crop=(1, 2, 3, 4), aov=("depth", "samples")),
    ],
    ids=lambda section: type(section).__name__,
)
def test_a_table_and_back(section):
    table = section.to_dict()
    assert set(table) == set(section.keys())
    assert not any(key.endswith("_") for key in table)
    assert type(section)(**table) == section


def test_every_field_says_what_it_is():
    for model in SECTIONS.values():
        for name, field in model.model_fields.items():
            assert field.description, f"{model.__name__}.{name}"


def test_nearest_name():
    known = ["from", "to", "up"]
    assert unknown_key("form", known, "camera") == (
        "unknown key 'form' in [camera]; did you mean 'from'? known: from, to, up"
    )
    assert unknown_key("qqq", known) == "unknown key 'qqq'; known: from, to, up"


def test_crop_and_aov():
    settings = ImageSettings(crop=[0, 0, 1, 2], aov=["depth", "depth", "samples"])
    assert settings.crop == (0, 0, 1, 2)
    assert settings.aov == ("depth", "samples")


@pytest.mark.parametrize(
    "crop", [(0, 0, 0, 1), (0, 0, 1), (0.0, 0, 1, 1), "0,0,1,1", (True, 0, 2, 2), (3, 0, 2, 2)]
)
def test_what_is_no_crop(crop):
    with pytest.raises(SceneError, match=r"^image\.crop = .*: should be"):
        ImageSettings(crop=crop)
