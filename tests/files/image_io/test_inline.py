"""Pictures as bytes."""

import io

import numpy as np
import PIL.Image
import pytest

from tfm_cl.files.image_io.inline import encoded

JPEG_CODES = 8
"""Of 255, of a smooth picture: quantised cosines, and colours at half the resolution."""


@pytest.mark.parametrize(
    ("quality", "mime", "most"), [("low", "image/jpeg", JPEG_CODES), ("full", "image/png", 0)]
)
def test_pictures_come_back(quality, mime, most):
    y, x = np.mgrid[0:48, 0:64]
    pixels = np.stack([2 * x + y, 3 * y, 255 - x - y], axis=-1).astype(np.uint8)
    found, content = encoded(pixels, quality)
    assert found == mime
    with PIL.Image.open(io.BytesIO(content)) as picture:
        assert picture.get_format_mimetype() == mime
        again = np.asarray(picture.convert("RGB")).astype(int)
    assert np.abs(again - pixels).max() <= most
