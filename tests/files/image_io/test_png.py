import io
import struct
import warnings
import zlib

import numpy as np
import PIL.Image
import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import Image, load_image, save
from tfm_cl.files.image_io.png import png_bytes


def encoded(values, exposure=0.0):
    """8-bit code of each linear value, read back by Pillow."""
    rgb = np.repeat(np.asarray(values, np.float32).reshape(1, -1, 1), 3, axis=2)
    return np.asarray(PIL.Image.open(io.BytesIO(png_bytes(rgb, exposure))))[0, :, 0].tolist()


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
    sound = png_bytes(rgba)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for trial in range(600):
            damaged = bytearray(sound)
            damaged[rng.integers(min(len(damaged), 80 if trial % 2 else 10**6))] = rng.integers(256)
            try:
                load(tmp_path, damaged[: rng.integers(len(damaged))] if trial % 3 == 0 else damaged)
            except ImageError as error:
                refused += "\n" not in str(error)
    assert refused > 300
