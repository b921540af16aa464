import json
import sys

import numpy as np
import pytest
from skimage.metrics import structural_similarity

from tfm_cl.files import image_io

METRICS = {"ssim", "psnr", "rmse"}

pytestmark = pytest.mark.usefixtures("images")


@pytest.fixture
def images(folder, rng):
    """``test.npy`` is ``reference.npy`` with noise; a third of the frame is empty."""
    reference = rng.random((20, 30, 4), np.float32)
    reference[:, :10] = 0
    test = reference + rng.normal(0, 0.02, reference.shape).astype(np.float32)
    np.save(folder / "reference.npy", reference)
    np.save(folder / "test.npy", test)
    return test.astype(float), reference.astype(float)


def luma(image, reference):
    """sRGB-encoded luma on the reference's white, written out from the interface's words."""
    weights = np.array([0.2126, 0.7152, 0.0722])
    white = np.percentile(reference[..., :3] @ weights, 99.9)
    linear = np.clip(image[..., :3] / white, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055) @ weights


def test_json_holds_the_metrics_of_the_interface(cli, images):
    test, reference = images
    done = cli("compare", "test.npy", "reference.npy", "--json")
    assert done.code == 0
    assert done.err == ""
    values = done.json
    assert set(values) == METRICS | {"lit"}
    assert set(values["lit"]) == METRICS
    shown, truth = luma(test, reference), luma(reference, reference)
    ssim = structural_similarity(
        shown, truth, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=1
    )
    assert values["ssim"] == pytest.approx(ssim, abs=1e-4)
    assert values["psnr"] == pytest.approx(-10 * np.log10(np.mean((shown - truth) ** 2)), abs=1e-2)
    error, level = test[..., :3] - reference[..., :3], reference[..., :3]
    assert values["rmse"] == pytest.approx(np.sqrt(np.mean(error**2)) / level.mean(), rel=1e-5)
    lit = reference[..., 3] > 0.001
    assert values["lit"]["rmse"] == pytest.approx(
        np.sqrt(np.mean(error[lit] ** 2)) / level[lit].mean(), rel=1e-5
    )


def test_text_shows_the_same_numbers(cli):
    values = cli("compare", "test.npy", "reference.npy", "--json").json
    lines = dict(line.split() for line in cli("compare", "test.npy", "reference.npy").out.splitlines())
    assert set(lines) == METRICS | {f"lit.{name}" for name in METRICS}
    for name in METRICS:
        assert float(lines[name]) == pytest.approx(values[name], rel=1e-5)
        assert float(lines[f"lit.{name}"]) == pytest.approx(values["lit"][name], rel=1e-5)


def test_identical_pictures(cli):
    values = cli("compare", "reference.npy", "reference.npy", "--json").json
    assert values == {"ssim": 1, "psnr": None, "rmse": 0, "lit": {"ssim": 1, "psnr": None, "rmse": 0}}
    assert cli("compare", "reference.npy", "reference.npy", "--fail-under", "psnr=200").code == 0


@pytest.mark.parametrize("name", ["ssim", "psnr", "rmse", "lit.ssim", "lit.psnr", "lit.rmse"])
def test_fail_under_decides_the_exit_code(cli, name):
    values = cli("compare", "test.npy", "reference.npy", "--json").json
    value = values["lit"][name[4:]] if name.startswith("lit.") else values[name]
    better = 0.9 if name.endswith("rmse") else 1.001  # of the limit: smaller RMSE is better
    missed = cli("compare", "test.npy", "reference.npy", "--fail-under", f"{name}={better * value}")
    assert missed.code == 1
    assert missed.err.startswith(f"tfm: {name} = ")
    assert missed.err.count("\n") == 1
    met = cli("compare", "test.npy", "reference.npy", "--fail-under", f"{name}={value / better}")
    assert (met.code, met.err) == (0, "")


def test_one_of_several_limits_is_enough_to_fail(cli):
    limits = ("--fail-under", "ssim=0", "--fail-under", "psnr=200", "--json")
    done = cli("compare", "test.npy", "reference.npy", *limits)
    assert done.code == 1
    assert set(json.loads(done.out)) == METRICS | {"lit"}


def test_a_reference_without_a_lit_pixel(cli):
    np.save("black.npy", np.zeros((20, 30, 4), np.float32))
    assert cli("compare", "test.npy", "black.npy", "--json").json["lit"] is None
    done = cli("compare", "test.npy", "black.npy", "--fail-under", "lit.ssim=0.5")
    assert done.code == 2
    assert done.err == "tfm: black.npy: has no lit pixel, and so no lit.ssim\n"


@pytest.mark.parametrize("limit", ["ssim", "ssim=", "ssim=x", "ssim=nan", "quality=1", "=1", "lit=0.5"])
def test_a_limit_that_is_none(refused, limit):
    assert "METRIC=VALUE with METRIC one of ssim, psnr" in refused(
        "compare", "test.npy", "reference.npy", "--fail-under", limit
    )


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("missing.exr", "missing.exr: no such file"),
        ("words.png", "words.png: "),
        ("words.exr", "words.exr: "),
        ("words.npy", "words.npy: "),
        ("words.txt", "not a known image format"),
        ("other.npy", "5×5 pixels"),
        ("nan.npy", "NaN"),
        (".", "not a known image format"),
    ],
)
def test_pictures_that_cannot_be_compared(refused, folder, name, message):
    for suffix in ("png", "exr", "npy", "txt"):
        (folder / f"words.{suffix}").write_text("no picture")
    np.save("other.npy", np.zeros((5, 5, 4), np.float32))
    np.save("nan.npy", np.full((20, 30, 4), np.nan, np.float32))
    assert message in refused("compare", name, "reference.npy")


