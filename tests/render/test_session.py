"""Frames one after the other: what changed is made again, and nothing else."""

import logging
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyopencl as cl
import pytest
from memory import resident
from scenes import blobs, make_scene

import tfm_cl as tfm
from tfm_cl import metrics
from tfm_cl.device.launch import Launcher
from tfm_cl.device.running import Running
from tfm_cl.errors import CancelledError, DeviceError, ImageError, SceneError
from tfm_cl.maps.probe import LightProbe
from tfm_cl.plan import maps
from tfm_cl.render import media

SPOT = tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24, intensity=3)
POINT = tfm.PointLight(from_=(2, 2, 2))
BALL = tfm.SphereSolid(centre=(0.2, -0.1, 0.3), radius=0.3)
FOG = tfm.BoxVolume(density=0.1, medium=tfm.Medium(sigma_s=0.4))
SCENE = make_scene(lights=[SPOT, POINT])
GRID = SCENE.bodies[0]
IN_FOG = SCENE.replace(volume=[GRID, FOG])
BESIDE_BALL = SCENE.replace(solids=[BALL], shadow=tfm.ShadowSettings(res=32))
ENDLESS = SCENE.replace(volume=tfm.EverywhereVolume(density=0.1))
SMALL = GRID.with_density_scale(2.0)
TWICE = SCENE.replace(lights=[SPOT], medium=SCENE.medium.replace(orders=2))
TWO = SCENE.replace(volume=[GRID, SMALL.transformed(np.diag([0.5, 0.5, 0.5, 1.0]))])


@pytest.fixture(scope="session")
def renderer(one_lane_renderer):
    return one_lane_renderer


def other_grid():
    """The same place, other voxels."""
    return tfm.Volume(blobs(seed=8), world_from_index=GRID.world_from_index, density_scale=4.0)


CHANGES = {
    "nothing": (SCENE, SCENE, {}),
    "camera": (SCENE, SCENE.replace(camera=SCENE.camera.replace(fov=30.0)), {}),
    "march": (SCENE, SCENE.replace(march=SCENE.march.replace(steps=20)), {}),
    "intensity": (SCENE, SCENE.replace(lights=[SPOT.replace(intensity=(9, 1, 4)), POINT]), {}),
    "albedo": (
        SCENE,
        SCENE.replace(medium=SCENE.medium.replace(sigma_s=(0.9, 0.8, 0.5), sigma_a=(0.2, 0.3, 0.2))),
        {},
    ),
    "phase": (SCENE, SCENE.replace(medium=SCENE.medium.replace(phase=tfm.Isotropic())), {}),
    "ambient": (SCENE, SCENE.replace(ambient=tfm.Ambient(radiance=1)), {}),
    "emission": (SCENE, SCENE.replace(medium=SCENE.medium.replace(emission=(1, 2, 3))), {}),
    "fog's density": (IN_FOG, IN_FOG.replace(volume=[GRID, FOG.replace(density=0.3)]), {}),
    "camera in endless fog": (ENDLESS, ENDLESS.replace(camera=SCENE.camera.replace(from_=(1, 1, 3))), {}),
    "empty space": (SCENE, SCENE.replace(march=SCENE.march.replace(skip_empty=False)), {}),
    "one light": (
        SCENE,
        SCENE.replace(lights=[SPOT, POINT.replace(from_=(2.5, 2, 2))]),
        {"probe": 1, "map": 1},
    ),
    "a light more": (
        SCENE,
        SCENE.replace(lights=[SPOT, POINT, SPOT.replace(cone=30)]),
        {"probe": 1, "map": 1},
    ),
    "map settings": (SCENE, SCENE.replace(map=SCENE.map.replace(coeffs=4)), {"map": 2}),
    "density": (SCENE, SCENE.replace(volume=SMALL), {"probe": 2, "map": 2}),
    "voxels": (SCENE, SCENE.replace(volume=other_grid()), {"bricks": 1, "probe": 2, "map": 2}),
    "a solid's place": (
        BESIDE_BALL,
        BESIDE_BALL.replace(solids=[BALL.replace(radius=0.4)]),
        {
            "G-buffer": 1,
            "shadow map": 2,
            "bounds of a shadow map": 2,
            "lit pixels": 2,
            "clip": 4,
            "probe": 2,
            "map": 2,
        },
    ),
    "camera before a solid": (
        BESIDE_BALL,
        BESIDE_BALL.replace(camera=SCENE.camera.replace(fov=30.0)),
        {"G-buffer": 1, "lit pixels": 2},
    ),
    "camera, later orders": (TWICE, TWICE.replace(camera=SCENE.camera.replace(fov=30.0)), {}),
    "steps of the camera's rays, later orders": (
        TWICE,
        TWICE.replace(march=SCENE.march.replace(steps=20)),
        {},
    ),
    "intensity, later orders": (
        TWICE,
        TWICE.replace(lights=[SPOT.replace(intensity=(9, 1, 4))]),
        {"orders": 1},
    ),
    "phase, later orders": (TWICE, TWICE.replace(medium=TWICE.medium.replace(phase="hg:0.2")), {"orders": 1}),
    "one order more": (TWICE, TWICE.replace(medium=TWICE.medium.replace(orders=3)), {"orders": 1}),
    "place of one of two grids": (
        TWO,
        TWO.replace(volume=[GRID, TWO.bodies[1].transformed(np.diag([1.1, 1, 1, 1.0]))]),
        {"probe": 2, "map": 2},
    ),
}


