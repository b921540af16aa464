"""A scene file at a frame: keyframes and files of frames, evaluated before the models."""

import numpy as np
import pytest

from tfm_cl.errors import SceneError
from tfm_cl.scene.scene_file import SceneFile
from tfm_cl.sequence.shot import Shot

TEXT = """
[volume]
file = "smoke.####.npy"
[camera]
from = [{ frame = 1, value = [0, 0, 9] }, { frame = 3, value = [2, 0, 9] }]
to = [0, 0, 0]
fov = 30
[[light]]
type = "sun"
from = [0, 9, 0]
to = [0, 0, 0]
intensity = [{ frame = 1, value = 1 }, { frame = 3, value = 2 }]
"""


@pytest.fixture
def shot(tmp_path):
    """A scene file of three frames, which can be said more of; frame n has the density n everywhere."""
    for frame in (1, 2, 3):
        np.save(tmp_path / f"smoke.{frame:04d}.npy", np.full((3, 3, 3), frame, np.float32))

    def written(old="", new=""):
        (tmp_path / "shot.toml").write_text(TEXT.replace(old, new) if old else TEXT)
        return tmp_path / "shot.toml"

    return written


def density(path, frame, *overrides):
    return float(Shot(path, overrides).scene(frame).bodies[0].data.max())


def test_a_frame_has_its_values_and_its_file(shot):
    scene = Shot(shot()).scene(2)

    assert scene.camera.from_ == (1, 0, 9)
    assert scene.lights[0].intensity == (1.5, 1.5, 1.5)
    assert scene.bodies[0].data.max() == 2


def test_between_frames_files_are_of_the_frame_before(shot):
    scene = Shot(shot()).scene(2.5)

    assert scene.camera.from_ == (1.5, 0, 9)
    assert scene.bodies[0].data.max() == 2


def test_it_says_what_changes(shot):
    file = SceneFile.read(shot(), frame=1)

    assert file.is_animated
    assert set(file.changing) == {("volume", "file"), ("camera", "from"), ("light", 0, "intensity")}
    assert not SceneFile.read(shot("smoke.####.npy", "smoke.0001.npy"), STILL).is_animated


STILL = [("camera.from", [0, 0, 9]), ("light.0.intensity", 1)]


def test_overrides_may_be_keyframes(shot):
    fov = [{"frame": 1, "value": 20}, {"frame": 9, "value": 40}]

    assert Shot(shot(), [("camera.fov", fov)]).scene(3).camera.fov == 25


def test_a_light_that_is_placed_may_change(shot):
    path = shot()
    path.write_text(TEXT[: TEXT.index("[[light]]")])
    cone = [{"frame": 1, "value": 20}, {"frame": 3, "value": 30}]

    scene = Shot(path, [("light.cone", cone)]).scene(2)

    assert scene.lights[0].cone == 25
    with pytest.raises(SceneError, match=r"light.cone: keyframe 1 has no frame"):
        Shot(path, [("light.cone", [{"value": 1}])]).scene(2)


def test_without_a_frame_it_is_refused_in_a_line_that_says_where(shot):
    with pytest.raises(SceneError) as error:
        SceneFile.read(shot())

    assert str(error.value).endswith(
        "shot.toml:5: camera.from: changes from frame to frame; say of which: --frame 1, or --frames 1-24"
    )


@pytest.mark.parametrize(
    ("said", "frame", "found"),
    [
        ("frame_offset = -10", 12, 2),
        ("frame_offset = 1", 1, 2),
        ("frame_step = 0.5", 5, 2),
        ("frame_step = 2\nframe_offset = -1", 2, 3),
        ("frame_step = -1\nframe_offset = 4", 1, 3),
        ('before = "hold"', -7, 1),
        ('after = "hold"', 9, 3),
    ],
)
def test_files_may_be_of_other_frames(shot, said, frame, found):
    assert density(shot('npy"', f'npy"\n{said}'), frame) == found


@pytest.mark.parametrize("frame", [0, 4])
def test_a_body_may_be_there_for_some_frames_alone(shot, frame):
    path = shot('npy"', 'npy"\nbefore = "empty"\nafter = "empty"')
    scene = Shot(path).scene(frame)

    assert [body.largest_density.max() for body in scene.bodies] == [0]
    assert SceneFile.read(path, frame=frame).is_empty


