"""Shots at moments between frames: what moves by keyframes, what stays the frame's, and what is read once."""

import pkgutil
import subprocess
import sys

import numpy as np
import pytest

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.files.image_io import load_image
from tfm_cl.scene.settings import ImageSettings
from tfm_cl.sequence import frame as frames
from tfm_cl.sequence.shot import Shot

SHOT = """
[volume]
file = "puff.####.npz"
density_scale = "auto"
translate = [{ frame = 1, value = [0, 0, 0] }, { frame = 3, value = [2, 0, 0] }]
scale = 2

[medium]
sigma_s = [{ frame = 1, value = 1.0 }, { frame = 3, value = 3.0 }]

[camera]
from = [{ frame = 1, value = [0, 0, 8] }, { frame = 3, value = [4, 0, 8] }]
to = [0, 0, 0]
res = [16, 12]

[[light]]
type = "sun"
from = [1, 2, 1]
to = [0, 0, 0]

[[solid]]
shape = "sphere"
centre = [{ frame = 1, value = [0, 0, -3] }, { frame = 3, value = [0, 2, -3] }]
radius = 0.5

[[solid]]
shape = "box"
from = [3, 3, 3]
to = [4, 4, 4]

[map]
res = 32
steps = 16

[march]
steps = 16

[image]
shutter = [-0.5, 0.5]
motion_samples = 3
"""


@pytest.fixture
def folder(tmp_path):
    z, y, x = np.mgrid[-1:1:12j, -1:1:10j, -1:1:14j]
    density = np.clip(1 - np.sqrt(x**2 + y**2 + z**2), 0, 1).astype(np.float32)
    velocity = np.broadcast_to(np.float32((4.8, 0, 0)), (*density.shape, 3))
    for frame in (1, 2, 3):
        np.savez(tmp_path / f"puff.{frame:04d}.npz", density=frame * density, vel=velocity, voxel_size=0.1)
    (tmp_path / "shot.toml").write_text(SHOT)
    return tmp_path


def read(folder, number, *overrides, **shot):
    return frames.read(Shot(folder / "shot.toml", overrides, **shot).scene_file(number), number)


def test_keyframes_go_on_while_files_stay_those_of_the_frame(folder):
    ready = read(folder, 2)
    before = ready.at(-0.5)
    assert before.camera.from_ == (1.0, 0.0, 8.0)
    assert before.solids[0].centre == (0.0, 0.5, -3.0)
    assert before.medium.sigma_s == (1.5,) * 3
    assert before.volume.source.name == "puff.0002.npz"
    assert before.volume.world_from_index[0, 3] == pytest.approx(0.5 + 2 * 0.05)
    assert ready.at(0.0) is ready.scene


def test_what_is_the_same_at_another_moment_is_read_once(folder):
    ready = read(folder, 2)
    other = ready.at(0.25)
    assert other.volume.content == ready.scene.volume.content
    assert other.volume.velocity is ready.scene.volume.velocity
    assert other.volume.density_scale == ready.scene.volume.density_scale
    assert other.solids[1] is ready.scene.solids[1]
    again = Shot(folder / "shot.toml").scene_file(2).moment(0.25).make(tfm.Scene)
    assert again.volume.world_from_index == pytest.approx(other.volume.world_from_index)
    assert again.volume.density_scale == pytest.approx(other.volume.density_scale)
    assert again.camera == other.camera


