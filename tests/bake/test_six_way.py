"""Six-way light maps: what is in which channel and where, and closed forms."""

import json
from types import SimpleNamespace

import numpy as np
import PIL.Image
import pytest
from scenes import make_scene
from tolerances import FLOAT32

import tfm_cl as tfm
from tfm_cl.bake import six_way
from tfm_cl.bake.six_way import SIDES, SixWayBake
from tfm_cl.cli import main
from tfm_cl.errors import ImageError, InputError, SceneError
from tfm_cl.files.image_io import load_image

STORED = 4 * FLOAT32
"""Products and quotients of a few numbers below 1."""
CODE = 0.5 / 255 + 1e-6
"""Half a code of 8 bits."""
MARCHED = 2e-3
"""Of some hundred steps through a box of constant density, along rays that are parallel to 1 in 256."""

LIGHTS = {name: 0.01 * (number + 1) for number, name in enumerate(SIDES)}
OPACITY, GLOW = 0.8, 0.5


class Fake:
    """Lights add what `LIGHTS` says, times the body's density, to the left half of a picture."""

    def __init__(self):
        self.scenes, self.asked = [], []

    def render(self, scene, *, aovs, samples):
        self.scenes.append(scene)
        self.asked.append((aovs, samples, [light.name for light in scene.lights]))
        width, height = scene.camera.res
        left = np.arange(width) < width // 2
        whole = np.broadcast_to(left[:, None], (height, width, 3)).astype(np.float32)
        density = scene.bodies[0].density_scale
        layers = {f"light.{light.name}": whole * density * LIGHTS[light.name] for light in scene.lights}
        layers["transmittance"] = 1 - OPACITY * whole
        if scene.medium.orders > 1:
            layers["orders"] = whole * 0.001
        if scene.emits:
            layers["emission"] = GLOW * density * whole
        return SimpleNamespace(aovs=layers)


def silent(_stage, _part):
    """Tell nobody."""


def frame(density=1.0, **changes):
    """Make a frame that is as dense."""
    scene = make_scene(**changes)
    return lambda: scene.replace(volume=scene.volume.with_density_scale(density))


def baked(tmp_path, frames=None, name="smoke.exr", **options):
    """Return sheets, the renderer and the files written."""
    renderer, out, frames = Fake(), tmp_path / name, frames or [frame()]
    bake = SixWayBake(**{"tile": 8} | options)
    bake.check(out)
    assert not list(tmp_path.iterdir())
    written = bake.bake_frames(renderer, frames, out, silent)
    assert written == [
        tmp_path / f"smoke_positive{out.suffix}",
        tmp_path / f"smoke_negative{out.suffix}",
        tmp_path / "smoke.json",
    ]
    assert sorted(written) == sorted(tmp_path.iterdir())
    return (*(load_image(path) if out.suffix != ".tga" else path for path in written[:2]), renderer, written)


def test_channels_are_those_of_unity(tmp_path):
    positive, negative, renderer, _ = baked(tmp_path, alpha="premultiplied", gain=2.0)
    assert positive.shape == negative.shape == (8, 8, 4)
    right, top, back, left, bottom, front = LIGHTS.values()
    np.testing.assert_allclose(positive[3, 0], [2 * right, 2 * top, 2 * back, OPACITY], atol=STORED)
    np.testing.assert_allclose(negative[3, 0], [2 * left, 2 * bottom, 2 * front, 0], atol=STORED)
    assert not positive[:, 4:].any()
    assert renderer.asked == [(("lights",), 4, list(SIDES))]  # one march of the camera serves all six
    (scene,) = renderer.scenes
    for light in scene.lights:
        towards = np.asarray(light.from_) - light.to
        np.testing.assert_allclose(towards, SIDES[light.name], atol=1e-12)
    np.testing.assert_allclose(scene.camera.world_from_camera[:3, :3], np.diag([1, 1, -1]), atol=1e-9)
    assert not scene.solids
    assert scene.camera.res == (8, 8)


