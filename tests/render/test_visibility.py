"""What solids show and hide: the same however its parts are cut, and ended between them."""

import threading
import time

import numpy as np
import pytest
from scenes import make_scene

import tfm_cl as tfm
from tfm_cl.device.cache import Cache
from tfm_cl.errors import CancelledError
from tfm_cl.interrupts import cancelled_by
from tfm_cl.render.gbuffer import trace_gbuffer
from tfm_cl.render.raster import Crop, block_order, pack
from tfm_cl.render.tracing import threads
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.render.visibility import Visibility, clip_of
from tfm_cl.scene.solids import BoxSolid, PlaneSolid, SphereSolid

SOLIDS = [
    PlaneSolid(point=(0, -1, 0)),
    SphereSolid(radius=0.5, holdout=True),
    BoxSolid(from_=(1, 0, 0), to=(2, 1, 1)),
]
SCENE = make_scene(solids=SOLIDS)
SCENE = SCENE.replace(camera=SCENE.camera.replace(res=(48, 40)))


@pytest.fixture
def tracer():
    return Tracer(SOLIDS)


@pytest.fixture(params=["crop", "samples"])
def raster(request):
    x, y = np.meshgrid(np.arange(3, 29), np.arange(5, 37))
    some = np.stack([x.ravel(), y.ravel()], axis=1)[::3]
    some = some[block_order(some)]
    return Crop((3, 5, 29, 37)) if request.param == "crop" else pack(some, 2, 8)


def test_a_gbuffer_is_the_same_in_parts(tracer, raster, monkeypatch):
    whole = trace_gbuffer(tracer, SCENE, raster)
    monkeypatch.setattr(threads, "CHUNK", 50)
    parts = trace_gbuffer(tracer, SCENE, raster)

    for name in ("solid", "albedo", "points", "starts", "bounds", "shown"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))
    assert 0 < len(whole.points) == whole.shown.sum() < whole.shown.size
    np.testing.assert_array_equal(whole.bounds, [whole.points.min(axis=0), whole.points.max(axis=0)])


def test_a_gbuffer_shows_the_rays_of_the_camera(tracer):
    crop = (3, 5, 29, 37)
    hits = tracer.nearest(*SCENE.camera.rays(crop), SCENE.camera.pixel_width)
    shown = trace_gbuffer(tracer, SCENE, Crop(crop)).solid.reshape(-1, 4)
    np.testing.assert_array_equal(shown[:, 3], hits.distance)
    np.testing.assert_array_equal(shown[:, :3], hits.normal)


def test_nothing_in_view_has_no_bounds(tracer):
    beside = SCENE.replace(camera=SCENE.camera.replace(from_=(0, 5, 0), to=(0, 9, 1)))
    assert trace_gbuffer(tracer, beside, Crop((0, 0, 8, 8))).bounds is None


def test_tracing_ends_between_parts_when_it_is_cancelled(tracer, raster, monkeypatch):
    monkeypatch.setattr(threads, "CHUNK", 50)
    monkeypatch.setattr(threads, "_cores", lambda: 2)
    asked, traced, nearest = [], [], Tracer.nearest

    def ask():
        asked.append(len(traced))
        if len(asked) == 3:
            raise CancelledError

    def count(*arguments):
        found = nearest(*arguments)
        traced.append(found)
        time.sleep(0.03)  # the thread that asks comes to do so
        return found

    monkeypatch.setattr(Tracer, "nearest", count)
    with cancelled_by(ask), pytest.raises(CancelledError):
        trace_gbuffer(tracer, SCENE, raster)
    # What was handed to the two threads is completed, and nothing else: 16 parts there are, or more.
    assert 2 <= len(traced) < 16 <= np.prod(raster.shape) / 50
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("tfm-solids")]


@pytest.mark.parametrize(("res", "size"), [(40, 8), (8, 40), (33, 33), (37, 5), (1, 1)])
def test_a_clip_is_the_largest_distance_around_each_ray(rng, res, size):
    distances = np.where(rng.random((res, res)) < 0.1, np.inf, rng.random((res, res))).astype(np.float32)
    reach = (3 * -(-res // size) + 2) // 2
    centres = [min(int((number + 0.5) * res / size), res - 1) for number in range(size)]

    def around(number):
        return slice(max(number - reach, 0), number + reach + 1)

    expected = [[distances[around(y), around(x)].max() for x in centres] for y in centres]
    np.testing.assert_array_equal(clip_of(distances, size), expected)


def test_bounds_of_shadow_maps_are_the_same_in_parts_and_end_when_it_is_cancelled(rng, monkeypatch):
    lights = [
        tfm.SpotLight(from_=(x, 3, 1), to=(0, 0, 0), cone=20).fitted(SCENE.bounds) for x in (1, 2, 3, 4)
    ]
    maps = [rng.random((size, size)).astype(np.float32) for size in (40, 40, 16, 40)]
    whole = Visibility(Cache()).shadow_bounds(SCENE, lights, maps)
    monkeypatch.setattr("tfm_cl.render.visibility.BOUNDED_AT_ONCE", 2 * 40**2)
    parts = Visibility(Cache()).shadow_bounds(SCENE, lights, maps)
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)

    asked = []

    def ask():
        asked.append(1)
        if len(asked) == 10:
            raise CancelledError

    with cancelled_by(ask), pytest.raises(CancelledError):
        Visibility(Cache()).shadow_bounds(SCENE, lights, maps)


def test_shadow_maps_are_the_same_in_parts(monkeypatch):
    """Several small maps are traced at a time, and large ones a part at a time."""
    lights = [tfm.SpotLight(from_=(x, 3, 1), to=(0, 0, 0), cone=20).fitted(SCENE.bounds) for x in (1, 2, 3)]
    sizes = [16, 40, 16]
    whole = Visibility(Cache()).shadow_maps(SCENE, lights, sizes)
    monkeypatch.setattr("tfm_cl.render.visibility.CHUNK", 300)
    parts = Visibility(Cache()).shadow_maps(SCENE, lights, sizes)
    assert [one.shape for one in parts] == [(size, size) for size in sizes]
    for one, other in zip(parts, whole, strict=True):
        np.testing.assert_array_equal(one, other)
        assert np.isfinite(one).any()
