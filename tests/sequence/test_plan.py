"""What is decided once for a range of frames."""

import os
import re

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.errors import InputError, NoDeviceError, VolumeError
from tfm_cl.maps.bases.given import functions_text
from tfm_cl.plan import octaves, surroundings
from tfm_cl.plan.surroundings import lattice_of
from tfm_cl.sequence.claims import Ledger
from tfm_cl.sequence.plan import RangePlan, decide, looked_at, steady
from tfm_cl.sequence.shot import Shot

FRAMES = range(1, 7)
OPEN = """
[volume]
file = "v.####.npy"
density_scale = "auto"
[map]
res = "auto"
steps = "auto"
[march]
steps = "auto"
[medium]
octaves = 4
[[solid]]
shape = "ground"
"""


@pytest.fixture
def volumes(tmp_path):
    """A blob that drifts by two voxels a frame, and grows denser."""
    blob = blobs()
    for frame in FRAMES:
        voxels = np.zeros((32, 16, 20), np.float32)
        first = 2 * frame
        voxels[first : first + blob.shape[0], 1 : 1 + blob.shape[1], 1 : 1 + blob.shape[2]] = blob * frame
        np.save(tmp_path / f"v.{frame:04d}.npy", voxels)
    return tmp_path


@pytest.fixture
def shot(volumes):
    """A scene of these that leaves open what there is."""
    (volumes / "shot.toml").write_text(OPEN)
    return Shot(volumes / "shot.toml")


@pytest.fixture
def ledger(tmp_path):
    with Ledger(tmp_path / ".a.tfm") as ledger:
        yield ledger


def test_looks_at_both_ends_and_between():
    assert looked_at(range(1, 101)) == [1, 26, 51, 75, 100]
    assert looked_at((3, 1)) == [1, 3]
    assert looked_at([7]) == [7]


