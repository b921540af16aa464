"""Points and curves of USD files, written here as text by hand, and under attack."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from damage import assert_read_or_refused, assert_refused, truncated, with_other_bytes

from tfm_cl.errors import VolumeError
from tfm_cl.files import usd
from tfm_cl.files.curves_io import read_curves
from tfm_cl.files.curves_io.splines import SEGMENTS
from tfm_cl.files.points_io import read_points

ROOT = Path(__file__).resolve().parents[2]
needs_usd = pytest.mark.skipif(importlib.util.find_spec("pxr") is None, reason="usd-core is not installed")

POINTS = """#usda 1.0
def Xform "a" {
    matrix4d xformOp:transform = ( (2, 0, 0, 0), (0, 2, 0, 0), (0, 0, 2, 0), (10, 20, 30, 1) )
    uniform token[] xformOpOrder = ["xformOp:transform"]
    def Points "two" {
        point3f[] points = [(1, 2, 3), (4, 5, 6)]
        float[] widths = [1, 3]
        vector3f[] velocities = [(1, 0, 0), (0, 2, 0)]
        color3f[] primvars:displayColor = [(1, 0.5, 0)]
        float[] primvars:displayOpacity = [0.25, 0.75] ( interpolation = "vertex" )
    }
}
"""


def points(text):
    return f'#usda 1.0\ndef Points "p" {{\n{text}\n}}\n'


def curves(text, *, counts="[4]", start='uniform token type = "cubic"'):
    return f'#usda 1.0\ndef BasisCurves "c" {{\n{start}\nint[] curveVertexCounts = {counts}\n{text}\n}}\n'


ROW = "point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]"


def written(folder, text, name="a.usda"):
    (folder / name).write_text(text)
    return folder / name


def read(reader, folder, text):
    return reader(written(folder, text))


@needs_usd
def test_points_in_the_world(tmp_path):
    found = read(read_points, tmp_path, POINTS)
    np.testing.assert_array_equal(found.positions, [[12, 24, 36], [18, 30, 42]])
    np.testing.assert_allclose(found.radii, [1, 3], rtol=1e-6)
    np.testing.assert_array_equal(found.velocities, [[2, 0, 0], [0, 4, 0]])
    np.testing.assert_array_equal(found.colours, [[1, 0.5, 0]] * 2)
    np.testing.assert_array_equal(found.opacities, [0.25, 0.75])
    assert found.densities is None


@needs_usd
@pytest.mark.parametrize("extension", [".usdc", ".usd", ".usdz"])
def test_other_kinds_of_file(tmp_path, extension):
    from pxr import Sdf, UsdUtils  # noqa: PLC0415 - where it is installed

    path, packed = written(tmp_path, POINTS), tmp_path / f"b{extension}"
    if extension == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(path), str(packed))
    else:
        assert Sdf.Layer.FindOrOpen(str(path)).Export(str(packed))
    np.testing.assert_array_equal(read_points(packed).positions, [[12, 24, 36], [18, 30, 42]])


@needs_usd
def test_prims_are_joined_and_hidden_ones_left_out(tmp_path):
    text = """#usda 1.0
def Points "a" {
    point3f[] points = [(1, 0, 0)]
}
def Points "b" {
    point3f[] points = [(2, 0, 0), (3, 0, 0)]
}
def Points "c" {
    point3f[] points = [(4, 0, 0)]
    token visibility = "invisible"
}
def Points "d" {
    point3f[] points = [(5, 0, 0)]
    uniform token purpose = "guide"
}
def Points "e" {
    point3f[] points = []
}
over Points "f" {
    point3f[] points = [(6, 0, 0)]
}
"""
    found = read(read_points, tmp_path, text)
    np.testing.assert_array_equal(found.positions[:, 0], [1, 2, 3])


@needs_usd
def test_the_earliest_time_is_read(tmp_path):
    text = "point3f[] points.timeSamples = {\n7: [(7, 0, 0)],\n8: [(8, 0, 0)],\n}"
    assert read(read_points, tmp_path, points(text)).positions[0, 0] == 7


@needs_usd
def test_indexed_and_inherited_primvars(tmp_path):
    text = """#usda 1.0