def write_crop(name, pixels, crop=None):
    """Write pixels of a frame of 30×20 as an EXR."""
    x0, y0, x1, y1 = crop or (0, 0, 30, 20)
    rgba = np.ascontiguousarray(pixels[y0:y1, x0:x1], np.float32)
    image = image_io.Image(rgba=rgba, display_window=(30, 20), crop=crop)
    image_io.save(name, image, pixel_type="float")


def test_crops_are_compared_where_they_overlap(cli, images):
    """Cut by hand from the same arrays, whose other pixels would give other numbers."""
    test, reference = images
    write_crop("test.exr", test, (2, 1, 22, 16))
    write_crop("reference.exr", reference, (5, 0, 30, 14))
    write_crop("full.exr", reference)
    np.save("test_part.npy", test[1:14, 5:22].astype(np.float32))
    np.save("reference_part.npy", reference[1:14, 5:22].astype(np.float32))
    expected = cli("compare", "test_part.npy", "reference_part.npy", "--json").json
    done = cli("compare", "test.exr", "reference.exr", "--json")
    assert (done.code, done.json.pop("window")) == (0, [5, 1, 22, 14])
    assert {key: done.json[key] for key in expected} == expected
    note = "compared are the pixels 5,1,22,14, which both have"
    assert done.json["note"].startswith(note)
    assert done.err == f"tfm: note: {done.json['note']}\n"
    assert cli("compare", "full.exr", "test.exr", "--json").json["window"] == [2, 1, 22, 16]
    assert "note" not in cli("compare", "test.exr", "test.exr", "--json").json


def test_crops_without_a_common_pixel(refused, images):
    write_crop("left.exr", images[0], (0, 0, 10, 20))
    write_crop("right.exr", images[1], (10, 0, 30, 20))
    assert "there is no pixel in both: left.exr holds 0,0,10,20; right.exr holds" in refused(
        "compare", "left.exr", "right.exr"
    )


def test_a_crop_of_another_frame_of_the_same_size(refused, images):
    """As many pixels, but others."""
    write_crop("crop.exr", images[0], (3, 3, 13, 13))
    image_io.save("small.exr", image_io.Image(rgba=images[1][3:13, 3:13].astype(np.float32)))
    assert "the full frames differ (crop.exr 30×20 and small.exr 10×10)" in refused(
        "compare", "crop.exr", "small.exr"
    )


def test_a_crop_and_a_file_that_has_no_windows(cli, refused, images):
    write_crop("crop.exr", images[0], (3, 3, 13, 13))
    assert "30×20" in refused("compare", "crop.exr", "reference.npy")
    np.save("part.npy", images[1][3:13, 3:13].astype(np.float32))
    assert "part.npy does not say where its pixels lie" in cli("compare", "crop.exr", "part.npy").err


def write_layers(name, pixels, crop, **aovs):
    """Write the same crop of a picture and of layers."""
    x0, y0, x1, y1 = crop
    parts = {key: np.ascontiguousarray(aov[y0:y1, x0:x1], np.float32) for key, aov in aovs.items()}
    rgba = np.ascontiguousarray(pixels[y0:y1, x0:x1], np.float32)
    image = image_io.Image(rgba=rgba, aovs=parts, display_window=(30, 20), crop=crop)
    image_io.save(name, image, pixel_type="float")


def test_layers_are_compared_where_they_overlap(cli, images):
    test, reference = images
    both = np.s_[1:14, 5:22]
    of_test = {"light.key": test[..., :3] / 2, "depth": test[..., 0]}
    of_reference = {"light.key": reference[..., :3] / 3, "depth": reference[..., 1]}
    write_layers("test.exr", test, (2, 1, 22, 16), **of_test)
    write_layers("reference.exr", reference, (5, 0, 30, 14), **of_reference)

    for name, grey in (("light.key", 1), ("depth", 3)):
        shown, truth = (np.dstack([layers[name][both]] * grey) for layers in (of_test, of_reference))
        np.save("shown.npy", shown.astype(np.float32))
        np.save("truth.npy", np.dstack([truth, reference[both][..., 3]]).astype(np.float32))
        expected = cli("compare", "shown.npy", "truth.npy", "--json").json
        done = cli("compare", "test.exr", "reference.exr", "--layer", name, "--json")
        assert {key: done.json[key] for key in expected} == expected


def test_layers_that_are_not_there(refused, images):
    write_layers("a.exr", images[0], (0, 0, 30, 20), ambient=images[0][..., :3])
    said = "a.exr: unknown layer 'ambiant'; did you mean 'ambient'? known: ambient"
    assert said in refused("compare", "a.exr", "a.exr", "--layer", "ambiant")
    assert "test.npy: has no layer 'ambient': .npy files have none, .exr has" in refused(
        "compare", "test.npy", "a.exr", "--layer", "ambient"
    )


def test_flip_where_it_is_installed(cli):
    pytest.importorskip("flip_evaluator", reason="FLIP is an extra: pip install 'tfm_cl[flip]'")
    values = cli("compare", "test.npy", "reference.npy", "--flip", "--json").json
    assert 0 < values["flip"] < 0.5
    assert cli("compare", "test.npy", "reference.npy", "--fail-under", "flip=0.9").code == 0
    assert cli("compare", "test.npy", "reference.npy", "--fail-under", "flip=1e-6").code == 1


def test_flip_where_it_is_not_installed(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert "pip install 'tfm_cl[flip]'" in refused("compare", "test.npy", "reference.npy", "--flip")