class TestDecide:
    def test_nothing_is_left_open(self, shot):
        """With what was decided, the frames differ in nothing but their voxels."""
        decided = Shot(shot.path, decided=decide(shot, FRAMES).overrides)
        scenes = [decided.scene(frame) for frame in FRAMES]
        for scene in scenes[1:]:
            for name in ("camera", "lights", "map", "march", "medium", "solids"):
                assert getattr(scene, name) == getattr(scenes[0], name), name
            assert scene.bodies[0].density_scale == scenes[0].bodies[0].density_scale
        assert isinstance(scenes[0].map.res, int)
        assert all(isinstance(getattr(scenes[0].medium, key), float) for key in octaves.KEYS)

    def test_it_serves_the_frame_that_needs_most(self, shot):
        decisions = decide(shot, FRAMES).decisions
        alone = [shot.scene(frame) for frame in FRAMES]
        assert decisions["volume.density_scale"].value == alone[-1].bodies[0].density_scale
        assert "densest" in decisions["volume.density_scale"].why
        low = min(scene.occupied_bounds[0][1] for scene in alone)
        assert decisions["solid.0.height"].value <= low

    def test_all_frames_are_in_the_picture(self, shot):
        decided = Shot(shot.path, decided=decide(shot, FRAMES).overrides)
        for frame in FRAMES:
            scene = decided.scene(frame)
            corners = np.array(np.meshgrid(*scene.occupied_bounds.T)).reshape(3, -1).T
            seen = (corners - np.array(scene.camera.from_)) @ scene.camera.world_from_camera[:3, :3]
            width, height = scene.camera.res
            across = np.abs(seen[:, :2] / -seen[:, 2:]) / np.tan(np.radians(scene.camera.fov) / 2)
            assert (across <= [1.001 * width / height, 1.001]).all(), frame  # placed to four digits

    def test_what_is_given_and_what_has_keyframes_stays(self, tmp_path, shot):
        keyframes = "[{ frame = 1, value = 64 }, { frame = 6, value = 96 }]"
        text = OPEN.replace('res = "auto"', f"res = {keyframes}").replace('"auto"\n[map]', "1.0\n[map]")
        (tmp_path / "shot.toml").write_text(text)
        decided = decide(shot, FRAMES)
        assert not {"map.res", "volume.density_scale"} & decided.decisions.keys()
        assert Shot(shot.path, decided=decided.overrides).scene(6).map.res == 96

    def test_frames_that_cannot_be_read_are_left_out(self, tmp_path, shot):
        (tmp_path / "v.0001.npy").unlink()
        (tmp_path / "v.0003.npy").write_bytes(b"")
        assert decide(shot, FRAMES).looked_at == (2, 5, 6)

    def test_none_that_can_be_read_is_refused(self, tmp_path, shot):
        for path in tmp_path.glob("v.*.npy"):
            path.write_bytes(b"")
        with pytest.raises(VolumeError, match=r"v\.0001\.npy"):
            decide(shot, FRAMES)

    def test_a_bare_file_keeps_its_look(self, volumes, monkeypatch):
        """What is decided is not taken for what the user gave, which would undo parts of a look."""
        monkeypatch.setattr(surroundings, "TOLERATED", 0.1)
        bare = Shot(volumes / "v.####.npy", look="smoke")
        decided = Shot(bare.path, look="smoke", decided=decide(bare, FRAMES).overrides)
        one, other = bare.scene_file(3), decided.scene_file(3)
        assert other.medium.replace(**dict.fromkeys(octaves.KEYS, "auto")) == one.medium
        assert other.image == one.image
        assert [light.type for light in other.light] == [light.type for light in one.light]
        # Maps of a size that was decided are none that was asked for.
        assert len({decided.scene(frame).lights for frame in FRAMES}) == 1
        assert decided.scene(3).lights[0].lookup == "points"

    def test_points_of_a_sky_stay_as_far_apart_as_in_the_densest(self, tmp_path, shot, monkeypatch):
        monkeypatch.setattr(surroundings, "TOLERATED", 0.1)
        sky = '[[light]]\ntype = "sky"\n[camera]\nfrom = [10, 8, 120]\nto = [10, 8, 16]\n'
        (tmp_path / "shot.toml").write_text(
            OPEN.replace("[[solid]]", f"{sky}[[solid]]").replace('"auto"\n[map]', "1.0\n[map]")
        )
        steady = Shot(shot.path, decided=decide(shot, FRAMES).overrides)
        assert {light.lookup for frame in FRAMES for light in steady.scene(frame).lights} == {"points"}
        found = {frame: lattice_of(shot.scene(frame))[0].spacing for frame in FRAMES}
        assert len({*found.values()}) > 1
        assert {lattice_of(steady.scene(frame))[0].spacing for frame in FRAMES} == {found[6]}


LEARNT = functions_text(np.full((65, 2), 0.5, np.float32))


class Learner:
    """A renderer that learns the same of all scenes, or has no device."""

    def __init__(self, learnt=LEARNT):
        self.learnt, self.scenes = learnt, []

    def functions_for(self, scenes):
        self.scenes += scenes
        if self.learnt is None:
            raise NoDeviceError("none")
        return self.learnt


class TestLearnt:
    def test_once_for_all_frames(self, tmp_path, shot, ledger):
        shot = Shot(shot.path, [("map.coeffs", 2)])
        learner, path = Learner(), tmp_path / "a.plan.toml"
        decided = steady(shot, FRAMES, path, ledger, renderer=lambda: learner)
        assert len(learner.scenes) == 5
        assert len({scene.map for scene in learner.scenes}) == 1
        assert "map.functions = 65x2 numbers: learnt from rays" in "\n".join(decided.lines())
        for overrides in (decided.overrides, RangePlan.load(path)[0].overrides):
            assert Shot(shot.path, shot.overrides, decided=overrides).scene(3).map.functions == learner.learnt

    @pytest.mark.parametrize(
        "given", [("map.basis", "legendre"), ("march.method", "dual"), ("map.fit", "l2")]
    )
    def test_nothing(self, shot, given):
        decided = decide(Shot(shot.path, [given]), FRAMES, renderer=lambda: pytest.fail("asked for"))
        assert "map.functions" not in decided.decisions

    def test_without_a_device_each_frame_learns(self, shot):
        assert "map.functions" not in decide(shot, FRAMES, renderer=lambda: Learner(None)).decisions


