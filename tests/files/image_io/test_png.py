import io
import struct
import warnings
import zlib

import numpy as np
import PIL.Image
import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import Image, load_image, save
from tfm_cl.files.image_io import png as png_module
from tfm_cl.files.image_io.display import automatic_exposure
from tfm_cl.files.image_io.png import png_bytes
from tfm_cl.files.image_io.views import VIEWS
from tfm_cl.files.srgb import linear_from_srgb, srgb_from_linear


def decoded(content):
    """Codes, read back by Pillow."""
    return np.asarray(PIL.Image.open(io.BytesIO(content)))


def grey(values):
    """A picture [1, n, 3] of linear values."""
    return np.repeat(np.asarray(values, np.float32).reshape(1, -1, 1), 3, axis=2)


def encoded(values, exposure=0.0, **png):
    """8-bit code of each linear value, the nearest."""
    return decoded(png_bytes(grey(values), exposure, dither=False, **png))[0, :, 0].tolist()


def chunk(kind, body):
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def png(width, height, depth, colour, rows, *extra):
    """Bytes of a file, written out from the PNG specification."""
    header = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    body = (
        chunk(b"IHDR", header) + b"".join(extra) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    )
    return b"\x89PNG\r\n\x1a\n" + body


def load(folder, content):
    (folder / "a.png").write_bytes(content)
    return load_image(folder / "a.png")


def test_known_values_of_srgb():
    # 18 % grey is 118 (117.6), 50 % is 188 (187.5); 0.003 lies on the linear part: 12.92·0.003·255 = 9.88.
    assert encoded([0, 1, 0.18, 0.5, 0.003, 0.2158605]) == [0, 255, 118, 188, 10, 128]


def test_every_code_round_trips(tmp_path):
    codes = np.arange(256, dtype=np.uint8)
    linear = load(tmp_path, png(256, 1, 8, 0, b"\0" + codes.tobytes()))
    assert linear.shape == (1, 256, 3)
    assert linear.dtype == np.float32
    assert encoded(linear[0, :, 0]) == codes.tolist()


def test_rounded_to_the_nearest_code():
    middle = ((127.5 / 255 + 0.055) / 1.055) ** 2.4
    assert encoded([middle * 0.9999, middle * 1.0001]) == [127, 128]


def test_outside_values_are_clipped():
    assert encoded([-1, 1.5, 3e38]) == [0, 255, 255]


def test_exposure_is_in_stops():
    assert encoded([0.25], exposure=1) == encoded([0.5])
    assert encoded([0.5], exposure=-2) == encoded([0.125])
    assert encoded([0.25, 0.0], exposure=100) == [255, 0]


def test_a_file_is_rgb_over_black_with_its_colour_space(tmp_path):
    rgba = np.random.default_rng(0).random((5, 7, 4), np.float32)
    save(tmp_path / "a.png", Image(rgba=rgba), exposure=1.0)
    with PIL.Image.open(tmp_path / "a.png") as picture:
        assert (picture.mode, picture.size, picture.info["srgb"]) == ("RGB", (7, 5), 0)
    assert (tmp_path / "a.png").read_bytes() == png_bytes(rgba[..., :3], 1.0)


def test_alpha_is_premultiplied(tmp_path):
    rows = b"\0" + bytes([255, 0, 188, 51])
    loaded = load(tmp_path, png(1, 1, 8, 6, rows))[0, 0]
    np.testing.assert_allclose(loaded, [0.2, 0, ((188 / 255 + 0.055) / 1.055) ** 2.4 * 0.2, 0.2], rtol=1e-6)


@pytest.mark.parametrize(
    ("png", "steps"),
    # Rounded: half a step of the code, and of alpha; dithered: whole ones.
    [({"dither": False}, 0.5), ({}, 1.0), ({"png_bits": 16}, 0.5 / 257)],
    ids=["rounded", "dithered", "16-bit"],
)
def test_transparent_pictures_round_trip(tmp_path, png, steps):
    rng = np.random.default_rng(2)
    alpha = rng.random((20, 30, 1))
    alpha[:3], alpha[3:6] = 0, 1
    rgba = np.concatenate([rng.random((20, 30, 3)) * alpha, alpha], axis=2).astype(np.float32)
    save(tmp_path / "a.png", Image(rgba=rgba), transparent=True, **png)
    loaded = load_image(tmp_path / "a.png")
    assert loaded.dtype == np.float32
    assert (loaded[:3] == 0).all()
    assert (loaded[3:6, :, 3] == 1).all()
    # sRGB rises by at most 2.275 of linear light, at white.
    assert np.abs(loaded[..., 3] - rgba[..., 3]).max() <= 1.01 * steps / 255
    assert np.abs(loaded - rgba).max() <= (2.275 + 1.01) * steps / 255


