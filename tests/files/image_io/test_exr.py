import os
import struct
import subprocess
import sys
import zlib
from typing import get_args

import numpy as np
import OpenEXR
import pytest
from tolerances import DWA, PXR24

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import Compression, Image, check_writable, exr, load_image, save

COMPRESSIONS = {
    "none": 0,
    "rle": 1,
    "zips": 2,
    "zip": 3,
    "piz": 4,
    "pxr24": 5,
    "dwaa": 8,
    "dwab": 9,
    "htj2k": 10,
}
"""Name -> number in the header, as in OpenEXR's ``openexr_attr.h``."""


def picture(height=5, width=7, *, seed=0):
    return np.random.default_rng(seed).random((height, width, 4), np.float32)


@pytest.fixture
def image():
    rng = np.random.default_rng(1)
    return Image(
        rgba=picture(),
        aovs={
            "depth": 1e5 * rng.random((5, 7), np.float32),
            "transmittance": rng.random((5, 7, 3), np.float32),
        },
        display_window=(20, 10),
        crop=(2, 3, 9, 8),
        metadata={"comments": "fog", "coeffs": np.int64(8), "seconds": 1.5, "samples": 2**40},
    )


def walk(content):
    """Header attributes by the layout of the format: name, type, size, bytes; none of OpenEXR's code."""
    at = 8
    while content[at]:
        name, kind, rest = content[at:].split(b"\0", 2)
        size = struct.unpack("<i", rest[:4])[0]
        at += len(name) + len(kind) + 2 + 4 + size
        yield name.decode(), kind.decode(), rest[4 : 4 + size]


def header_end(content):
    return 9 + sum(len(name) + len(kind) + 6 + len(value) for name, kind, value in walk(content))


def attributes(path):
    return {name: (kind, value) for name, kind, value in walk(path.read_bytes())}


def test_half_is_rounded_to_nearest(tmp_path, image):
    save(tmp_path / "a.exr", image)
    np.testing.assert_array_equal(
        load_image(tmp_path / "a.exr"), image.rgba.astype(np.float16).astype(np.float32)
    )


def test_float_round_trips_to_the_bit(tmp_path):
    bits = np.random.default_rng(0).integers(0, 0x7F80_0000, (5, 7, 4), np.uint32)
    rgba = bits.view(np.float32)  # every finite positive float may occur, subnormal ones too
    save(tmp_path / "a.exr", Image(rgba=rgba), pixel_type="float")
    loaded = load_image(tmp_path / "a.exr")
    assert loaded.dtype == np.float32
    assert loaded.tobytes() == rgba.tobytes()


@pytest.mark.parametrize("compression", get_args(Compression))
def test_compressions(tmp_path, compression):
    """Their numbers in the file are those of the format, and what they keep is what they say."""
    rows, columns = np.mgrid[:40, :50]
    rgba = np.stack([np.sin(0.1 * rows + 0.03 * columns * i) + 1 for i in range(4)], axis=2, dtype=np.float32)
    picture = Image(rgba=rgba, aovs={"depth": rgba[..., 0]})
    save(tmp_path / "a.exr", picture, pixel_type="float", compression=compression)
    assert attributes(tmp_path / "a.exr")["compression"][1] == bytes([COMPRESSIONS[compression]])
    loaded, depth = load_image(tmp_path / "a.exr"), exr.read_aov(tmp_path / "a.exr", "depth")
    if compression == "pxr24":
        np.testing.assert_allclose(loaded, rgba, rtol=PXR24)
        np.testing.assert_allclose(depth, picture.aovs["depth"], rtol=PXR24)
        return
    if compression in {"dwaa", "dwab"}:
        np.testing.assert_allclose(loaded[..., :3], rgba[..., :3], atol=DWA)
    else:
        assert loaded[..., :3].tobytes() == rgba[..., :3].tobytes()
    assert loaded[..., 3].tobytes() == rgba[..., 3].tobytes()
    assert depth.tobytes() == picture.aovs["depth"].tobytes()


def test_half_clips_instead_of_infinity(tmp_path):
    rgba = picture()
    rgba[0, 0] = [65504, 65519.9, 1e30, -1e30]
    save(tmp_path / "a.exr", Image(rgba=rgba))
    assert load_image(tmp_path / "a.exr")[0, 0].tolist() == [65504, 65504, 65504, -65504]