@pytest.fixture
def session(new_renderer):
    """A renderer of its own, which has made nothing yet."""
    with new_renderer(lanes=1) as renderer:
        yield renderer


@pytest.mark.quick("camera", "albedo", "density")
@pytest.mark.parametrize("change", CHANGES)
def test_a_frame_makes_what_it_must(session, renderer, change):
    before, after, expected = CHANGES[change]
    session.render(before)
    second = session.render(after)
    assert second.stats.made == expected
    assert (second.stats.seconds["light_pass"] > 0) == ("map" in expected)
    # What was kept is what would be made.
    fresh = renderer.render(after)
    np.testing.assert_array_equal(second.image, fresh.image)


def test_media_of_the_last_frame_are_not_uploaded_again(session, monkeypatch):
    made, make = [], media.media_on_device
    monkeypatch.setattr(media, "media_on_device", lambda *of: made.append(of) or make(*of))
    for fov in (30.0, 35.0):
        session.render(SCENE.replace(camera=SCENE.camera.replace(fov=fov)))
    assert len(made) == 1
    session.render(SCENE.replace(volume=SMALL))
    session.render(SCENE)
    assert len(made) == 3


@pytest.fixture
def on_device(monkeypatch):
    """Threads that put voxels on the device, in their order."""
    found, build = [], media.build_bricks
    monkeypatch.setattr(
        media, "build_bricks", lambda *of: found.append(threading.current_thread().name) or build(*of)
    )
    return found


@pytest.fixture
def looked(monkeypatch):
    """Which threads looked at the rays of lights."""
    found, ranges = [], LightProbe.ranges
    monkeypatch.setattr(
        LightProbe,
        "ranges",
        lambda self, *of: found.append(threading.current_thread().name) or ranges(self, *of),
    )
    return found


@pytest.mark.quick("smoke")
@pytest.mark.parametrize("scene", [SCENE, IN_FOG, BESIDE_BALL], ids=["smoke", "in fog", "beside a ball"])
def test_what_is_prepared_meanwhile_is_rendered_alike(session, renderer, on_device, looked, scene):
    """The next frame's voxels are put on the device by another thread, and only there.

    It looks at the lights' rays, too, where no solids end them.
    """
    session.render(scene)
    looked.clear()
    later = [scene.replace(volume=[other_grid(), *scene.bodies[1:]]) for _ in range(3)]
    with ThreadPoolExecutor(1, "reads") as executor:
        ready = executor.submit(session.prepare, later[0])
        for now, after in zip(later, [*later[1:], None], strict=True):
            ready.result()
            if after is not None:
                ready = executor.submit(session.prepare, after)
            found = session.render(now)
            made, lights = found.stats.made, len(scene.lights)
            assert (made["bricks"], made["map"], made["probe"]) == (1, lights, lights)
            assert found.stats.seconds["light_pass"] > 0
            np.testing.assert_array_equal(found.image, renderer.render(now).image)
    assert on_device.count("reads_0") == len(later)
    # Others are `renderer`'s, which made the same before or now.
    assert looked.count("reads_0") == (0 if scene.solids else len(scene.lights) * len(later))