def test_a_transparent_picture_over_black_is_the_opaque_one():
    """In linear light, with the view that only clips."""
    rgba = np.random.default_rng(3).random((6, 7, 4)).astype(np.float32)
    rgba[..., :3] *= 0.4 * rgba[..., 3:]
    over = decoded(png_bytes(rgba, 1.0, transparent=True, png_bits=16))
    assert over.shape == (6, 7, 4)
    straight, alpha = rgba[..., :3] / rgba[..., 3:], rgba[..., 3:]
    expected = decoded(png_bytes(straight, 1.0, dither=False))
    assert np.abs(over[..., :3].astype(int) - expected).max() <= 1  # Pillow leaves 8 of the 16 bits
    np.testing.assert_allclose(over[..., 3:] / 255, alpha, atol=1 / 255)


@pytest.mark.parametrize("view", VIEWS)
def test_what_is_transparent_is_shown_by_the_view(view):
    """The tone of a colour does not depend on its alpha."""
    rgba = np.array([[[0.9, 0.3, 0.1, 1], [0.45, 0.15, 0.05, 0.5]]], np.float32)
    codes = decoded(png_bytes(rgba, view=view, transparent=True, dither=False))
    assert codes[0, 0, :3].tolist() == codes[0, 1, :3].tolist()
    assert codes[..., 3].tolist() == [[255, 128]]


def test_transparency_needs_alpha():
    with pytest.raises(ImageError, match="has no alpha channel"):
        png_bytes(grey([0.5]), transparent=True)


def test_dithering_is_right_on_average_and_next_to_the_value():
    codes = np.array([3.25, 10.5, 127.9, 200.1, 254.6])
    for code in codes:
        shown = decoded(png_bytes(grey(np.full(64 * 64, linear_from_srgb(code / 255))).reshape(64, 64, 3)))
        assert set(np.unique(shown)) == {int(code), int(code) + 1}
        # The thresholds of 4096 pixels are spread almost evenly.
        assert shown.mean() == pytest.approx(code, abs=0.01)
        blocks = shown[..., 0].reshape(8, 8, 8, 8).mean(axis=(1, 3))
        assert blocks == pytest.approx(np.full((8, 8), code), abs=0.1)
        assert (shown == shown[..., :1]).all()  # greys stay grey


def test_dithering_leaves_what_is_a_code():
    codes = np.arange(256).reshape(256, 1, 1)
    flat = np.broadcast_to(linear_from_srgb(codes / 255), (256, 300, 3)).astype(np.float32)
    assert (decoded(png_bytes(flat)) == codes).all()
    opaque = np.concatenate([flat, np.ones((256, 300, 1), np.float32)], axis=2)
    assert (decoded(png_bytes(opaque, transparent=True)) == [1, 1, 1, 0] * codes + [0, 0, 0, 255]).all()


def test_a_crop_is_dithered_like_the_frame(tmp_path):
    rgba = np.full((40, 50, 4), 0.3, np.float32) * np.linspace(0.9, 1, 50, dtype=np.float32)[:, np.newaxis]
    save(tmp_path / "frame.png", Image(rgba=rgba))
    part = Image(rgba=rgba[5:30, 7:40], display_window=(50, 40), crop=(7, 5, 40, 30))
    save(tmp_path / "part.png", part)
    frame = decoded((tmp_path / "frame.png").read_bytes())
    assert len(np.unique(frame)) > 5
    np.testing.assert_array_equal(decoded((tmp_path / "part.png").read_bytes()), frame[5:30, 7:40])


def test_a_picture_of_many_bands_is_encoded_alike():
    rgb = np.random.default_rng(4).random((600, 200, 3)).astype(np.float32)
    assert rgb[..., 0].size > png_module.BAND
    whole = decoded(png_bytes(rgb))
    bottom = decoded(png_bytes(rgb[500:], corner=(0, 500)))
    np.testing.assert_array_equal(whole[500:], bottom)


def test_16_bits_are_written_and_read_to_the_last(tmp_path):
    linear = np.random.default_rng(5).random((9, 11, 3)).astype(np.float32)
    save(tmp_path / "a.png", Image(rgba=np.dstack([linear, np.ones((9, 11))])), png_bits=16)
    with PIL.Image.open(tmp_path / "a.png") as picture:
        assert (picture.mode, picture.size, picture.info["srgb"]) == ("RGB", (11, 9), 0)
        assert np.abs(np.asarray(picture) - 255 * srgb_from_linear(linear)).max() < 1  # what others read
    codes = srgb_from_linear(load_image(tmp_path / "a.png").astype(float)) * 65535
    expected = np.floor(srgb_from_linear(linear.astype(float)) * 65535 + 0.5)
    assert np.abs(codes - expected).max() < 0.1