@pytest.mark.parametrize("pixel_type", ["half", "float"])
def test_channels_and_their_types(tmp_path, image, pixel_type):
    save(tmp_path / "a.exr", image, pixel_type=pixel_type)
    content = attributes(tmp_path / "a.exr")["channels"][1]
    types = {}
    while content != b"\0":
        name, rest = content.split(b"\0", 1)
        types[name.decode()] = {1: "half", 2: "float"}[struct.unpack("<i", rest[:4])[0]]
        content = rest[16:]
    colours = [*"RGBA", "transmittance.R", "transmittance.G", "transmittance.B"]
    assert types == dict.fromkeys(colours, pixel_type) | {"depth": "float"}


def test_aovs_are_read_by_name(tmp_path, image):
    save(tmp_path / "a.exr", image, pixel_type="float")
    for name, aov in image.aovs.items():
        assert exr.read_aov(tmp_path / "a.exr", name).tobytes() == aov.tobytes()
    assert exr.read_aov(tmp_path / "a.exr", "transmittance.G").shape == (5, 7)
    with pytest.raises(ImageError, match=r"no AOV 'normal'; its channels are .* depth"):
        exr.read_aov(tmp_path / "a.exr", "normal")


def test_header_as_the_format_lays_it_out(tmp_path, image):
    save(tmp_path / "a.exr", image)
    header = attributes(tmp_path / "a.exr")
    assert header["compression"] == ("compression", b"\x03")  # ZIP
    assert struct.unpack("<4i", header["dataWindow"][1]) == (2, 3, 8, 7)
    assert struct.unpack("<4i", header["displayWindow"][1]) == (0, 0, 19, 9)
    rec_709 = struct.unpack("<8f", header["chromaticities"][1])
    np.testing.assert_allclose(rec_709, [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329], rtol=1e-6)
    assert header["comments"] == ("string", b"fog")
    assert header["coeffs"] == ("int", struct.pack("<i", 8))
    assert header["seconds"] == ("float", struct.pack("<f", 1.5))
    assert header["samples"] == ("string", b"1099511627776")  # would overflow an int


@pytest.mark.parametrize(("pixel_type", "dtype"), [("half", "<f2"), ("float", "<f4")])
def test_pixels_as_the_format_lays_them_out(tmp_path, pixel_type, dtype):
    """ZIP undone by hand: blocks of 16 lines; deflate, differences, and the even and odd bytes apart."""
    rgba = np.repeat(picture(20, 6), 2, axis=1)
    save(tmp_path / "a.exr", Image(rgba=rgba), pixel_type=pixel_type)
    content = (tmp_path / "a.exr").read_bytes()
    offsets = struct.unpack_from("<2Q", content, header_end(content))
    lines = b""
    for offset in offsets:
        y, size = struct.unpack_from("<2i", content, offset)
        assert y == (0 if offset == offsets[0] else 16)
        differences = np.frombuffer(
            zlib.decompress(content[offset + 8 : offset + 8 + size]), np.uint8
        ).astype(int)
        differences[1:] -= 128
        halves = (np.cumsum(differences) % 256).astype(np.uint8)
        apart = (halves.size + 1) // 2
        block = np.empty_like(halves)
        block[0::2], block[1::2] = halves[:apart], halves[apart:]
        lines += block.tobytes()
    channels = np.frombuffer(lines, dtype).reshape(20, 4, 12)  # [y, A B G R, x]
    np.testing.assert_array_equal(channels[:, [3, 2, 1, 0]].transpose(0, 2, 1), rgba.astype(dtype))