def test_frames_fill_a_sheet_row_by_row(tmp_path):
    frames = [frame(density) for density in (1.0, 2.0, 3.0, 4.0, 5.0)]
    positive, negative, renderer, written = baked(tmp_path, frames, alpha="straight")
    assert positive.shape == (16, 24, 4)
    facts = json.loads(written[2].read_text())
    assert (facts["columns"], facts["rows"], facts["frames"], facts["tile"]) == (3, 2, 5, 8)
    # The largest of all is 1, of the last frame's light from the front.
    assert facts["gain"] == pytest.approx(OPACITY / (5 * LIGHTS["front"]))
    for number in range(6):
        row, column = divmod(number, 3)
        at = 8 * row + 3, 8 * column
        expected = 0.0 if number == 5 else (number + 1) / 5
        assert negative[at][2] == pytest.approx(expected, abs=STORED)
        assert positive[at][3] == pytest.approx(0.0 if number == 5 else OPACITY)
    # All have the same camera.
    assert len({scene.camera for scene in renderer.scenes}) == 1


def test_sheets_of_powers_of_two(tmp_path):
    frames = [frame()] * 5
    positive, *_ = baked(tmp_path, frames, power_of_two=True)
    assert positive.shape == (16, 32, 4)
    for path in tmp_path.iterdir():
        path.unlink()
    positive, *_ = baked(tmp_path, frames, columns=5)
    assert positive.shape == (8, 40, 4)


def test_what_glows_is_in_the_last_channel(tmp_path):
    medium = make_scene().medium.replace(emission=1.0)
    frames = [frame(density, medium=medium) for density in (1.0, 4.0)]
    _, negative, _, written = baked(tmp_path, frames)
    assert negative[0, 0, 3] == pytest.approx(0.25)
    assert negative[0, 8, 3] == pytest.approx(1.0)
    assert json.loads(written[2].read_text())["emission_gain"] == pytest.approx(1 / (4 * GLOW))


def test_later_orders_are_found_for_each_light(tmp_path):
    medium = make_scene().medium.replace(orders=3)
    positive, _, renderer, _ = baked(tmp_path, [frame(medium=medium)], alpha="premultiplied", gain=1.0)
    assert [names for _, _, names in renderer.asked] == [[name] for name in SIDES]
    assert positive[0, 0, 0] == pytest.approx(LIGHTS["right"] + 0.001)


@pytest.mark.parametrize(("name", "bits"), [("smoke.png", 8), ("smoke.png", 16), ("smoke.tga", 8)])
def test_codes_are_the_numbers_themselves(tmp_path, name, bits):
    *sheets, _, _ = baked(tmp_path, name=name, bits=bits, gain=1.0)
    del sheets
    path = tmp_path / name.replace(".", "_positive.")
    with PIL.Image.open(path) as picture:
        assert "srgb" not in picture.info
        codes = np.asarray(picture)
    assert codes.shape == (8, 8, 4)
    expected = np.array([*[LIGHTS[side] / OPACITY for side in ("right", "top", "back")], OPACITY])
    assert np.abs(codes[0, 0] / 255 - expected).max() < (
        CODE if bits == 8 else 2 * CODE
    )  # Pillow cuts 16 bits