def Scope "a" {
    float[] primvars:displayOpacity = [0.5] ( interpolation = "constant" )
    def Points "p" {
        point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
        color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] ( interpolation = "vertex" )
        int[] primvars:displayColor:indices = [1, 0, 1]
        float[] primvars:widths = [4] ( interpolation = "constant" )
        float[] widths = [1, 1, 1]
    }
}
"""
    found = read(read_points, tmp_path, text)
    np.testing.assert_array_equal(found.colours, [[0, 1, 0], [1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(found.opacities, [0.5] * 3)
    np.testing.assert_array_equal(found.radii, [2] * 3)


@needs_usd
def test_lines(tmp_path):
    text = """point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 2, 0), (0, 3, 0)]
        float[] widths = [1, 2] ( interpolation = "uniform" )
        float[] primvars:displayOpacity = [0, 0.25, 0.5, 0.75, 1] ( interpolation = "varying" )"""
    found = read(read_curves, tmp_path, curves(text, counts="[2, 3]", start='uniform token type = "linear"'))
    np.testing.assert_array_equal(found.counts, [2, 3])
    np.testing.assert_array_equal(found.positions[:, 1], [0, 0, 1, 2, 3])
    np.testing.assert_array_equal(found.widths, [1, 1, 2, 2, 2])
    np.testing.assert_array_equal(found.opacities, [0, 0.25, 0.5, 0.75, 1])
    assert found.colours is None


@needs_usd
@pytest.mark.parametrize(
    ("basis", "wrap", "begin", "end"),
    [
        ("bezier", "nonperiodic", 0, 3),
        ("bspline", "nonperiodic", 1, 2),
        ("catmullRom", "nonperiodic", 1, 2),
        ("bspline", "pinned", 0, 3),
        ("catmullRom", "pinned", 0, 3),
    ],
)
def test_cubic_curves(tmp_path, basis, wrap, begin, end):
    start = f'uniform token basis = "{basis}"\n uniform token wrap = "{wrap}"'
    widths = 'float[] widths = [1, 2, 3, 4] ( interpolation = "vertex" )'
    found = read(read_curves, tmp_path, curves(f"{ROW}\n {widths}", start=start))
    # Evenly spaced on a line, and so are their values.
    x = np.linspace(begin, end, (end - begin if basis != "bezier" else 1) * SEGMENTS + 1)
    np.testing.assert_allclose(found.positions[:, 0], x, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.widths, x + 1, rtol=0, atol=1e-6)
    assert found.counts.tolist() == [len(x)]


@needs_usd
def test_values_of_cubic_curves_stay_within_those_of_the_file(tmp_path):
    start = 'uniform token basis = "catmullRom"'
    widths = 'float[] widths = [4, 0, 0, 1] ( interpolation = "vertex" )'
    assert read(read_curves, tmp_path, curves(f"{ROW}\n {widths}", start=start)).widths.min() == 0


@needs_usd
def test_varying_values_of_cubic_curves(tmp_path):
    start = 'uniform token basis = "bspline"'
    widths = 'float[] widths = [1, 2] ( interpolation = "varying" )'
    found = read(read_curves, tmp_path, curves(f"{ROW}\n {widths}", start=start))
    np.testing.assert_allclose(found.widths, np.linspace(1, 2, SEGMENTS + 1), rtol=1e-6)


TWO = "point3f[] points = [(0, 0, 0), (1, 0, 0)]"


IMPOSSIBLE_POINTS = {
    "text": ("solid", "not readable as USD"),
    "no prim": ("#usda 1.0\n", "holds no visible prim of type Points with points"),
    "curves": (curves(ROW), "holds no visible prim of type Points"),
    "nan": (points("point3f[] points = [(0, nan, 0)]"), r"points 0 of /p is \[ *0\. +nan +0\.\], not finite"),
    "infinite width": (points(f"{TWO}\n float[] widths = [1, inf]"), "widths 1 of /p is inf, not finite"),
    "negative width": (points(f"{TWO}\n float[] widths = [1, -1]"), "'widths' of point 1 is -1.0"),
    "more widths": (points(f"{TWO}\n float[] widths = [1, 1, 1]"), "/p has 3 widths for 2 points"),
    "words": (points(f"{TWO}\n string[] primvars:widths = ['a', 'b']"), "widths of /p are no numbers"),
    "two colours": (
        points(f"{TWO}\n float2[] primvars:displayColor = [(1, 1)]"),
        "displayColor of /p are not",
    ),
    "references": (
        points(f"{TWO}\n custom float a = 1") + 'def "b" ( references = </p> ) {}',
        "references of /b",
    ),
    "sublayers": (
        '#usda 1.0\n( subLayers = [@b.usda@] )\ndef Points "p" {}',
        "elsewhere .layer b.usda",
    ),
    "payload": ('#usda 1.0\ndef "b" ( payload = @/dev/zero@ ) {}', "payload of /b"),
    "inherits": ('#usda 1.0\ndef "b" ( inherits = </c> ) {}', "inheritPaths of /b"),
    "some have widths": (
        points(f"{TWO}\n float[] widths = [1, 1]") + f'def Points "q" {{\n{TWO}\n}}',
        "only some of its prims have widths; give it to all, or to none",
    ),
}


@needs_usd
@pytest.mark.quick("text", "infinite width", "references")
@pytest.mark.parametrize("name", IMPOSSIBLE_POINTS)
def test_impossible_points(tmp_path, name):
    text, message = IMPOSSIBLE_POINTS[name]
    assert_refused(read_points, tmp_path / "a.usda", text.encode(), message)


IMPOSSIBLE_CURVES = {
    "fewer": (curves(ROW, counts="[3]"), "the curves have 3 points; the file has 4"),
    "2^31": (curves(ROW, counts="[2147483647]"), "curve 0 has 2,147,483,647 points, of 4"),
    "negative": (curves(ROW, counts="[5, -1]"), "curve 0 has 5 points, of 4"),
    "two": (curves(ROW, counts="[2, 2]"), "/c: curve 0 has 2 points, which no nonperiodic bezier curve has"),
    "none": (curves(ROW, counts="[]"), "the curves have 0 points; the file has 4"),
    "unknown basis": (
        curves(ROW, start='uniform token basis = "hermite"'),
        "'hermite', 'nonperiodic'",
    ),
    "unknown type": (
        curves(ROW, start='uniform token type = "wavy"'),
        "'wavy', 'nonperiodic'",
    ),
    "fewer widths": (curves(f"{ROW}\n float[] widths = [1, 1, 1]"), "/c has 3 widths for 4 points"),
    "more span ends": (
        curves(f'{ROW}\n float[] widths = [1, 1, 1] ( interpolation = "varying" )'),
        "/c has 3 widths for 2 points",
    ),
}


@needs_usd
@pytest.mark.quick("2^31", "two")
@pytest.mark.parametrize("name", IMPOSSIBLE_CURVES)
def test_impossible_curves(tmp_path, name):
    text, message = IMPOSSIBLE_CURVES[name]
    assert_refused(read_curves, tmp_path / "a.usda", text.encode(), message)


def binary(folder):
    from pxr import Sdf  # noqa: PLC0415 - where it is installed

    path = folder / "b.usdc"
    assert Sdf.Layer.FindOrOpen(str(written(folder, POINTS))).Export(str(path))
    return path.read_bytes()


@needs_usd
@pytest.mark.slow
@pytest.mark.parametrize("extension", [".usda", ".usdc"])
def test_damaged(tmp_path, extension):
    data = POINTS.encode() if extension == ".usda" else binary(tmp_path)
    copies = truncated(data, every=len(data) // 10) + with_other_bytes(data, count=30)
    assert_read_or_refused(read_points, tmp_path / f"c{extension}", copies)


@needs_usd
def test_a_damaged_file(tmp_path):
    data = binary(tmp_path)
    assert_refused(read_points, tmp_path / "c.usdc", data[: len(data) // 2], "not readable as USD")


def test_without_usd_core(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    path = written(tmp_path, POINTS)
    for reader in (read_points, read_curves):
        with pytest.raises(VolumeError, match=r"a\.usda: .* needs usd-core: pip install 'tfm_cl\[usd\]'"):
            reader(path)


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system may not limit memory")
def test_the_worker_gets_no_more_memory():
    script = "from tfm_cl.files.usd_worker import limit_memory; limit_memory(1 << 30); "
    for size, code in ((1 << 20, 0), (1 << 31, 1)):
        command = [sys.executable, "-c", f"{script} bytearray({size})"]
        done = subprocess.run(command, check=False, capture_output=True, cwd=ROOT)
        assert done.returncode == code
        assert (b"MemoryError" in done.stderr) == bool(code)


WORKERS = {
    "import os; os.abort()": "damaged: usd-core failed on it",
    "pass": "damaged: usd-core failed on it",
    "import time; time.sleep(60)": "not read within 1 s; it may be damaged",
    "bytearray(1 << 40)": "damaged: usd-core failed on it",
}


@pytest.mark.parametrize("script", WORKERS)
def test_a_worker_that_fails(tmp_path, monkeypatch, script):
    """Whatever happens there, it is a line here."""
    monkeypatch.setattr(usd, "LEAST_TIME", 1.0)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: True)
    monkeypatch.setattr(usd, "_command", lambda *_: [sys.executable, "-c", script])
    assert_refused(read_points, tmp_path / "a.usda", POINTS.encode(), WORKERS[script])