def test_matrices_are_stored_for_row_vectors(tmp_path):
    camera_from_world = np.array([[0, 1, 0, 5], [0, 0, 1, 6], [1, 0, 0, 7], [0, 0, 0, 1]], dtype=np.float64)
    save(tmp_path / "a.exr", Image(rgba=picture(), metadata={"worldToCamera": camera_from_world}))
    kind, content = attributes(tmp_path / "a.exr")["worldToCamera"]
    stored = np.frombuffer(content, "<f4").reshape(4, 4)
    assert kind == "m44f"
    assert stored[3].tolist() == [5, 6, 7, 1]  # row vectors: the translation is the last row
    np.testing.assert_array_equal([1, 2, 3, 1] @ stored, camera_from_world @ [1, 2, 3, 1])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"metadata": {"dataWindow": "x"}}, "own use"),
        ({"metadata": {"worldToCamera": np.eye(3)}}, "4×4"),
        ({"metadata": {"worldToCamera": np.full((4, 4), np.nan)}}, "finite"),
        ({"aovs": {"R": np.zeros((5, 7), np.float32)}}, "AOV 'R'"),
        ({"aovs": {"a.b": np.zeros((5, 7), np.float32)}}, r"AOV 'a\.b'"),
        ({"aovs": {"a.b.c": np.zeros((5, 7, 3), np.float32)}}, r"AOV 'a\.b\.c'"),
    ],
)
def test_what_a_file_cannot_hold(tmp_path, fields, message):
    with pytest.raises(ImageError, match=message):
        save(tmp_path / "a.exr", Image(rgba=picture(), **fields))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_images_with_nan_or_infinity_do_not_exist(value):
    rgba, depth = picture(), np.zeros((5, 7), np.float32)
    depth[2, 3] = value
    with pytest.raises(ImageError, match=r"AOV 'depth' holds 1 values .* x=3, y=2"):
        Image(rgba=rgba, aovs={"depth": depth})
    rgba[4, 1, 0] = value
    with pytest.raises(ImageError, match=r"x=1, y=4"):
        Image(rgba=rgba)


@pytest.mark.parametrize(
    "fields",
    [
        {"rgba": np.zeros((5, 7, 3), np.float32)},
        {"rgba": np.zeros((0, 7, 4), np.float32)},
        {"aovs": {"depth": np.zeros((7, 5), np.float32)}},
        {"crop": (0, 0, 7, 6)},
        {"crop": (1, 0, 8, 5)},
        {"crop": (-1, 0, 6, 5)},
        {"display_window": (6, 5)},
    ],
)
def test_parts_of_an_image_must_fit(fields):
    with pytest.raises(ImageError):
        Image(**({"rgba": picture()} | fields))