def test_other_fronts_and_ups(tmp_path):
    z_up = make_scene().camera.replace(up=(0, 0, 1), from_=(3, 3, 1))
    *_, renderer, written = baked(tmp_path, [frame(camera=z_up)])
    facts = json.loads(written[2].read_text())
    np.testing.assert_allclose(facts["front"], [0, -1, 0], atol=1e-12)
    np.testing.assert_allclose(facts["up"], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(facts["right"], [1, 0, 0], atol=1e-12)
    camera = renderer.scenes[0].camera
    low, high = make_scene().occupied_bounds
    assert facts["width"] > (high - low)[[0, 2]].max()
    np.testing.assert_allclose(camera.to, (low + high) / 2, atol=1e-9)


def test_what_makes_no_sheet_is_refused(tmp_path, monkeypatch):
    def message(error, **options):
        with pytest.raises(error) as caught:
            baked(tmp_path, **options)
        assert not list(tmp_path.iterdir())
        return str(caught.value)

    assert "known: .exr .png .tga" in message(ImageError, name="smoke.jpg")
    assert "tile = 24: should be a power of two" in message(SceneError, power_of_two=True, tile=24)
    assert "gain = -1" in message(SceneError, gain=-1.0)
    assert "not along up" in message(SceneError, front=(0, 2, 0))
    assert "make a sheet of 16400×8; the limit is 16384" in message(SceneError, columns=2050)
    fog = make_scene(volume=tfm.EverywhereVolume(density=1), lights=[])
    assert "everywhere" in message(SceneError, frames=[lambda: fog])
    monkeypatch.setattr(
        six_way, "write_channels", lambda *_, **__: (_ for _ in ()).throw(OSError(28, "full"))
    )
    assert "full" in message(InputError)


@pytest.mark.slow
def test_box_lit_from_front_and_back(tmp_path, renderer):
    medium = tfm.Medium(sigma_s=0.8, sigma_a=0.2, phase=tfm.Isotropic())
    box = tfm.BoxVolume(from_=(-1, -1, -0.5), to=(1, 1, 0.5), density=1.5)
    bake = SixWayBake(tile=16, gain=1.0, alpha="premultiplied")
    scene = make_scene(volume=box, medium=medium, march=tfm.MarchSettings(steps=300))
    bake.bake(renderer, scene, tmp_path / "box.exr", silent)
    positive, negative = (load_image(tmp_path / f"box_{side}.exr") for side in ("positive", "negative"))
    depth, part = 1.5, 0.8 / (4 * np.pi)
    middle = 8, 8
    assert positive[middle][3] == pytest.approx(1 - np.exp(-depth), rel=MARCHED)
    assert negative[middle][2] == pytest.approx(part * (1 - np.exp(-2 * depth)) / 2, rel=MARCHED)
    assert positive[middle][2] == pytest.approx(part * depth * np.exp(-depth), rel=MARCHED)
    # From the right: the right is brighter, and the left is its mirror image.
    assert positive[8, 13, 0] > 3 * positive[8, 2, 0] > 0
    np.testing.assert_allclose(positive[..., 0], negative[:, ::-1, 0], atol=MARCHED * part)
    np.testing.assert_allclose(positive[..., 1], negative[::-1, :, 1], atol=MARCHED * part)
    assert positive[2, 8, 1] > positive[13, 8, 1]


@pytest.mark.slow
def test_command_line_takes_a_sequence(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    density = make_scene().volume.data
    for number, scale in ((2, 1.0), (10, 0.1)):
        np.savez(f"smoke{number}.npz", density=scale * density, voxel_size=0.1)
    flags = ("-o", "sheet.png", "--what", "six-way", "--tile", "16", "--pixel-samples", "1", "--bits", "8")
    assert main(["bake", "smoke10.npz", "smoke2.npz", *flags]) == 0
    told = capsys.readouterr()
    assert "chosen for all 2: --density-scale" in told.err
    assert told.out.split() == ["sheet_positive.png", "sheet_negative.png", "sheet.json"]
    opacity = np.asarray(PIL.Image.open("sheet_positive.png"))[..., 3]
    assert opacity.shape == (16, 32)
    # Scaled alike, the second, which is number 10, is the thinner.
    assert 0 < opacity[:, 16:].max() < 0.8 * opacity[:, :16].max()
    for arguments, message in (
        (("smoke2.npz", "smoke10.npz", "-o", "maps", "--what", "map"), "takes one INPUT; got 2"),
        (("smoke2.npz", *flags, "--camera-from", "1,2,3"), "camera.from: makes no difference"),
        (("smoke2.npz", *flags, "--quantity", "light"), "is an option of --what light-grid"),
        (("smoke2.npz", *flags, "--bits", "12"), "'12' is not one of '8', '16'"),
        (("smoke2.npz", *flags, "--gain", "lots"), "bake.gain = 'lots'"),
    ):
        assert main(["bake", *arguments]) == 2
        assert message in capsys.readouterr().err
