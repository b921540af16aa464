"""What must not change a picture, and what must not break one."""

import numpy as np
import pytest
from scenes import blobs, make_scene

import tfm_cl as tfm
from tfm_cl.device import launch
from tfm_cl.errors import DeviceMemoryError, SceneError

pytestmark = pytest.mark.lanes


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_crop_is_a_part_of_the_frame(renderer, small_scene, method):
    full = renderer.render(small_scene, method=method)
    part = renderer.render(small_scene, method=method, crop=(5, 3, 18, 17))

    assert part.image.shape == (14, 13, 4)
    assert (part.image == full.image[3:17, 5:18]).all()
    for name, layer in full.aovs.items():
        assert (part.aovs[name] == layer[3:17, 5:18]).all(), name


@pytest.mark.parametrize("crop", [(0, 0, 25, 18), (-1, 0, 5, 5), (5, 5, 5, 9), (9, 0, 5, 5)])
def test_a_crop_outside_the_frame_is_refused(renderer, small_scene, crop):
    with pytest.raises(SceneError, match="does not lie in the image of 24×18"):
        renderer.render(small_scene, crop=crop)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
def test_tiles_do_not_show(renderer, small_scene, method, monkeypatch):
    scene = small_scene.replace(camera=small_scene.camera.replace(res=(61, 47)))
    whole = renderer.render(scene, method=method)
    monkeypatch.setattr(launch, "FIRST_SAMPLES", 1)
    monkeypatch.setattr(launch, "LAUNCH_SECONDS", 1e-9)

    tiled = renderer.render(scene, method=method)

    assert len(windows_of(0, 0, 61, 47, seconds=1.0)) == 4
    assert (tiled.image == whole.image).all()
    assert tiled.stats.samples == whole.stats.samples


def windows_of(*bounds, seconds):
    """Windows of launches that all take so long."""
    windows, found = launch.Windows(*bounds, launch.Pacing(1 << 16, launch.Windows.EDGE**2)), []
    for window in windows:
        found.append(window)
        windows.took(window, seconds)
    assert windows.done == 1
    return found


@pytest.mark.parametrize("seconds", [1e-6, 0.01, 0.1, 10.0])
def test_windows_cover_every_pixel_once(seconds):
    count = np.zeros((470, 611), int)
    windows = windows_of(3, 5, 611, 470, seconds=seconds)
    for x0, y0, x1, y1 in windows:
        assert x0 == 3 or x0 % 32 == 0
        assert y0 == 5 or y0 % 32 == 0
        count[y0:y1, x0:x1] += 1

    assert count[5:, 3:].min() == count[5:, 3:].max() == 1
    assert count[:5].max() == count[:, :3].max() == 0