@pytest.mark.quick("smoke")
@pytest.mark.parametrize("scene", [SCENE, BESIDE_BALL.replace(lights=[SPOT])], ids=["smoke", "beside a ball"])
def test_a_frame_is_read_while_the_device_makes_the_next(session, scene):
    """A CPU's driver reads when all has ended that was begun before, on whichever queue."""
    long = scene.replace(camera=SCENE.camera.replace(res=(160, 160)), march=SCENE.march.replace(steps=400))
    ends = [session.begin(one) for one in (scene, long)]
    ends[0]()
    still = [event for event, _ in session._launcher._under_way.values()]
    assert still
    assert still[-1].command_execution_status > cl.command_execution_status.COMPLETE
    ends[1]()
    assert still[-1].command_execution_status == cl.command_execution_status.COMPLETE


@pytest.mark.parametrize("asked", [{}, {"samples": 4, "background": 0.5}], ids=["plain", "anti-aliased"])
@pytest.mark.parametrize("scene", [SCENE, BESIDE_BALL], ids=["smoke", "beside a ball"])
def test_frames_begun_before_the_last_has_ended_are_alike(session, renderer, scene, asked):
    scenes = [scene, scene.replace(volume=other_grid()), scene.replace(lights=[SPOT])]
    ends = [session.begin(one, **asked) for one in scenes]
    for one, made, end in zip(scenes, (2, 2, 0), ends, strict=True):  # maps that no earlier frame had
        found, alone = end(), renderer.render(one, **asked)
        np.testing.assert_array_equal(found.image, alone.image)
        assert found.stats.samples == alone.stats.samples
        assert found.stats.made.get("map", 0) == made


def test_what_is_begun_is_checked_and_of_use_as_long_as_its_renderer(new_renderer):
    with new_renderer(lanes=1) as renderer:
        with pytest.raises(SceneError, match="samples"):
            renderer.begin(SCENE, samples=3)
        end = renderer.begin(SCENE)
    with pytest.raises(DeviceError, match="closed"):
        end()


GIVES_UP = """
import tfm_cl as tfm
from scenes import make_scene

scene = make_scene()
scene = scene.replace(camera=scene.camera.replace(from_=(0.3, 0.4, 2), res=(800, 500)))
for is_held in (False, True):
    renderer = tfm.Renderer(DEVICE, build_options=("-Werror",), lanes=1)
    for _ in range(2):
        end = renderer.begin(scene)
        if not is_held:
            del end
    renderer.close()
renderer = tfm.Renderer(DEVICE, build_options=("-Werror",), lanes=1)
end = renderer.begin(scene)
print("ends", flush=True)
"""


@pytest.mark.slow
def test_frames_that_are_begun_may_be_given_up(device_name):
    """The device still writes where they were to be: in a program that ends, that was a crash."""
    done = subprocess.run(
        [sys.executable, "-c", GIVES_UP.replace("DEVICE", repr(device_name))],
        cwd=Path(__file__).resolve().parents[1],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "ends\n", "")


def test_what_is_there_is_not_prepared_again(session, on_device):
    session.render(SCENE)
    assert session.prepare(SCENE.replace(camera=SCENE.camera.replace(fov=20)))
    assert len(on_device) == 1


def test_what_is_prepared_and_not_rendered_is_given_back(session, on_device):
    scenes = [SCENE.replace(volume=other_grid()) for _ in range(4)]
    for scene in scenes:
        session.prepare(scene)
    before = len(on_device)
    for scene in scenes:
        session.render(scene)
    assert before == 4
    assert len(on_device) == 4 + 2  # the two that were prepared last were at hand