def test_of_several_bodies_one_may_be_empty(shot):
    two = '[[volume]]\nfile = "smoke.####.npy"\nafter = "empty"\n[[volume]]\nshape = "sphere"\n'
    scene = Shot(shot('[volume]\nfile = "smoke.####.npy"\n', two)).scene(9)

    assert [body.label for body in scene.bodies] == ["box", "sphere"]


def test_a_missing_file_is_told_by_frame_pattern_and_what_is_there(shot):
    path = shot()
    (path.parent / "smoke.0002.npy").unlink()

    for frame, hint in ((2, ""), (4, '; after = "hold" would keep 3'), (0, '; before = "hold" would keep 1')):
        with pytest.raises(SceneError) as error:
            Shot(path).scene(frame)
        assert str(error.value) == (
            f"{path}:3: volume.file: frame {frame}: there is no smoke.000{frame}.npy; "
            f"of smoke.####.npy there are 1,3{hint}"
        )


def test_no_file_at_all_is_told(shot):
    with pytest.raises(
        SceneError, match=r"frame 1: there is no dust.0001.npy, nor any other of dust.####.npy$"
    ):
        Shot(shot("smoke.", "dust.")).scene(1)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "smoke.####.npy",
            'smoke.0001.npy"\nafter = "hold',
            "shot.toml:4: volume.after: is for files that change",
        ),
        (
            'npy"',
            'npy"\nafter = "stay"',
            "shot.toml:4: volume.after = 'stay': should be 'hold', 'empty' or 'error'",
        ),
        ('npy"', 'npy"\nframe_offset = 0.5', "shot.toml:4: volume.frame_offset = 0.5"),
        (
            "fov = 30",
            "fov = [{ frame = 1, value = 2 }, { value = 3 }]",
            "shot.toml:7: camera.fov: keyframe 2 has no frame",
        ),
        (
            "fov = 30",
            "fov = [{ frame = 1, value = 300 }]",
            "shot.toml:7: camera.fov = 300: should be less than 180",
        ),
    ],
)
def test_what_is_wrong_is_told_with_its_line(shot, old, new, said):
    with pytest.raises(SceneError) as error:
        Shot(shot(old, new)).scene(1)

    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_textures_and_meshes_have_frames_too(shot):
    light = 'type = "spot"\ntexture = "gobo.##.png"\nafter = "hold"'
    path = shot('type = "sun"', light)
    (path.parent / "gobo.01.png").touch()
    with path.open("a") as stream:
        stream.write('[[solid]]\nmesh = "rock.%d.ply"\nafter = "empty"\n[[solid]]\nshape = "sphere"\n')
    (path.parent / "rock.1.ply").touch()

    first, third = (SceneFile.read(path, frame=frame) for frame in (1, 3))

    assert [file.light[0].texture for file in (first, third)] == [str(path.parent / "gobo.01.png")] * 2
    assert [len(file.solids) for file in (first, third)] == [2, 1]


def test_an_image_is_never_empty(shot):
    path = shot('type = "sun"', 'type = "spot"\ntexture = "gobo.##.png"\nafter = "empty"')
    (path.parent / "gobo.01.png").touch()

    with pytest.raises(SceneError, match=r'shot.toml:10: light.0.texture: "empty" is for volumes and meshes'):
        SceneFile.read(path, frame=2)


def test_a_pattern_of_volumes_needs_no_scene_file(shot):
    pattern = shot().parent / "smoke.####.npy"

    assert Shot(pattern).scene(2).bodies[0].data.max() == 2
    assert density(pattern, 9, ("volume.after", "hold")) == 3
    assert density(pattern, 1, ("volume.frame_offset", 1)) == 2
    with pytest.raises(SceneError, match=r"^volume.frame_offset = 'a': should be a valid integer$"):
        density(pattern, 1, ("volume.frame_offset", "a"))
    with pytest.raises(SceneError, match="no such file; as a pattern of files it needs a frame"):
        Shot(pattern).scene()


def test_scenes_may_have_a_file_for_each_frame(shot):
    path = shot("smoke.####.npy", "smoke.0003.npy")
    path.rename(path.with_name("shot.7.toml"))

    assert density(path.with_name("shot.%d.toml"), 7) == 3