@pytest.mark.parametrize(("colour", "channels"), [(2, 3), (6, 4)])
def test_16_bit_colours_keep_their_precision(tmp_path, colour, channels):
    values = np.array([[300, 40_001, 65_535, 65_535], [1, 256, 513, 65_535]])[:, :channels]
    loaded = load(tmp_path, png(2, 1, 16, colour, b"\0" + values.astype(">u2").tobytes()))
    expected = linear_from_srgb(values[np.newaxis, :, :3] / 65535)
    np.testing.assert_allclose(loaded[..., :3], expected, rtol=1e-6)


def test_the_exposure_may_be_chosen(tmp_path):
    rgba = np.random.default_rng(6).random((20, 30, 4)).astype(np.float32)
    for png in ({}, {"view": "agx", "transparent": True}):
        transparent = png.get("transparent", False)
        stops = automatic_exposure(rgba, png.get("view", "standard"), transparent=transparent)
        save(tmp_path / "a.png", Image(rgba=rgba), exposure="auto", **png)
        assert (tmp_path / "a.png").read_bytes() == png_bytes(rgba, stops, **png)
        assert stops != 0


@pytest.mark.parametrize(
    ("png", "message"),
    [
        ({"view": "filmc"}, "unknown view 'filmc'; did you mean 'filmic'"),
        ({"png_bits": 12}, "png_bits is 8 or 16; got 12"),
        ({"exposure": "automatic"}, "exposure is a number of stops from -100 to 100, or 'auto'"),
    ],
)
def test_options_that_are_none(tmp_path, png, message):
    with pytest.raises(ImageError, match=message):
        save(tmp_path / "a.png", Image(rgba=np.ones((1, 1, 4), np.float32)), **png)
    assert not (tmp_path / "a.png").exists()


def test_16_bit_grey_keeps_its_precision(tmp_path):
    loaded = load(tmp_path, png(2, 1, 16, 0, b"\0" + struct.pack(">2H", 257, 40_000)))
    expected = [257 / 65535 / 12.92, ((40_000 / 65535 + 0.055) / 1.055) ** 2.4]
    np.testing.assert_allclose(loaded[0, :, 1], expected, rtol=1e-6)


def test_palette_and_bilevel(tmp_path):
    palette = chunk(b"PLTE", bytes([0, 0, 0, 255, 0, 0]))
    assert load(tmp_path, png(2, 1, 8, 3, b"\0\0\1", palette)).tolist() == [[[0, 0, 0], [1, 0, 0]]]
    assert load(tmp_path, png(2, 1, 1, 0, b"\0\x40"))[0, :, 0].tolist() == [0, 1]


@pytest.mark.parametrize(
    ("side", "message"), [(12_000, "more than it can hold"), (30_000, "bomb"), (200_000, "bomb")]
)
def test_a_small_file_cannot_declare_a_large_image(tmp_path, side, message):
    with pytest.raises(ImageError, match=rf"a\.png: .*{message}"):
        load(tmp_path, png(side, side, 8, 2, bytes(1000)))


def test_not_a_png(tmp_path):
    for content in (b"", b"hello", b"GIF89a" + bytes(50), b"\x89PNG\r\n\x1a\n"):
        with pytest.raises(ImageError, match="not a readable PNG"):
            load(tmp_path, content)


@pytest.mark.parametrize(
    "rgb",
    [np.zeros((2, 2)), np.zeros((2, 2, 2)), np.zeros((0, 2, 3)), np.full((2, 2, 3), np.nan)],
)
def test_what_is_no_picture(rgb):
    with pytest.raises(ImageError):
        png_bytes(rgb)


def test_flips_and_truncations_never_raise_anything_else(tmp_path):
    rgba, rng, refused = np.random.default_rng(0).random((9, 8, 4), np.float32), np.random.default_rng(1), 0
    sounds = [png_bytes(rgba), png_bytes(rgba, transparent=True, png_bits=16)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for trial in range(600):
            damaged = bytearray(sounds[trial // 6 % 2])
            damaged[rng.integers(min(len(damaged), 80 if trial % 2 else 10**6))] = rng.integers(256)
            try:
                load(tmp_path, damaged[: rng.integers(len(damaged))] if trial % 3 == 0 else damaged)
            except ImageError as error:
                refused += "\n" not in str(error)
    assert refused > 300
