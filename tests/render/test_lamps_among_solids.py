"""Many lights among solids: no rays but those that matter, none twice, and the same pictures."""

from collections import Counter

import numpy as np
import pytest
from scenes import make_scene

import tfm_cl as tfm
from tfm_cl.render import batches
from tfm_cl.render.culling import bounds_of_lights
from tfm_cl.render.gbuffer import trace_gbuffer
from tfm_cl.render.lit_pixels import lit_pixels
from tfm_cl.render.raster import Crop
from tfm_cl.render.regions import LitRegions
from tfm_cl.render.tracing.threads import CHUNK
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.lights import PointLight, SpotLight, SunLight
from tfm_cl.scene.solids import BoxSolid, MeshSolid, PlaneSolid, SphereSolid

LAMPS = 60
FOG = tfm.BoxVolume(from_=(-3, 0, -3), to=(3, 2, 3), density=0.2)
FLOOR = PlaneSolid(point=(0, 0.1, 0))
WEDGE = MeshSolid.from_arrays(
    [[-2, 0.2, 1], [-1, 0.2, 1], [-1.5, 1.2, 1.5], [-1.5, 0.4, 0.2]], [[0, 1, 2], [0, 2, 3], [1, 3, 2]]
)
BALL = SphereSolid(centre=(0.3, 0.6, 0.2), radius=0.5)
SOLIDS = [BALL, BoxSolid(from_=(1, 0.2, -2), to=(2, 0.9, -1)), WEDGE]


def lamps(rng, solids):
    place = rng.uniform((-2.5, 0.8, -2.5), (2.5, 1.2, 2.5), (LAMPS, 3))
    aim = place + rng.normal((0, -1, 0), (0.3, 0, 0.3), (LAMPS, 3))
    return tfm.Scene(
        FOG,
        camera=tfm.Camera(from_=(0.5, 3.5, 6), to=(0, 0, 0), fov=50, res=(120, 68)),
        lights=[SpotLight(from_=at, to=to, cone=25, reach=1.3) for at, to in zip(place, aim, strict=True)],
        march=tfm.MarchSettings(steps=12),
        solids=solids,
    )


@pytest.fixture
def session(new_renderer):
    """A renderer of its own, which has traced nothing yet."""
    with new_renderer() as renderer:
        yield renderer


@pytest.fixture
def rays(monkeypatch):
    """Number of rays traced so far, by the tracer's method."""
    counts = Counter()

    def counted(name):
        method = getattr(Tracer, name)

        def counting(self, origins, directions, *more):
            counts[name] += len(np.broadcast_to(directions, np.broadcast_shapes(origins.shape, (1, 3))))
            return method(self, origins, directions, *more)

        monkeypatch.setattr(Tracer, name, counting)

    for name in ("nearest", "distances", "occluded"):
        counted(name)
    return counts


def all_shaded(monkeypatch):
    """Make the tracer expect shadows everywhere."""
    monkeypatch.setattr(
        Tracer, "may_shade", lambda _, regions, *__, **___: np.ones(len(regions.apex), dtype=bool)
    )


@pytest.mark.slow
def test_lights_beside_solids_need_no_shadow_maps(session, new_renderer, rng, monkeypatch):
    scene = lamps(rng, SOLIDS)
    result = session.render(scene)
    assert 0 < result.stats.made["shadow map"] < LAMPS / 2

    all_shaded(monkeypatch)
    with new_renderer() as other:
        expected = other.render(scene)
    assert expected.stats.made["shadow map"] == LAMPS
    assert np.array_equal(result.image, expected.image)


@pytest.mark.slow
def test_a_floor_under_camera_and_lights_shades_nothing_that_is_seen(session, rng, monkeypatch):
    scene = lamps(rng, [FLOOR])
    result = session.render(scene)
    assert "shadow map" not in result.stats.made
    assert result.stats.made["lit pixels"] == 1

    def error(texels_per_pixel):
        monkeypatch.setattr(batches, "TEXELS_PER_PIXEL", texels_per_pixel)
        return float(np.abs(session.render(scene).image - result.image).max())

    # Shadow maps say the same, but for the texels in which light grazes the floor.
    all_shaded(monkeypatch)
    coarse, fine = error(0.5), error(16)
    assert 0 < fine < coarse / 4 < 1e-3 * result.image.max()