@pytest.mark.parametrize(
    ("old", "new", "frame", "ahead"),
    [
        ("", '[medium]\nphase = { type = "table", file = "p.####.txt" }\n', 2, 2),
        ("", '[medium]\nphase = "table:p.####.txt"\n', 1, 1),
        ("", '[medium.phase]\ntype = "table"\nfile = "p.%d.txt"\nframe_offset = 5\nafter = "hold"\n', 2, 3),
        ("[camera]", '[volume.medium.phase]\ntype = "table"\nfile = "p.####.txt"\n[camera]', 3, 3),
    ],
)
def test_a_table_of_a_phase_function_may_be_of_each_frame(shot, old, new, frame, ahead):
    path = shot(old or "[camera]", new if old else new + "[camera]")
    for number in (1, 2, 3):
        for name in (f"p.{number:04d}.txt", f"p.{number}.txt"):
            (path.parent / name).write_text(f"-1 1\n1 {number}\n")
    scene = Shot(path).scene(frame)
    phase = scene.medium_of(scene.bodies[0]).phase
    assert phase.evaluate(1) / phase.evaluate(-1) == pytest.approx(ahead)
    assert any(
        changing.key[-2:] == ("phase", "file") or changing.key[-1] == "phase"
        for changing in SceneFile.read(path, frame=frame).patterns
    )


def test_a_table_that_is_not_there_is_told(shot):
    path = shot("[camera]", '[medium]\nphase = { type = "table", file = "p.####.txt" }\n[camera]')
    with pytest.raises(SceneError, match=r"medium\.phase\.file: frame 2: there is no p\.0002\.txt"):
        Shot(path).scene(2)
    (path.parent / "p.0001.txt").write_text("-1 1\n1 1\n")
    path.write_text(path.read_text().replace('txt" }', 'txt", after = "empty" }'))
    with pytest.raises(SceneError, match='"empty" is for volumes and meshes; other files are held'):
        Shot(path).scene(2)


def test_frames_of_one_table_are_refused(shot):
    path = shot("[camera]", '[medium]\nphase = { type = "table", file = "p.txt", after = "hold" }\n[camera]')
    with pytest.raises(SceneError, match=r"phase\.after: is for files that change from frame to frame"):
        SceneFile.read(path, frame=1)


def test_whole_numbers_between_keyframes_say_how_to_stay_whole(shot):
    path = shot("[camera]", "[map]\nres = [{ frame = 1, value = 64 }, { frame = 4, value = 96 }]\n[camera]")
    assert SceneFile.read(path, frame=4, overrides=[("volume.after", "hold")]).map.res == 96
    with pytest.raises(SceneError) as error:
        SceneFile.read(path, frame=2)
    assert str(error.value) == (
        f"{path}:5: map.res = 74.66666666666667: should be a whole number from 1 to 8192, or 'auto'; "
        'it is between two keyframes, which interpolation = "step" keeps apart'
    )
    blur = [{"frame": 1, "value": -2}, {"frame": 4, "value": -1}]
    with pytest.raises(SceneError, match=r"should be greater than or equal to 0$"):
        SceneFile.read(path, [("map.res", 64), ("map.blur", blur)], frame=2)


def test_frames_that_a_scene_tells_of(shot, tmp_path):
    """Files 1 to 3, keyframes 1 to 3."""
    path = shot()
    assert Shot(path).frames() == (1, 3)
    assert Shot(path, [("camera.fov", [{"frame": 7, "value": 20}])]).frames() == (1, 7)
    assert Shot(path, turntable=9).frames() == (1, 9)
    keyed = shot("fov = 30", "fov = [{ frame = 0.5, value = 1 }, { frame = -2, value = 1 }]")
    assert Shot(keyed).frames() == (-2, 3)
    assert Shot(tmp_path / "smoke.####.npy").frames() == (1, 3)
    assert Shot(tmp_path / "smoke.0001.npy").frames() is None
    assert Shot(tmp_path / "other.####.npy").frames() is None


@pytest.mark.parametrize(
    ("said", "frames"),
    [("frame_step = 0.5", (2, 7)), ("frame_step = -1", (-3, -1)), ("frame_offset = 100", (-99, -97))],
)
def test_frames_of_files_numbered_otherwise(tmp_path, shot, said, frames):
    shot()
    (tmp_path / "plain.toml").write_text(f'[volume]\nfile = "smoke.####.npy"\n{said}\n')

    found = Shot(tmp_path / "plain.toml").frames()

    assert found == frames
    for frame in frames:
        assert Shot(tmp_path / "plain.toml").scene(frame)