MOVING = """
translate = [{ frame = 1, value = [0, 0, 0] }, { frame = 3, value = [2, 0, 0] }]
"""
PRIMITIVES = {
    "points": ("points_io.read_points", '[volume]\npoints = "puff.npz"', {"positions": np.eye(3)}),
    "curves": (
        "curves_io.read_curves",
        '[volume]\ncurves = "puff.npz"',
        {"points": np.eye(4, 3), "counts": np.array([2, 2])},
    ),
    "mesh": ("PolygonsSettings._triangles", '[volume]\nmesh = "puff.ply"', None),
}
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
element face 1
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
3 0 1 2
"""


@pytest.mark.parametrize("kind", PRIMITIVES)
def test_primitives_are_read_once_for_all_moments(tmp_path, monkeypatch, kind):
    reader, text, arrays = PRIMITIVES[kind]
    if arrays is None:
        pytest.importorskip("trimesh", reason="pip install 'tfm_cl[solids]'")
        (tmp_path / "puff.ply").write_text(PLY)
    else:
        np.savez(tmp_path / "puff.npz", **arrays)
    (tmp_path / "shot.toml").write_text(text + MOVING)
    reads = []
    module, _, name = f"tfm_cl.scene.bodies.primitive_settings.{reader}".rpartition(".")
    holder = pkgutil.resolve_name(module)
    read_file = getattr(holder, name)
    monkeypatch.setattr(holder, name, lambda *given: reads.append(given) or read_file(*given))
    ready = read(tmp_path, 2)
    moments = [ready.at(after).bodies[0] for after in (-0.5, -0.25, 0.25)]
    assert len(reads) == 2  # for the frame, and once for all other moments
    for body, after in zip(moments, (-0.5, -0.25, 0.25), strict=True):
        assert (body.positions - ready.scene.bodies[0].positions)[:, 0] == pytest.approx(after)
        assert body.chosen == ready.scene.bodies[0].chosen
    assert "stored" not in ready.scene.bodies[0].__getstate__()


def test_meshes_are_read_once_for_all_moments(tmp_path):
    pytest.importorskip("trimesh", reason="pip install 'tfm_cl[solids]'")
    (tmp_path / "puff.ply").write_text(PLY)
    solid = '[volume]\nshape = "box"\n[[solid]]\nmesh = "puff.ply"'
    (tmp_path / "shot.toml").write_text(solid + MOVING)
    ready = read(tmp_path, 2)
    ready.read_files()
    (tmp_path / "puff.ply").unlink()
    moment = ready.at(0.5)
    assert moment.solids[0].load() is ready.scene.solids[0].load()
    assert moment.solids[0].world_vertices()[:, 0] == pytest.approx([1.5, 2.5, 1.5])


def test_what_does_not_change_is_itself(folder):
    text = SHOT.replace("####", "0001")
    for key in ("translate", "from", "sigma_s", "centre"):
        text = "\n".join(line for line in text.splitlines() if not line.startswith(f"{key} = [{{"))
    (folder / "shot.toml").write_text(text.replace("radius = 0.5", "radius = 0.5\ncentre = [0, 0, -3]"))
    ready = read(folder, None)
    assert ready.at(0.25) is ready.scene


def test_a_turntable_turns_on_between_frames(folder):
    ready = read(folder, 1, ("camera.from", [0, 0, 8]), turntable=4)
    assert ready.at(1.0).camera.from_ == pytest.approx((8, 0, 0), abs=1e-9)
    assert ready.at(-1.0).camera.from_ == pytest.approx((-8, 0, 0), abs=1e-9)


class Recorder:
    """A renderer that notes what it is asked for."""

    def __init__(self):
        self.asked = []

    def render(self, _, **asked):
        self.asked.append(("render", asked))
        raise InterruptedError

    def render_blurred(self, _, **asked):
        self.asked.append(("render_blurred", asked))
        raise InterruptedError


@pytest.mark.parametrize(
    ("shutter", "expected"),
    [([-0.5, 0.5], "render_blurred"), ([0, 0], "render"), ([0.5, 0.5], "render_blurred")],
)
def test_a_shutter_that_opens_blurs(folder, shutter, expected):
    ready, recorder = read(folder, 2, ("image.shutter", shutter)), Recorder()
    with pytest.raises(InterruptedError):
        ready.render(recorder, [folder / "a.exr"])
    ((called, asked),) = recorder.asked
    assert called == expected
    assert asked.get("shutter", tuple(shutter)) == tuple(shutter)


def test_deep_images_are_of_one_moment(folder):
    recorder = Recorder()
    with pytest.raises(SceneError, match=r"image\.shutter = \[-0\.5, 0\.5\]: a\.deep\.exr is deep, and its"):
        read(folder, 2).render(recorder, [folder / "a.png", folder / "a.deep.exr"])
    assert recorder.asked == []
    frames.check_blurred(ImageSettings(), [folder / "a.deep.exr"])


def tfm_render(folder, *arguments):
    command = [sys.executable, "-m", "tfm_cl", "render", "shot.toml", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--shutter", "1"], "image.shutter = [1.0]: should be two numbers [open, close] of frames"),
        (["--shutter", "0.5,0"], "image.shutter = [0.5, 0.0]: should be two numbers [open, close]"),
        (["--shutter", "a,b"], "--shutter: 'a,b' is not two numbers with a comma between"),
        (["--motion-samples", "0"], "image.motion_samples = 0"),
        (["--set", "volume.velocity=heat"], "puff.0002.npz: no grid named 'heat'"),
        (["--set", "volume.velocity_scale=1e6"], "moves something by"),
        (["-o", "a.deep.exr"], "a.deep.exr is deep"),
    ],
)
@pytest.mark.slow
def test_what_is_wrong_is_one_line(folder, arguments, line):
    done = tfm_render(folder, "--frame", "2", "-o", "a.exr", *arguments)
    assert done.returncode == 2
    assert line in done.stderr
    assert "Traceback" not in done.stderr
    assert len(done.stderr.strip().splitlines()[-1:]) == 1
    assert not (folder / "a.exr").exists()


@pytest.mark.slow
def test_a_frame_of_a_shot_is_the_mean_of_its_moments(folder, renderer):
    done = tfm_render(folder, "--frame", "2", "-o", "a.exr", "--method", "dual", "--set", "march.cutoff=0")
    assert done.returncode == 0, done.stderr
    ready = read(folder, 2, ("march.method", "dual"), ("march.cutoff", 0.0))
    images = [
        renderer.render_blurred(ready.at(after), (after, after), motion_samples=1).image
        for after in (-1 / 3, 0.0, 1 / 3)
    ]
    found = load_image(folder / "a.exr")
    assert np.abs(found - np.mean(images, axis=0)).max() < 1e-4 * np.max(images)
    assert np.abs(images[0] - images[2]).max() > 0.01 * np.max(images)
