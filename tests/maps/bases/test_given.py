"""Functions as text."""

import base64

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.maps.bases.given import functions_in, functions_text


def test_comes_back_bit_by_bit():
    values = np.random.default_rng(1).normal(size=(65, 7)).astype(np.float32)
    text = functions_text(values)
    assert text.startswith("65x7:")
    assert functions_in(text).tobytes() == values.tobytes()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (3, "should be what tfm wrote"),
        ([1], "should be what tfm wrote"),
        ("functions.npy", "should be what tfm wrote"),
        ("0x1:", "should be what tfm wrote"),
        ("1x1:AAA", "should be what tfm wrote"),
        ("1x1:AAAAAé==", "should be what tfm wrote"),
        ("2x1:AAAAAA==", "says 2×1 numbers, and has 4 bytes"),
        ("99999x99999:", "has 9,999,800,001 numbers, more than 65,536"),
        ("1x1:" + base64.b64encode(np.float32(np.nan).tobytes()).decode(), r"has numbers beyond 1e\+18"),
    ],
)
def test_text_that_is_none(text, said):
    with pytest.raises(SceneError, match=rf"^map\.functions = .*: {said}"):
        tfm.MapSettings(functions=text)