class TestSteady:
    def test_a_second_process_reads_what_the_first_decided(self, tmp_path, shot, ledger, monkeypatch):
        path = tmp_path / "a.plan.toml"
        first = steady(shot, FRAMES, path, ledger)
        monkeypatch.setattr("tfm_cl.sequence.plan.decide", None)  # calling it would fail
        again = steady(shot, FRAMES, path, ledger)
        assert [Shot(shot.path, decided=one.overrides).scene(3).camera for one in (first, again)]
        assert dict(again.overrides) == {
            key: list(value) if isinstance(value, tuple) else value for key, value in first.overrides
        }
        assert steady(shot, [2, 3], path, ledger).looked_at == first.looked_at  # of some of the frames

    @pytest.mark.parametrize("change", ["scene", "override", "frames", "a frame looked at", "damage"])
    def test_what_is_of_something_else_is_decided_anew(self, tmp_path, shot, ledger, change):
        path = tmp_path / "a.plan.toml"
        steady(shot, [1, 2, 3], path, ledger)
        frames = [1, 2, 3]
        if change == "scene":
            (tmp_path / "shot.toml").write_text(OPEN + "[camera]\nfov = 20\n")
        elif change == "override":
            shot = Shot(shot.path, [("camera.fov", 20.0)])
        elif change == "frames":
            frames = [2, 3, 4]
        elif change == "a frame looked at":
            np.save(tmp_path / "v.0003.npy", np.ones((9, 9, 9), np.float32))
        else:
            path.write_text("fingerprint = 3")
        before = path.read_text()
        steady(shot, frames, path, ledger)
        assert path.read_text() != before
        assert RangePlan.load(path) is not None

    def test_values_that_somebody_made_impossible_are_the_plans(self, tmp_path, shot, ledger):
        path = tmp_path / "a.plan.toml"
        steady(shot, [1, 2], path, ledger)
        path.write_text(re.sub(r'"light.cone" = .*', '"light.cone" = -3', path.read_text()))
        with pytest.raises(InputError, match=r"a\.plan\.toml: .*cone = -3: .*; correct it, or delete"):
            steady(shot, [1, 2], path, ledger)

    def test_other_frames_may_change(self, tmp_path, shot, ledger):
        """A simulation goes on while its first frames are rendered."""
        path = tmp_path / "a.plan.toml"
        (tmp_path / "v.0006.npy").unlink()
        steady(shot, FRAMES, path, ledger)
        before = path.read_text()
        np.save(tmp_path / "v.0006.npy", np.ones((9, 9, 9), np.float32))
        steady(shot, FRAMES, path, ledger)
        assert path.read_text() == before

    def test_a_folder_that_is_not_there(self, tmp_path, shot, ledger):
        with pytest.raises(InputError, match="no directory"):
            steady(shot, [1], tmp_path / "x" / "a.plan.toml", ledger)


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"a = 1",
        b"[[",
        b"\xff",
        b"values = 3\nwhy = 2\nframes = 'x'",
        b"a = " + b"[" * 10**5,
        b"values = {}\nwhy = {}\nframes = '1'\nlooked_at = [inf]",
        b"values = {'volume.file' = 'other.npy'}\nwhy = {}\nframes = '1'\nlooked_at = [1]\nfingerprint = 'a'",
    ],
)
def test_damage_is_no_plan(tmp_path, text):
    (tmp_path / "a.toml").write_bytes(text)
    assert RangePlan.load(tmp_path / "a.toml") is None


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_no_plan(tmp_path):
    os.mkfifo(tmp_path / "a.toml")
    assert RangePlan.load(tmp_path / "a.toml") is None


def test_scene_files_take_what_is_decided(shot):
    """It wins over the file, and over nothing that the user gave."""
    file = Shot(shot.path, decided=[("map.res", 77), ("light.cone", 9.0)]).scene_file(2)
    assert file.map.res == 77
    assert file.placed_light == {"cone": 9.0}