def test_windows_follow_the_time_that_launches_take():
    areas = [
        [(x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in windows_of(0, 0, 4096, 2304, seconds=seconds)]
        for seconds in (1e-3, launch.LAUNCH_SECONDS, 10.0)
    ]

    assert len(areas[0]) < len(areas[1]) == len(areas[2])
    assert areas[1][1] == areas[1][0] == areas[2][-1] == 32 * 32
    assert areas[0][1] > 2 * areas[0][0]


@pytest.mark.slow
@pytest.mark.parametrize("work_group", [None, (1, 1), (4, 2), (3, 5), (16, 16)])
def test_work_groups_do_not_show(new_renderer, renderer, small_scene, work_group):
    expected = renderer.render(small_scene)
    with new_renderer(work_group=work_group, lanes=renderer.lanes) as other:
        result = other.render(small_scene)

    # Another vectorisation may round differently.
    assert np.abs(result.image - expected.image).max() < 1e-5
    assert result.stats.samples == expected.stats.samples


def test_rendering_twice_gives_the_same_bytes(renderer, small_scene):
    assert renderer.render(small_scene).image.tobytes() == renderer.render(small_scene).image.tobytes()


def a_volume(data, scale=1.0):
    return tfm.Volume(data, voxel_size=0.15, origin=(-1, -1, -1), density_scale=scale)


DEGENERATE = {
    "empty volume": {"volume": a_volume(np.zeros((8, 8, 8)))},
    "one voxel": {"volume": a_volume(np.full((1, 1, 1), 5.0))},
    "a plate of one voxel": {"volume": a_volume(np.full((1, 16, 16), 5.0))},
    "optical depth 10^4": {"volume": a_volume(blobs(), 1e4)},
    "optical depth 10^25": {"volume": a_volume(blobs(), 1e25)},
    "largest float density": {"volume": a_volume(np.full((4, 4, 4), 3e38))},
    "tiny density": {"volume": a_volume(blobs(), 1e-30)},
    "density scale 0": {"volume": a_volume(blobs(), 0.0)},
    "no extinction": {"medium": tfm.Medium(sigma_s=0.0)},
    "extinction 10^9": {"medium": tfm.Medium(sigma_s=(1e9, 0, 1e9), sigma_a=(0, 0, 1e9))},
    "camera looks away": {"camera": tfm.Camera(from_=(0, 0, 5), to=(0, 0, 9), res=(24, 18))},
    "light looks away": {"lights": [tfm.SpotLight(from_=(0, 4, 0), to=(0, 9, 0), cone=20)]},
    "light misses": {"lights": [tfm.SpotLight(from_=(0, 4, 0), to=(4, 4, 0), cone=2)]},
    "pin-sharp cone": {"lights": [tfm.SpotLight(from_=(0, 4, 0), to=(0, 0, 0), cone=1e-3)]},
    "widest cone": {"lights": [tfm.SpotLight(from_=(0, 0.2, 0), to=(0, 0, 0), cone=89.99)]},
    "light at the camera": {
        "lights": [tfm.SpotLight(from_=(0.6, 0.8, 4.2), to=(0, 0, 0), cone=20, falloff="inverse-square")]
    },
    "light and camera at one point inside": {
        "camera": tfm.Camera(from_=(0, 0, 0), to=(0, 0, -1), fov=100, res=(24, 18)),
        "lights": [tfm.SpotLight(from_=(0, 0, 0), to=(0, 0, -1), cone=40, falloff="inverse-square")],
    },
    "light on a voxel face": {"lights": [tfm.SpotLight(from_=(-1, -1, -1), to=(0, 0, 0), cone=40)]},
    "peaked phase": {"medium": tfm.Medium(phase=tfm.HenyeyGreenstein(0.9999))},
    "one step": {
        "march": tfm.MarchSettings(steps=1),
        "map": tfm.MapSettings(basis="dct", density_weighting=10.0, res=4, steps=1, coeffs=1),
    },
    "one texel": {"map": tfm.MapSettings(basis="dct", density_weighting=10.0, res=1, steps=8)},
    "widest view": {"camera": tfm.Camera(from_=(0, 0, 2), to=(0, 0, 0), fov=179.9, res=(24, 18))},
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tfm", "dual"])
@pytest.mark.parametrize("case", DEGENERATE)
def test_degenerate_scenes_give_finite_pictures(renderer, case, method):
    result = renderer.render(make_scene(**DEGENERATE[case]), method=method)

    for layer in (result.image, *result.aovs.values()):
        assert np.isfinite(layer).all()
        assert layer.min() >= 0
    assert result.image[..., 3].max() <= 1
    assert result.aovs["transmittance"].max() <= 1
    assert result.aovs["light_transmittance"].max() <= 1.0001


def test_what_is_not_lit_is_black(renderer):
    for case in ("empty volume", "density scale 0", "no extinction", "light looks away", "light misses"):
        assert renderer.render(make_scene(**DEGENERATE[case])).image[..., :3].max() == 0, case


def test_a_light_moving_through_the_face_of_the_medium_does_not_jump(renderer, small_scene):
    # The light walks through the bounds in equal small steps; no step may change the picture much more
    # than its neighbours do.
    bounds = tfm.Volume(blobs(), voxel_size=0.15, origin=(-1, -1, -1), density_scale=4)
    means = []
    for height in np.linspace(1.15, 0.75, 9):
        light = tfm.SpotLight(from_=(0.05, float(height), 0.1), to=(0.05, -1, 0.1), cone=35)
        scene = small_scene.replace(volume=bounds, lights=[light], march=tfm.MarchSettings(steps=120))
        means.append(float(renderer.render(scene).image[..., :3].mean()))

    steps = np.abs(np.diff(means))
    assert min(means) > 0
    assert steps.max() < 3 * np.median(steps) + 1e-4


def test_a_volume_beyond_the_device_is_refused_with_both_numbers(new_renderer, small_scene):
    data = np.zeros((200, 200, 200), np.float32)
    data[::20, ::20, ::20] = 1
    sparse = small_scene.replace(volume=tfm.Volume(data))
    message = r"200×200×200 voxels\) needs .* MiB; .* allows 4.6 MiB"
    with (
        new_renderer(largest_buffer=600_000) as other,
        pytest.raises(DeviceMemoryError, match=message),
    ):
        other.render(sparse)


def test_a_volume_beyond_the_kernels_index_is_refused(new_renderer, small_scene, monkeypatch):
    monkeypatch.setattr("tfm_cl.device.bricks.MAX_INDEX", 6 * 4 * 4 - 1)
    with new_renderer() as other, pytest.raises(DeviceMemoryError, match="has 96 bricks"):
        other.render(small_scene)


def test_progress_reaches_1_and_interrupts(renderer, small_scene):
    seen = []
    renderer.render(small_scene, progress=lambda stage, fraction: seen.append((stage, fraction)))

    assert [stage for stage, fraction in seen if fraction == 1] == ["light pass", "view pass, light 1"]

    def interrupt(*_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        renderer.render(small_scene, progress=interrupt)


def test_unknown_method_is_refused(renderer, small_scene):
    with pytest.raises(SceneError, match="known: tfm, dual"):
        renderer.render(small_scene, method="path")
