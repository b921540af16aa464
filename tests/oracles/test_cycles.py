"""Blender's Cycles as a second witness: light of media that glow, and the decoder in Open Shading Language.

Cycles is Blender as a Python module, of about a gigabyte, so it lives in an environment of its own:
``make oracles`` makes ``.venv-cycles``; ``TFM_CYCLES_PYTHON`` names another.
"""

import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scenes import make_scene
from tolerances import BAKED_IN_CYCLES, CYCLES_EMISSION, CYCLES_ORDERS, CYCLES_ORDERS_RMSE

import tfm_cl as tfm
from tfm_cl.bake.map import MapBake

pytestmark = pytest.mark.slow

REPOSITORY = Path(__file__).resolve().parents[2]
SCRIPT = Path(__file__).with_name("cycles_run.py")
SIGMA_T = 4.0
TEXTURES = ("coefficients", "ranges", "functions")
LIGHTS = (
    tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24),
    tfm.SpotLight(from_=(0.5, 0.5, 0.5), to=(0, 0, 0), cone=70),
    tfm.PointLight(from_=(0.2, 0.1, 0.3)),
    tfm.SunLight(from_=(1, 1, 0.2), to=(0, 0, 0)),
    tfm.PointLight(from_=(1.0, 0.1, 2), reach=2.3),
)
"""Of each projection one, and one that ends."""
PIXELS = 48
CORNER, RIGHT, UP = (np.array(edge) for edge in ((-1.2, -1.1, -0.9), (2.3, 0.0, 0.0), (0.0, 1.38, 1.84)))
"""A plane through the body, world units: a corner, and its edges, which are equally long."""


@pytest.fixture(scope="module")
def cycles(tmp_path_factory):
    """Run ``cycles_run.py`` on a description; returns the picture."""
    python = Path(os.environ.get("TFM_CYCLES_PYTHON") or REPOSITORY / ".venv-cycles" / "bin" / "python")
    found = [str(python), "-c", "import bpy"]
    if not python.is_file() or subprocess.run(found, capture_output=True, check=False).returncode:
        pytest.skip("no Cycles here: make oracles")

    def run(what, described):
        out = tmp_path_factory.mktemp("cycles") / "picture.npy"
        done = subprocess.run(
            [python, SCRIPT, what, out],
            input=json.dumps(described, default=np.ndarray.tolist),
            capture_output=True,
            text=True,
            check=False,
        )
        assert out.is_file(), done.stdout + done.stderr
        return np.load(out)

    return run


def with_defaults(shader, entry, folder):
    """Return the decoder's text with the numbers of a map in place of its defaults."""

    def array(key):
        return "{" + ", ".join(map(repr, entry[key])) + "}"

    def matrix(key):
        return f"matrix({', '.join(map(repr, np.transpose(entry[key]).ravel().tolist()))})"

    values = {key: array(key) for key in ("chart", "cone", "series")}
    values |= {key: matrix(key) for key in ("light_from_world", "unit_from_light")}
    values |= {key: str(float(entry[key])) for key in ("reach",)}
    values |= {key: str(int(entry[key])) for key in ("layers", "rows", "projection", "box")}
    for what in TEXTURES:
        (file,) = entry["files"][what]
        values[what] = json.dumps(str(folder / file))
    for key, value in values.items():
        pattern = rf"(\b{key}(?:\[4\])? = )(\{{[^}}]*\}}|\"\"|[^,)]+)"
        shader, count = re.subn(pattern, lambda found, value=value: found[1] + value, shader, count=1)
        assert count == 1, key
    return shader


@pytest.mark.parametrize("range_", ["auto", "box"])
def test_osl_decodes_what_the_map_evaluates(range_, cycles, renderer, tmp_path):
    scene = make_scene(lights=LIGHTS, map=tfm.MapSettings(basis="klt", range=range_, res=16, steps=24))
    MapBake(formats=["exr"]).bake(renderer, scene, tmp_path, lambda *_: None)
    at = (np.arange(PIXELS) + 0.5) / PIXELS
    points = CORNER + at[None, :, None] * RIGHT + at[:, None, None] * UP
    entries = json.loads((tmp_path / "maps.json").read_text())["maps"]

    for entry, light_map in zip(entries, renderer.build_maps(scene), strict=True):
        shader = tmp_path / "with_numbers.osl"
        shader.write_text(with_defaults((tmp_path / "decode.osl").read_text(), entry, tmp_path))
        plane = {"corner": CORNER, "right": RIGHT, "up": UP, "pixels": PIXELS}
        found = cycles("osl", {"shader": str(shader), "sigma_t": SIGMA_T} | plane)[..., 0]

        expected = light_map.evaluate(points, SIGMA_T)
        assert expected.min() < 0.5  # something is in the way
        np.testing.assert_allclose(found, expected, rtol=0, atol=BAKED_IN_CYCLES)


def matrix_of(camera):
    """Return world from camera as Blender has it, looking along -z."""
    eye = np.array(camera.from_)
    backwards = eye - camera.to
    right = np.cross(camera.up, backwards)
    axes = [axis / np.linalg.norm(axis) for axis in (right, np.cross(backwards, right), backwards)]
    matrix = np.eye(4)
    matrix[:3] = np.stack([*axes, eye], axis=1)
    return matrix


BOX = tfm.BoxVolume(from_=(-0.5, -0.4, -0.6), to=(0.5, 0.4, 0.6))
CAMERA = tfm.Camera(from_=(2.1, 1.4, 2.6), to=(0.1, 0, 0), fov=35, res=(48, 32))
ORDERS, SAMPLES = 24, 4096


def seen_by_cycles(cycles, medium, orders, samples):
    """Return Cycles' picture of the box, with so many orders of scattering."""
    seen = {"matrix": matrix_of(CAMERA), "fov": CAMERA.fov, "res": CAMERA.res}
    inside = {"scatter": medium.sigma_s, "absorption": medium.sigma_a, "emission": medium.emission}
    box = {"low": BOX.from_, "high": BOX.to}
    return cycles("box", box | inside | seen | {"samples": samples, "orders": orders})[..., :3]


def test_a_box_that_glows_and_absorbs(cycles, renderer):
    medium = tfm.Medium(sigma_s=0, sigma_a=(1.2, 0.6, 0.9), emission=(1.5, 0.8, 0.3))

    expected = seen_by_cycles(cycles, medium, 0, 16)

    found = renderer.render(tfm.Scene(BOX, medium, CAMERA, ())).image[..., :3]
    assert expected.max() > 0.5
    assert np.abs(found - expected).mean() <= CYCLES_EMISSION * expected.mean()


def test_a_box_that_glows_and_scatters(cycles, renderer):
    medium = tfm.Medium(
        sigma_s=(1.5, 2.5, 2.0), sigma_a=(1.2, 0.6, 0.9), emission=(1.5, 0.8, 0.3), orders=ORDERS
    )

    expected = seen_by_cycles(cycles, medium, ORDERS, SAMPLES)

    found = renderer.render(tfm.Scene(BOX, medium, CAMERA, ())).image[..., :3]
    once = renderer.render(tfm.Scene(BOX, medium.replace(orders=1), CAMERA, ())).image[..., :3]
    assert once.mean() < 0.8 * expected.mean()  # without what is scattered
    mean, lit = expected.mean(axis=(0, 1)), expected.min(axis=2) > 0
    np.testing.assert_allclose(found.mean(axis=(0, 1)), mean, rtol=CYCLES_ORDERS)
    missed = np.sqrt(np.mean((found - expected)[lit] ** 2))
    assert missed <= CYCLES_ORDERS_RMSE * expected[lit].mean()
