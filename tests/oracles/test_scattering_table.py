"""The table of `scripts/scattering_table.py`: what it says of differences under noise."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
NOISE = 0.3
"""Of each pixel of a batch, of a mean of 1."""


@pytest.fixture(scope="module")
def table():
    pytest.importorskip("mitsuba")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(SCRIPTS)
        yield importlib.import_module("scattering_table")
    sys.modules.pop("scattering_table")


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_noise_is_no_difference(table, rng, wrong):
    truth = 1 + 0.5 * np.sin(np.arange(60 * 80).reshape(60, 80) / 7)
    batches = truth + NOISE * rng.standard_normal((8, *truth.shape))
    sign = np.where(rng.random(truth.shape) < 0.5, -1, 1)
    ours = ((1 + wrong / 5) * truth + wrong * sign)[..., None] * np.ones(4)
    found = table.Estimate(batches).beside(ours)
    assert found["bias"] == pytest.approx(wrong / 5, abs=4 * found["bias_error"])
    assert found["bias_error"] == pytest.approx(NOISE / np.sqrt(8 * truth.size), rel=0.1)
    # The bias is of the truth, whose square is 1.125 in the mean.
    expected = np.hypot(wrong, wrong / 5 * np.sqrt(1.125))
    assert abs(found["rmse"] ** 2 - expected**2) < 2 * found["rmse_seen"] ** 2
    cell = table.cell({**found, "what": "2 orders", "seconds": 1.0})
    assert ("<" in cell) == (wrong == 0)


def test_a_line_for_each_case(table):
    row = {"bias": 0.01, "bias_error": 0.001, "rmse": 0.02, "rmse_seen": 0.01, "psnr": 30.0, "seconds": 1.5}
    case = table.Case("cumulus", "isotropic", 1.0, "sun")._asdict()
    rows = [{**case, "what": what, **row} for what in ("2 orders", "4 octaves")]
    lines = table.markdown(rows).splitlines()
    assert lines[0] == "| volume, phase, albedo, light | 2 orders | 4 octaves |"
    assert lines[2:] == [
        "| cumulus, isotropic, 1.0, sun | +1.0% ± 0.1%, 2.0%; 1.50 s | +1.0% ± 0.1%, 2.0%, 30.0 dB; 1.50 s |"
    ]
