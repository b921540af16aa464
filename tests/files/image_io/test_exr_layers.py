"""The picture among the channels and parts of EXR files as renderers write them."""

import numpy as np
import OpenEXR
import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import exr, load_image, load_picture
from tfm_cl.files.image_io.exr_layers import Part, beauty

HEADER = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}


def write(path, *parts, **header):
    """Write a file of parts {channel: value}; each may have a name in front."""
    written = []
    for part in parts:
        name, channels = part if isinstance(part, tuple) else ("", part)
        pixels = {channel: np.full((4, 6), value, np.float32) for channel, value in channels.items()}
        written.append(OpenEXR.Part(HEADER | header, pixels, name))
    OpenEXR.File(written).write(str(path))
    return path


def colours(first, names="RGBA", before=""):
    """Channels with the values ``first``, ``first + 1`` …"""
    return {f"{before}{name}": first + i for i, name in enumerate(names)}


@pytest.mark.parametrize(
    "parts",
    [
        [colours(1)],
        [colours(1) | colours(11, before="diffuse.") | {"Z": 9}],
        [colours(1) | colours(11, before="beauty.")],
        [colours(1, before="RGBA.")],
        [colours(1, before="beauty.") | colours(11, before="albedo.")],
        [colours(11, before="albedo.") | colours(1, before="Beauty.")],
        [colours(1, before="ViewLayer.Combined.") | colours(11, before="ViewLayer.DiffCol.")],
        [colours(1, "rgba")],
        [colours(1, ["red", "green", "blue", "alpha"])],
        [("depth", {"Z": 9}), ("beauty", colours(1))],
        [("depth", {"Z": 9}), ("main", colours(1))],
        [("diffuse", colours(11)), ("rgba", colours(1))],
        [("albedo", colours(11)), ("ViewLayer.Combined", colours(1))],
        [("diffuse", colours(11)), ("main", colours(1, before="RGBA."))],
        [("rgba.left", colours(1)), ("rgba.right", colours(11))],
        [("position", colours(11, "XYZ", "P.")), ("beauty", colours(1))],
    ],
)
def test_the_picture_is_found(tmp_path, parts):
    pixels = load_image(write(tmp_path / "a.exr", *parts))
    assert pixels.shape == (4, 6, 4)
    assert pixels[0, 0].tolist() == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("channels", "expected"),
    [
        ({"Y": 5}, [5, 5, 5]),
        ({"Y": 5, "A": 1}, [5, 5, 5, 1]),
        ({"RGBA.Y": 5}, [5, 5, 5]),
        (colours(1, "RGB") | {"Y": 9}, [1, 2, 3]),
        ({"R": 1, "Y": 5}, [5, 5, 5]),
    ],
)
def test_luminance_alone_is_grey(tmp_path, channels, expected):
    assert load_image(write(tmp_path / "a.exr", channels))[0, 0].tolist() == expected


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ([{"Z": 1}], "a.exr: has no channel R G B; it has Z"),
        ([{"R": 1}], "a.exr: has no channel G B; it has R"),
        ([colours(1, before="diffuse.")], "has no channel R G B; it has diffuse.A diffuse.B"),
        ([colours(1, before="diffuse.rgb.")], "has no channel R G B; it has diffuse.rgb.A"),
        ([colours(1, "XYZ", "P.")], "has no channel R G B; it has P.X P.Y P.Z"),
        (
            [("diffuse", colours(1)), ("specular", colours(11))],
            "none of its parts is called beauty, combined or rgba: diffuse, specular",
        ),
        ([{"Y": 1, "RY": 2, "BY": 3}], r"holds luminance and chroma \(Y RY BY\)"),
    ],
)
def test_what_is_no_picture_is_not_taken_for_one(tmp_path, parts, message):
    write(tmp_path / "a.exr", *parts)
    with pytest.raises(ImageError, match=message):
        load_image(tmp_path / "a.exr")


def test_subsampled_channels_are_refused():
    """OpenEXR's Python binding writes none."""
    part = Part("", {"R": False, "G": False, "B": True}, (0, 0, 4, 4), (0, 0, 4, 4))
    with pytest.raises(ImageError, match=r"different sizes \(subsampled\); save it as plain RGB"):
        beauty([part])


def test_aovs_of_any_part(tmp_path):
    write(tmp_path / "a.exr", ("depth", {"Z": 9}), ("beauty", colours(1)), ("albedo", colours(11)))
    assert exr.read_aov(tmp_path / "a.exr", "Z")[0, 0] == 9
    assert exr.read_aov(tmp_path / "a.exr", "R")[0, 0] == 1


def test_windows_are_those_of_the_picture_s_part(tmp_path):
    windows = {"dataWindow": ((-2, 3), (3, 6)), "displayWindow": ((0, 0), (9, 9))}
    picture = load_picture(write(tmp_path / "a.exr", colours(1), **windows))
    assert picture.window == (-2, 3, 4, 7)
    assert picture.frame == (0, 0, 10, 10)
