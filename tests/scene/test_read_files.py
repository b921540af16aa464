"""All files are read before the device is touched, and only then."""

import numpy as np
import PIL.Image
import pytest
import trimesh

import tfm_cl as tfm
from tfm_cl.errors import SceneError
from tfm_cl.files import texture

BOX = tfm.BoxVolume()
CAMERA = tfm.Camera(from_=(0, 0, 6), to=(0, 0, 0), res=(8, 6))


def scene_with(**parts):
    return tfm.Scene(BOX, camera=CAMERA, **{"lights": [], **parts})


@pytest.fixture
def image(tmp_path):
    path = tmp_path / "slide.png"
    PIL.Image.new("RGB", (4, 4), (255, 128, 0)).save(path)
    return path


def spot(path, **changes):
    return tfm.SpotLight(**{"from_": (0, 0, 5), "to": (0, 0, 0), "texture": str(path)} | changes)


@pytest.mark.parametrize(
    "parts",
    [
        {"solids": [tfm.MeshSolid(mesh="missing.ply")]},
        {"lights": [spot("missing.png")]},
        {"lights": [tfm.EnvironmentLight(texture="missing.png")]},
        {"medium": tfm.Medium(phase="table:missing.txt")},
    ],
    ids=["mesh", "texture", "environment", "phase function"],
)
def test_what_cannot_be_read_is_told(parts, renderer):
    scene = scene_with(**parts)
    for use in (scene.read_files, lambda: renderer.render(scene), lambda: renderer.build_maps(scene)):
        with pytest.raises(SceneError, match="missing"):
            use()


def test_a_scene_without_files_reads_nothing():
    assert scene_with(solids=[tfm.SphereSolid()], lights=[spot("")]).read_files() is None


def test_the_mesh_may_be_gone_afterwards(tmp_path):
    path = tmp_path / "box.ply"
    trimesh.creation.box().export(path)
    solid = tfm.MeshSolid(mesh=str(path))
    scene_with(solids=[solid]).read_files()
    path.unlink()
    assert len(solid.load().faces) == 12


def test_images_are_read_once_however_many(tmp_path, image, monkeypatch):
    """More than the few that are kept without a scene."""
    paths = [tmp_path / f"{i}.png" for i in range(texture.KEPT + 3)]
    for path in paths:
        path.write_bytes(image.read_bytes())
    scene = scene_with(lights=[spot(path, radius=0.1, samples=2) for path in paths])
    scene.read_files()
    monkeypatch.setattr(texture, "load_image", lambda path: pytest.fail(f"{path} is read again"))
    for light in scene.lights:
        for part in (light, *light.parts()):
            assert part.texture_image().shape == (4, 4, 3)


def test_what_was_read_changes_no_comparison(image):
    one, other = spot(image), spot(image)
    one.read_files()
    assert one == other
    other.read_files()
    assert one == other
    assert one.fitted(BOX.bounds).texture_image() is one.texture_image()
    np.testing.assert_array_equal(one.replace(intensity=2).texture_image(), one.texture_image())


def test_nothing_is_held_once_the_scene_is_gone(tmp_path, image):
    paths = [tmp_path / f"{i}.png" for i in range(texture.KEPT + 1)]
    for path in paths:
        path.write_bytes(image.read_bytes())
    scene = scene_with(lights=[spot(path) for path in paths])
    scene.read_files()
    assert sum(key[0] in set(map(str, paths)) for key in texture._held) == len(paths)
    del scene
    assert sum(key[0] in set(map(str, paths)) for key in texture._held) <= texture.KEPT