def test_the_second_frame_traces_no_rays(session, rng, rays):
    scene = lamps(rng, [FLOOR, *SOLIDS])
    first = session.render(scene)
    assert min(rays["nearest"], rays["distances"], rays["occluded"]) > 0

    rays.clear()
    second = session.render(scene)
    assert rays == {}
    assert second.stats.made == {}
    assert second.stats.seconds["trace"] == 0
    assert np.array_equal(first.image, second.image)


def test_only_what_has_moved_is_traced_again(session, rng, rays):
    scene = lamps(rng, SOLIDS)
    lights = [SpotLight(from_=(0.3, 1.6, 0.2), to=(0.3, 0, 0.2), cone=30, reach=1.5), *scene.lights]
    session.render(scene.replace(lights=lights))

    rays.clear()
    moved = [lights[0].replace(from_=(0.35, 1.6, 0.2)), *lights[1:]]
    made = session.render(scene.replace(lights=moved)).stats.made
    assert made == {"shadow map": 1, "bounds of a shadow map": 1, "lit pixels": 1}
    assert rays["nearest"] == 0
    assert rays["distances"] <= batches.SMALLEST_SHADOW**2 * 16

    rays.clear()
    turned = scene.camera.replace(to=(0.01, 0, 0))
    made = session.render(scene.replace(lights=moved, camera=turned)).stats.made
    assert made["G-buffer"] == made["lit pixels"] == 1
    assert made.get("shadow map", 0) < LAMPS / 10


@pytest.mark.slow
def test_lights_on_grids_that_meet_no_solid_trace_none(session, new_renderer, rays, monkeypatch):
    beside = SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=20, intensity=3)
    scene = make_scene(lights=[beside], solids=[BALL.replace(centre=(4, 0.6, 0.2))])
    result = session.render(scene)
    assert rays["distances"] == 0

    all_shaded(monkeypatch)
    with new_renderer() as other:
        expected = other.render(scene)
    assert rays["distances"] > 0
    assert np.array_equal(result.image, expected.image)


@pytest.mark.parametrize("chunk", [CHUNK, 700], ids=["at once", "in chunks"])
@pytest.mark.parametrize("crop", [(0, 0, 120, 68), (13, 5, 94, 50)], ids=["whole", "crop"])
def test_lit_pixels_are_those_that_each_light_sees(rng, monkeypatch, crop, chunk):
    monkeypatch.setattr("tfm_cl.render.lit_pixels.CHUNK", chunk)
    scene = lamps(rng, [FLOOR, *SOLIDS])
    lights = [
        *scene.lights,
        PointLight(from_=(0.3, 1.4, 0.9)),
        PointLight(from_=(-1, 0.6, 1.2), reach=0.8),
        SunLight(from_=(1, 2, 1), to=(0, 0, 0)).fitted(scene.bounds),
    ]
    tracer = Tracer(scene.solids)
    raster = Crop(crop)
    gbuffer = trace_gbuffer(tracer, scene, raster)
    touched = bounds_of_lights(lights, scene.camera, np.array([[-50.0, 0, -50], [50, 3, 50]]))
    touched = np.clip(touched.reshape(-1, 2, 2), crop[:2], crop[2:]).reshape(-1, 4)
    lists = raster.lists_of_buffers(touched, gbuffer.EDGE)
    shaded = np.ones(len(lights), bool)
    found = lit_pixels(tracer, gbuffer, LitRegions.of(lights), lists, len(lights), shaded)

    points, surfaces = gbuffer.points, gbuffer.solid[gbuffer.shown].astype(np.float64)
    at = tracer.lifted(points, surfaces[:, :3], surfaces[:, 3])
    covered = 0
    for light, (x0, y0, x1, y1), first in zip(lights, found.rectangles, found.first, strict=True):
        direction = light.arrival(points).direction
        expected = light.reaches(points) & ((direction * surfaces[:, :3]).sum(axis=1) < 0)
        expected &= ~tracer.occluded(at, -direction, light.source_distance(at))
        picture, seen = np.zeros(gbuffer.shown.shape, bool), np.zeros(gbuffer.shown.shape, bool)
        picture[gbuffer.shown] = expected
        size = (y1 - y0, x1 - x0)
        seen[y0:y1, x0:x1] = found.lit[first : first + size[0] * size[1]].reshape(size)
        assert np.array_equal(seen, picture), light
        covered += size[0] * size[1]
    assert 0 < found.lit.sum() < covered < len(lights) * gbuffer.shown.size / 4