def test_large_voxels_are_left_to_their_turn(new_renderer, on_device):
    with new_renderer(lanes=1, cache_bytes=16 * SCENE.bodies[0].leaves.nbytes - 1) as renderer:
        assert not renderer.prepare(SCENE)
        assert not on_device
        renderer.render(SCENE)
        assert len(on_device) == 1


def test_what_cannot_be_prepared_is_told_when_it_is_rendered(session):
    far = SCENE.replace(camera=SCENE.camera.replace(from_=(1e9, 0, 0)))
    session.prepare(far)
    with pytest.raises(SceneError, match=r"camera\.from"):
        session.render(far)


def test_threads_prepare_in_turn(new_renderer, monkeypatch):
    """Kernels have arguments for one thread at a time; what is closed meanwhile keeps nothing."""
    begun, together, build = threading.Semaphore(0), threading.Barrier(2), media.build_bricks

    def begin(*of):
        begun.release()
        with suppress(threading.BrokenBarrierError):
            together.wait(0.2)  # seconds; broken where no other thread gets here
        return build(*of)

    renderer = new_renderer(lanes=1)
    renderer.render(SCENE)
    monkeypatch.setattr(media, "build_bricks", begin)
    with ThreadPoolExecutor(2) as executor:
        preparing = [executor.submit(renderer.prepare, SCENE.replace(volume=other_grid())) for _ in range(2)]
        begun.acquire()
        renderer.close()
        for one in preparing:
            one.result()
    assert together.broken
    assert not begun.acquire(blocking=False)  # the other was not begun


def test_a_closed_renderer_prepares_nothing(new_renderer, on_device):
    renderer = new_renderer(lanes=1)
    renderer.close()
    renderer.prepare(SCENE)
    assert not on_device


def test_a_picture_stays_what_it_was_while_the_next_are_rendered(session):
    result = session.render(SCENE)
    image, depth = result.image, result.aovs["depth"]
    before = image.copy(), depth.copy(), result.aovs["light_transmittance"].copy()
    late = session.render(SCENE.replace(march=SCENE.march.replace(steps=20))).aovs
    layers = result.aovs
    del result
    for fov in (25.0, 30.0, 35.0):
        session.render(SCENE.replace(camera=SCENE.camera.replace(fov=fov)))
    assert (image == before[0]).all()
    assert (depth == before[1]).all()
    assert (layers["light_transmittance"] == before[2]).all()
    assert (
        late["transmittance"]
        == session.render(IN_FOG.replace(volume=GRID, march=SCENE.march.replace(steps=20))).aovs[
            "transmittance"
        ]
    ).all()


def test_the_first_frame_makes_everything(session):
    assert session.render(SCENE).stats.made == {"bricks": 1, "probe": 2, "map": 2}


@pytest.mark.slow
def test_functions_that_a_basis_learns_are_learnt_once(session, monkeypatch):
    learnt, functions_of = [], maps.functions_of
    monkeypatch.setattr(maps, "functions_of", lambda *of: learnt.append(of) or functions_of(*of))
    scene = SCENE.replace(map=SCENE.map.replace(basis="klt"), lights=[SPOT])
    assert session.render(scene).stats.made == {"bricks": 1, "probe": 1, "functions": 1, "map": 1}
    assert len(learnt) == 1
    session.render(scene.replace(camera=SCENE.camera.replace(fov=30.0)))
    assert len(learnt) == 1
    again = session.render(scene.replace(lights=[SPOT.replace(cone=30)]))
    assert again.stats.made == {"probe": 1, "functions": 1, "map": 1}


@pytest.mark.slow
def test_maps_of_optical_depths_stay_when_alpha_changes(session):
    """It follows the rays of all lights, and these numbers do not depend on it."""
    settings = SCENE.map.replace(basis="klt", density_weighting="auto")
    scene = SCENE.replace(map=settings, lights=[SPOT, POINT])
    both = session.render(scene).stats
    alone = session.render(scene.replace(lights=[POINT])).stats

    assert alone.map.density_weighting != both.map.density_weighting
    assert alone.made == {}