def test_rgb_without_alpha_and_other_writers(tmp_path):
    rgb = picture()[..., :3].copy()
    header = {
        "compression": OpenEXR.PIZ_COMPRESSION,
        "type": OpenEXR.tiledimage,
        "tiles": OpenEXR.TileDescription(),
    }
    OpenEXR.File(header, {"RGB": rgb}).write(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(load_image(tmp_path / "a.exr"), rgb)


def test_deep_images_are_refused(tmp_path):
    deep = np.empty((2, 2), dtype=object)
    for place in np.ndindex(2, 2):
        deep[place] = np.ones(3, np.float32)
    OpenEXR.File({"type": OpenEXR.deepscanline, "compression": OpenEXR.ZIPS_COMPRESSION}, {"R": deep}).write(
        str(tmp_path / "a.exr")
    )
    with pytest.raises(ImageError, match="deep"):
        load_image(tmp_path / "a.exr")


def test_a_huge_window_is_refused_before_it_is_allocated(tmp_path):
    save(tmp_path / "a.exr", Image(rgba=picture()))
    content = bytearray((tmp_path / "a.exr").read_bytes())
    for name in (b"dataWindow\0", b"displayWindow\0"):
        at = content.find(name) + len(name) + len(b"box2i\0") + 4
        struct.pack_into("<4i", content, at, 0, 0, 16_000, 16_000)
    (tmp_path / "a.exr").write_bytes(content)
    with pytest.raises(ImageError, match="declares 16001×16001"):
        load_image(tmp_path / "a.exr")


def test_damage_is_one_line_and_prints_nothing(tmp_path, image, capfd):
    path, rng, refused = tmp_path / "a.exr", np.random.default_rng(3), 0
    save(path, image)
    sound = path.read_bytes()
    for trial in range(200):
        damaged = bytearray(sound)
        damaged[rng.integers(len(damaged))] = rng.integers(256)
        path.write_bytes(damaged[: rng.integers(len(damaged))] if trial % 3 == 0 else damaged)
        try:
            assert load_image(path).shape[2] in {3, 4}
        except ImageError as error:
            refused += "\n" not in str(error)
    assert refused > 80
    assert capfd.readouterr() == ("", "")


def test_stderr_works_after_reading(tmp_path, capfd):
    (tmp_path / "a.exr").write_bytes(b"nothing")
    with pytest.raises(ImageError, match="not a readable EXR"):
        load_image(tmp_path / "a.exr")
    os.write(2, b"still here")
    assert capfd.readouterr().err == "still here"


@pytest.mark.parametrize("side", [5, 64])
@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.npy"])
def test_a_full_disk_is_noticed_and_leaves_nothing(tmp_path, name, side):
    """The limit on the size of files stands for the disk; of a small image OpenEXR does not report it."""
    resource = pytest.importorskip("resource")
    image = Image(rgba=picture(side, side))
    (tmp_path / name).write_bytes(b"the old image")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        with pytest.raises(ImageError, match=rf"{name}: .*(too large|written)"):
            save(tmp_path / name, image)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"the old image"


def test_interrupting_leaves_nothing_half_written(tmp_path, monkeypatch):
    def interrupted(path, *_):
        path.write_bytes(b"half an ima")
        raise KeyboardInterrupt

    monkeypatch.setattr(exr, "write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save(tmp_path / "a.exr", Image(rgba=picture()))
    assert list(tmp_path.iterdir()) == []


def test_a_file_is_replaced_and_a_link_stays_a_link(tmp_path):
    (tmp_path / "target.exr").write_bytes(b"old")
    (tmp_path / "link.exr").symlink_to("target.exr")
    save(tmp_path / "link.exr", Image(rgba=picture()))
    assert (tmp_path / "link.exr").is_symlink()
    assert load_image(tmp_path / "target.exr").shape == (5, 7, 4)


def test_a_new_file_has_the_usual_permissions(tmp_path):
    (tmp_path / "usual").touch()
    save(tmp_path / "a.exr", Image(rgba=picture()))
    assert (tmp_path / "a.exr").stat().st_mode == (tmp_path / "usual").stat().st_mode


@pytest.mark.parametrize("check", [check_writable, lambda path: save(path, Image(rgba=picture()))])
def test_places_that_cannot_be_written(tmp_path, check):
    (tmp_path / "folder.exr").mkdir()
    (tmp_path / "file").touch()
    for name, message in {
        "a.tif": r"'\.tif'; known: \.deep\.exr \.exr \.npy \.png",
        "a": "known",
        "none/a.exr": r"no directory .*none; create it first",
        "file/a.exr": "no directory",
        "folder.exr": "is a directory",
    }.items():
        with pytest.raises(ImageError, match=message) as caught:
            check(tmp_path / name)
        assert str(tmp_path / name) in str(caught.value)
    if sys.platform == "linux":  # where not even root can write
        with pytest.raises(ImageError, match="cannot be written"):
            check("/proc/a.exr")


def test_a_place_that_can_be_written_stays_as_it_was(tmp_path):
    check_writable(tmp_path / "a.exr")
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a.exr").write_bytes(b"old")
    check_writable(tmp_path / "a.exr")
    assert (tmp_path / "a.exr").read_bytes() == b"old"


def test_a_read_only_image_is_kept(tmp_path, monkeypatch):
    (tmp_path / "a.exr").write_bytes(b"old")
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write all files
    with pytest.raises(ImageError, match="read-only"):
        check_writable(tmp_path / "a.exr")


@pytest.mark.parametrize(
    "options", [{"pixel_type": "double"}, {"compression": "lzw"}, {"exposure": np.nan}, {"exposure": 1e4}]
)
def test_wrong_options(tmp_path, options):
    with pytest.raises(ImageError, match=next(iter(options))):
        save(tmp_path / "a.png", Image(rgba=picture()), **options)


def test_missing_files(tmp_path):
    with pytest.raises(ImageError, match="no such file"):
        load_image(tmp_path / "a.exr")
    (tmp_path / "b.png").mkdir()
    with pytest.raises(ImageError, match="is not a file"):
        load_image(tmp_path / "b.png")


def test_importing_the_package_does_not_import_its_libraries():
    script = (
        "import sys, tfm_cl.files.image_io, tfm_cl.files.volume_io\n"
        "sys.exit(' '.join({'OpenEXR', 'PIL', 'numcodecs'} & set(sys.modules)) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr.strip()) == (0, "")
