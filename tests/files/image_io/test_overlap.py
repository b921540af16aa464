import numpy as np
import pytest

from tfm_cl.errors import ImageError
from tfm_cl.files.image_io import Picture
from tfm_cl.files.image_io.overlap import overlap

FRAME = (0, 0, 12, 8)
FULL = np.arange(12 * 8 * 3, dtype=np.float32).reshape(8, 12, 3)


def crop(x0, y0, x1, y1, frame=FRAME):
    return Picture(FULL[y0:y1, x0:x1], (x0, y0, x1, y1), frame)


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    ("one", "other", "window"),
    [
        (FRAME, (3, 2, 9, 7), (3, 2, 9, 7)),
        ((0, 0, 6, 8), (3, 2, 9, 7), (3, 2, 6, 7)),
        ((0, 0, 6, 8), (5, 7, 12, 8), (5, 7, 6, 8)),
        # Of one size, but not of one place.
        ((0, 0, 6, 4), (2, 1, 8, 5), (2, 1, 6, 4)),
    ],
)
def test_the_pixels_that_both_have(one, other, window, swapped):
    one, other = (other, one) if swapped else (one, other)
    common = overlap(crop(*one), crop(*other), "a.exr", "b.exr")
    assert common.window == window
    x0, y0, x1, y1 = window
    for pixels in (common.test, common.reference):
        np.testing.assert_array_equal(pixels, FULL[y0:y1, x0:x1])
    numbers = [",".join(map(str, box)) for box in (window, one, other)]
    assert common.note == (
        f"compared are the pixels {numbers[0]}, which both have: "
        f"a.exr holds {numbers[1]}; b.exr holds {numbers[2]}"
    )


@pytest.mark.parametrize("window", [FRAME, (3, 2, 9, 7)])
def test_pictures_of_one_window_are_compared_whole(window):
    common = overlap(crop(*window), crop(*window), "a.exr", "b.exr")
    assert (common.window, common.note) == (None, "")
    np.testing.assert_array_equal(common.test, crop(*window).pixels)


def test_a_file_with_itself():
    assert overlap(crop(*FRAME), crop(*FRAME), "a.exr", "a.exr").note == ""


def test_no_pixel_in_common():
    with pytest.raises(ImageError, match=r"no pixel in both: a\.exr holds 0,0,3,8; b\.exr holds 3,0,12,8"):
        overlap(crop(0, 0, 3, 8), crop(3, 0, 12, 8), "a.exr", "b.exr")


@pytest.mark.parametrize(
    ("frame", "shown"), [((0, 0, 24, 16), "24×16"), ((6, 4, 18, 12), "12×8 at 6,4"), ((0, 0, 3, 2), "3×2")]
)
def test_frames_that_differ(frame, shown):
    message = rf"full frames differ \(a.exr 12×8 and b.exr {shown}\)"
    with pytest.raises(ImageError, match=message):
        overlap(crop(3, 2, 6, 4), crop(3, 2, 6, 4, frame), "a.exr", "b.exr")


def test_what_does_not_say_where_it_lies():
    plain = Picture(FULL)
    assert overlap(plain, crop(*FRAME), "a.npy", "b.exr").note == ""
    assert overlap(plain, plain, "a.npy", "b.npy").note == ""
    cropped = crop(3, 2, 9, 7)
    common = overlap(cropped, Picture(cropped.pixels), "a.exr", "b.png")
    assert common.note == "b.png does not say where its pixels lie; taken for the pixels 3,2,9,7"
    assert common.window == (3, 2, 9, 7)
    # Of other sizes: left to who compares them.
    assert overlap(plain, cropped, "a.npy", "b.exr").test.shape == FULL.shape