def test_functions_of_the_next_map_are_learnt_during_a_light_pass(session, monkeypatch):
    done, functions_of, start = [], maps.functions_of, Launcher.start

    def learn(*of):
        done.append("learnt")
        return functions_of(*of)

    def begin(launcher, kernel, *of):
        running = start(launcher, kernel, *of)
        if kernel.function_name != "light_pass":
            return running
        done.append("begun")
        return Running(lambda: done.append("ended") or running.wait())

    monkeypatch.setattr(maps, "functions_of", learn)
    monkeypatch.setattr(Launcher, "start", begin)
    lights = [SPOT.replace(cone=cone) for cone in (24, 25, 26)]
    session.build_maps(SCENE.replace(map=SCENE.map.replace(basis="klt", range="trimmed"), lights=lights))

    assert done == ["learnt", "begun", "learnt", "begun", "learnt", "ended", "begun", "ended", "ended"]


def test_the_device_is_at_the_rays_of_other_lights_while_the_host_plans_the_map_of_one(session, monkeypatch):
    done, start = [], Launcher.start

    def begin(launcher, kernel, *of):
        running = start(launcher, kernel, *of)
        if kernel.function_name != "light_ranges":
            return running
        done.append("begun")
        return Running(lambda: done.append("ended") or running.wait())

    monkeypatch.setattr(Launcher, "start", begin)
    session.build_maps(SCENE.replace(lights=[SPOT.replace(cone=cone) for cone in (24, 25, 26)]))

    assert done == ["begun"] * 3 + ["ended"] * 3


def test_a_light_pass_is_told_before_what_reads_its_map(session):
    told = []
    one = SCENE.replace(lights=[SPOT])
    session.render(one, progress=lambda stage, part: told.append((stage, part)))
    assert told == [("light pass", 1.0), ("view pass, light 1", 1.0)]


@contextmanager
def failing(name):
    """Let launches of a kernel, which leave its buffers as they are, fail when they are waited for."""
    start = Launcher.start

    def end():
        raise DeviceError(f"{name} failed")

    def instead(launcher, kernel, *of):
        return Running(end) if kernel.function_name == name else start(launcher, kernel, *of)

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Launcher, "start", instead)
        yield


@pytest.mark.parametrize("kernel", ["light_ranges", "fill_records"])
def test_what_fails_ahead_is_made_again_in_turn(session, renderer, kernel):
    session.render(SCENE)
    other = SCENE.replace(volume=other_grid())
    with failing(kernel):
        assert session.prepare(other)
    np.testing.assert_array_equal(session.render(other).image, renderer.render(other).image)


ON_LATTICE = SCENE.replace(
    lights=[tfm.SunLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0))], map=SCENE.map.replace(lookup="lattice")
)


@pytest.mark.quick("map", "probe")
@pytest.mark.parametrize(
    ("kernel", "scene"),
    [
        ("light_pass", SCENE),
        ("light_ranges", SCENE),
        ("light_curves", SCENE.replace(map=SCENE.map.replace(basis="klt"))),
        ("mark_voxels", ON_LATTICE),
    ],
    ids=["map", "probe", "rays", "marks"],
)
def test_what_a_device_failed_to_make_is_not_kept(session, renderer, kernel, scene):
    expected = renderer.render(scene).image
    with failing(kernel), pytest.raises(DeviceError, match=f"^{kernel} failed$"):
        session.render(scene)
    np.testing.assert_array_equal(session.render(scene).image, expected)


@pytest.mark.parametrize("basis", ["dct", "klt"])
def test_what_was_probed_before_takes_no_time(session, basis):
    scene = SCENE.replace(map=SCENE.map.replace(basis=basis, range="trimmed"), lights=[SPOT])
    first, second = (session.build_maps(scene)[0] for _ in range(2))

    assert first.plan.seconds > 0
    assert second.plan.seconds == 0


@pytest.mark.slow
def test_the_host_s_time_is_what_neither_device_nor_compiler_nor_rays_take(session):
    first, steady = (session.render(BESIDE_BALL).stats.seconds for _ in range(2))

    assert steady["trace"] == steady["light_pass"] == 0
    for seconds in (first, steady):
        assert 0 < seconds["host"] < seconds["total"]
    # Of a first frame the device takes more: voxels are put there.
    parts = [
        sum(v for k, v in seconds.items() if k != "total") / seconds["total"] for seconds in (first, steady)
    ]
    assert parts[0] < 1
    assert parts[1] == pytest.approx(1, abs=1e-9)


