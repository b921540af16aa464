import shutil
import subprocess

import numpy as np
import OpenEXR
import pytest
from tolerances import FLOAT32

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import Image, is_deep, load_image, save
from tfm_cl.files.image_io.image import DeepSamples

FLATTENED = 20 * FLOAT32
"""Of 1: a few samples over each other, in float32."""


def samples_of(height=5, width=7, *, rgb=True, seed=0):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 5, (height, width)).astype(np.int32)
    n = int(counts.sum())
    z = np.concatenate([np.sort(rng.uniform(1, 9, (2, k)).ravel()) for k in counts.ravel()]).reshape(-1, 2)
    alpha = rng.uniform(0, 1, n).astype(np.float32)
    alpha[rng.random(n) > 0.8] = 1  # solids
    colour = (rng.random((n, 3)) * alpha[:, None]).astype(np.float32) if rgb else None
    return DeepSamples(counts, *np.ascontiguousarray(z.T, np.float32), alpha, colour)


def image_of(samples, **changes):
    return Image(rgba=np.zeros((*samples.counts.shape, 4), np.float32), deep=samples, **changes)


def read(path):
    with path.open("rb") as stream, OpenEXR.File(stream, separate_channels=True) as file:
        (part,) = file.parts
        return dict(part.header), {name: channel.pixels for name, channel in part.channels.items()}


@pytest.mark.parametrize("rgb", [False, True])
def test_openexr_reads_every_sample_to_the_bit(tmp_path, rgb):
    samples = samples_of(rgb=rgb)
    frame = {"display_window": (20, 10), "crop": (2, 3, 9, 8), "metadata": {"comments": "fog"}}
    save(tmp_path / "a.deep.exr", image_of(samples, **frame))
    header, channels = read(tmp_path / "a.deep.exr")
    assert (header["type"], header["compression"]) == (OpenEXR.deepscanline, OpenEXR.ZIPS_COMPRESSION)
    assert [corner.tolist() for corner in header["dataWindow"]] == [[2, 3], [8, 7]]
    assert [corner.tolist() for corner in header["displayWindow"]] == [[0, 0], [19, 9]]
    assert header["comments"] == "fog"
    assert "viewing direction" in header["tfm_cl:depth"]
    expected = {"A": samples.alpha, "Z": samples.z, "ZBack": samples.z_back}
    if rgb:
        expected |= dict(zip("RGB", samples.rgb.T, strict=True))
    assert channels.keys() == expected.keys()
    for name, pixels in channels.items():
        none = np.zeros(0, np.float32)
        found = [none if pixel is None else pixel for pixel in pixels.ravel()]
        np.testing.assert_array_equal([len(pixel) for pixel in found], samples.counts.ravel())
        np.testing.assert_array_equal(np.concatenate(found), expected[name])


def test_flattened_is_each_sample_over_those_behind():
    samples = samples_of()
    flat = samples.flattened().reshape(-1, 4)
    for pixel, (count, end) in enumerate(zip(samples.counts.ravel(), samples.ends, strict=True)):
        total = np.zeros(4)
        for i in reversed(range(end - count, end)):
            total = np.append(samples.rgb[i], samples.alpha[i]) + (1 - samples.alpha[i]) * total
        assert np.abs(flat[pixel] - total).max() < FLATTENED
    assert samples_of(rgb=False).flattened().shape == (5, 7, 1)


@pytest.mark.skipif(not shutil.which("oiiotool"), reason="needs OpenImageIO's oiiotool")
def test_openimageio_flattens_it_to_the_same(tmp_path):
    samples = samples_of()
    save(tmp_path / "a.deep.exr", image_of(samples))
    flatten = ["oiiotool", tmp_path / "a.deep.exr", "--flatten", "--ch", "R,G,B,A", "-o", tmp_path / "a.exr"]
    subprocess.run(flatten, check=True, capture_output=True)
    assert np.abs(load_image(tmp_path / "a.exr") - samples.flattened()).max() < FLATTENED


def test_a_picture_without_any_sample(tmp_path):
    none = np.zeros(0, np.float32)
    save(tmp_path / "a.deep.exr", image_of(DeepSamples(np.zeros((5, 7), np.int32), none, none, none)))
    _, channels = read(tmp_path / "a.deep.exr")
    assert channels["Z"].shape == (5, 7)


@pytest.mark.parametrize("name", ["a.deep.exr", "A.DEEP.EXR"])
def test_its_name_says_what_it_is(name):
    assert is_deep(name)
    assert not is_deep("deep.exr")


def test_what_cannot_be_written_is_refused(tmp_path):
    samples = samples_of()
    with pytest.raises(ImageError, match=r"a\.deep\.exr: has no deep samples .* render with deep"):
        save(tmp_path / "a.deep.exr", Image(rgba=np.zeros((5, 7, 4), np.float32)))
    with pytest.raises(ImageError, match="7×6 pixels; got DeepSamples"):
        Image(rgba=np.zeros((6, 7, 4), np.float32), deep=samples)
    samples.z[3] = np.nan
    with pytest.raises(ImageError, match="the deep samples hold 1 value"):
        image_of(samples)
    with pytest.raises(ImageError, match="deep samples of"):
        DeepSamples(samples.counts, samples.z[1:], samples.z_back, samples.alpha)
    assert not [*tmp_path.iterdir()]


def test_a_deep_image_is_not_read_as_a_picture(tmp_path):
    save(tmp_path / "a.deep.exr", image_of(samples_of()))
    with pytest.raises(ImageError, match="is a deep image"):
        load_image(tmp_path / "a.deep.exr")