@pytest.mark.slow
def test_without_room_only_the_last_is_kept(device_name):
    with tfm.Renderer(device_name, cache_bytes=0) as tight:
        first = tight.render(SCENE)
        again = tight.render(SCENE)
    np.testing.assert_array_equal(first.image, again.image)
    assert again.stats.made["map"] == 2


def test_maps_of_the_caller_are_not_kept(session):
    session.build_maps(SCENE)
    assert session.render(SCENE).stats.made["map"] == 2


def test_a_frame_can_be_cancelled_from_another_thread(session):
    started, caught = threading.Event(), []

    def render():
        slow = SCENE.replace(map=SCENE.map.replace(res=2048, steps=400))
        try:
            session.render(slow, progress=lambda *_: started.set())
        except CancelledError as error:
            caught.append(error)

    thread = threading.Thread(target=render)
    thread.start()
    assert started.wait(100)
    session.cancel()
    thread.join(100)
    assert len(caught) == 1
    # The next frame is whole.
    assert session.render(SCENE).image[..., :3].max() > 0


def test_a_frame_is_cancelled_while_the_host_traces_solids(session, monkeypatch):
    """No launch comes before: the ball is traced in many parts, and cancelled in the first of them."""
    distances, traced = tfm.SphereSolid.distances, []

    def cancelling(*rays):
        traced.append(session.cancel())
        time.sleep(0.03)  # the thread that renders comes to ask
        return distances(*rays)

    scene = BESIDE_BALL.replace(camera=BESIDE_BALL.camera.replace(res=(64, 64)))
    monkeypatch.setattr("tfm_cl.render.tracing.threads.CHUNK", 128)
    with monkeypatch.context() as patch:
        patch.setattr(tfm.SphereSolid, "distances", cancelling)
        with pytest.raises(CancelledError):
            session.render(scene)
    assert len(traced) < 64 * 64 / 128 / 2
    assert session.render(scene).image[..., :3].max() > 0


def test_what_was_started_has_ended_when_a_frame_is_given_up(session, monkeypatch):
    """The next one may be given its memory."""
    ended, finish = [], Launcher.finish
    monkeypatch.setattr(Launcher, "finish", lambda launcher: ended.append(finish(launcher)))

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        session.render(make_scene(lights=[SPOT]), progress=interrupt)
    assert ended == [None]


def test_cancelling_nothing_does_nothing(session):
    session.cancel()
    assert session.render(SCENE).image[..., :3].max() > 0


def test_threads_share_a_renderer_in_turn(session):
    scenes = [SCENE, SCENE.replace(camera=SCENE.camera.replace(fov=30.0)), SCENE.replace(lights=[POINT])]
    alone = [session.render(scene).image for scene in scenes]
    coefficients = session.build_maps(SCENE)[0].coefficients

    def work(number):
        if number < len(scenes):
            return session.render(scenes[number]).image
        return session.build_maps(SCENE)[0].coefficients

    with ThreadPoolExecutor(4) as threads:
        found = list(threads.map(work, [0, 1, 2, 3] * 3))
    for number, array in enumerate(found):
        np.testing.assert_array_equal(array, [*alone, coefficients][number % 4])


def test_threads_have_renderers_of_their_own(new_renderer):
    def work(scene):
        with new_renderer(lanes=1) as own:
            return own.render(scene).image

    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(work, [SCENE, SCENE])
    np.testing.assert_array_equal(first, second)


def test_what_a_user_should_know_is_a_warning(session):
    dark = SCENE.replace(lights=[SPOT.replace(intensity=0)])

    with pytest.warns(tfm.TfmWarning) as caught:
        result = session.render(dark)
    assert [str(warning.message) for warning in caught] == list(result.warnings)
    assert {warning.filename for warning in caught} == {__file__}


def test_decisions_are_told_the_logger_and_nothing_is_shown(session, caplog, capfd):
    left_open = SCENE.replace(map=SCENE.map.replace(density_weighting="auto"))
    session.render(left_open)
    assert not caplog.records

    with caplog.at_level(logging.DEBUG, "tfm_cl"):
        session.render(left_open)
    assert [record for record in caplog.records if "map.density_weighting = " in record.getMessage()]
    assert "".join(capfd.readouterr()) == ""


def test_close_is_final(new_renderer):
    with new_renderer(lanes=1) as closed:
        (light_map, _), image = closed.build_maps(SCENE), closed.render(SCENE).image
    closed.close()

    for use in (closed.build_maps, closed.render):
        with pytest.raises(DeviceError, match=r"^the renderer is closed: .* make another$"):
            use(SCENE)
    assert light_map.coefficients.shape == (*2 * (SCENE.map.res,), SCENE.map.coeffs)
    assert image[..., :3].max() > 0


def test_results_files_and_arrays_are_compared_crop_to_crop(session, tmp_path):
    whole, crop = session.render(SCENE), session.render(SCENE, crop=(4, 3, 20, 16))
    brighter = replace(crop, image=1.5 * crop.image)
    crop.save(tmp_path / "crop.exr", aovs=("light_transmittance",))

    with pytest.warns(tfm.TfmWarning, match="compared are the pixels 4,3,20,16, which both have"):
        found = tfm.compare(brighter, whole)
    assert found == metrics.compare(brighter.image, whole.image[3:16, 4:20])
    assert tfm.compare(brighter, str(tmp_path / "crop.exr")) == metrics.compare(brighter.image, crop.image)
    assert tfm.compare(crop, tmp_path / "crop.exr", layer="light_transmittance").rmse == 0
    with pytest.raises(ImageError, match="the reference image: an array has no layer 'depth'"):
        tfm.compare(crop, crop.image, layer="depth")
    with pytest.raises(ImageError, match=r"the test image: unknown layer 'dept'; did you mean 'depth'"):
        tfm.compare(crop, crop, layer="dept")


def test_what_is_made_is_shown_on_a_line(session):
    result = session.render(SCENE)

    assert repr(session.build_maps(SCENE)[0]).startswith("TransmittanceMap(spot, ")
    assert repr(result).startswith("RenderResult(")
    assert len(repr(result)) < 120


@pytest.mark.slow
def test_memory_is_level_over_a_thousand_frames(device_name):
    lights = [SPOT, POINT, tfm.SunLight(from_=(1, 3, 1), to=(0, 0, 0))]
    scene, sizes = BESIDE_BALL.replace(lights=lights), []
    with tfm.Renderer(device_name, cache_bytes=1 << 20) as session:
        for number in range(1000):
            angle = 0.01 * number
            camera = scene.camera.replace(from_=(4 * np.sin(angle), 0.8, 4 * np.cos(angle)))
            moving = tfm.PointLight(from_=(2 * np.cos(angle), 2, 2 * np.sin(angle)))
            session.render(scene.replace(camera=camera, lights=[SPOT, moving]))
            if number >= 300 and number % 100 == 0:
                sizes.append(resident())
    # A frame's own arrays are 0.1 MiB: a leak of one a frame would be 70 MiB; 8 MiB are the allocator's.
    assert max(sizes) - sizes[0] < 8 << 20


@pytest.mark.slow
def test_thin_points_are_the_same_whatever_size_was_rendered_before(device_name):
    """How far they are widened, and so where their box ends, follows from the pixels."""
    places = np.random.default_rng(3).uniform(-1, 1, (400, 3))
    scene = tfm.Scene(tfm.Points(places, 0.004, 0.5), map=tfm.MapSettings(res=64, coeffs=6))
    small, large = (scene.replace(camera=scene.camera.replace(res=res)) for res in ((16, 9), (160, 90)))
    with tfm.Renderer(device_name) as renderer:
        expected = renderer.render(small).image
    with tfm.Renderer(device_name) as renderer:
        renderer.render(large)
        np.testing.assert_array_equal(renderer.render(small).image, expected)
