"""Images on surfaces: interpolation, what lies beyond them, and their means over pixels."""

import numpy as np
import PIL.Image
import pytest
from tolerances import FLOAT32, ROUNDED

import tfm_cl as tfm
from tfm_cl.files.mipmap import Mipmap
from tfm_cl.render.tracing.textures import TAPS, footprints, sampled
from tfm_cl.render.tracing.tracer import Tracer
from tfm_cl.scene.solids import MeshSolid, PlaneSolid

STORED = 2.0**-11
"""Of a texel: float16 keeps eleven bits."""

ALIASING = 0.02
"""Of a distant checker of 0 and 1, whose mean is 1/2: how far a pixel may be from it. Single samples are 1/2
away."""

POINT = np.zeros((1, 2, 2))


def at(image, u, v):
    """Red, without a footprint."""
    return sampled(image, np.array([[u, v]]), POINT)[0, 0]


def picture(rng, height=3, width=5):
    return rng.integers(0, 2**10, size=(height, width, 3)) / 2**10


def test_texels_are_interpolated_and_v_points_upwards(rng):
    values = picture(rng)
    image = Mipmap.of(values)
    assert at(image, 1.5 / 5, 1 - 0.5 / 3) == values[0, 1, 0]
    assert at(image, 1.75 / 5, 1 - 0.5 / 3) == pytest.approx(0.75 * values[0, 1, 0] + 0.25 * values[0, 2, 0])
    assert at(image, 1.5 / 5, 1 - 1.25 / 3) == pytest.approx(0.25 * values[0, 1, 0] + 0.75 * values[1, 1, 0])


@pytest.mark.parametrize(
    ("wrap", "expected"), [("repeat", (4, 0, 1)), ("clamp", (0, 4, 4)), ("mirror", (0, 4, 1))], ids=str
)
def test_beyond_the_image(rng, wrap, expected):
    values = picture(rng, 1, 5)
    image = Mipmap.of(values, (wrap, "repeat"))
    found = [at(image, (x + 0.5) / 5, 0.5) for x in (-1, 5, 11)]
    assert found == [values[0, x, 0] for x in expected]
    assert at(image.wrapped(("repeat", wrap)), -0.1, 0.5) == values[0, 4, 0]


@pytest.mark.parametrize("shape", [(64, 64), (5, 7), (1, 9), (6, 1)])
def test_every_level_has_the_same_mean(rng, shape):
    values = picture(rng, *shape)
    levels = Mipmap.of(values).levels
    assert levels[-1].shape == (3, 1, 1)
    for level in levels:
        np.testing.assert_allclose(
            level.astype(np.float64).mean(axis=(1, 2)), values.mean(axis=(0, 1)), rtol=2 * STORED
        )


def test_a_footprint_is_an_ellipse_that_a_cone_cuts():
    normals = np.array([[0, 1.0, 0], [0, 1, 0]])
    angle = np.radians(60)
    directions = np.array([[0, -1.0, 0], [np.sin(angle), -np.cos(angle), 0]])
    axes = footprints(normals, directions, np.array([0.5, 0.5]))
    np.testing.assert_allclose(np.linalg.norm(axes, axis=2), [[0.5, 0.5], [0.5, 1.0]], atol=ROUNDED)
    np.testing.assert_allclose(np.abs(axes[1]), [[0, 0, 0.5], [1, 0, 0]], atol=ROUNDED)
    np.testing.assert_allclose(axes[..., 1], 0, atol=ROUNDED)


def test_a_footprint_is_averaged(rng):
    """Along its longer axis over half of the image, across within a texel: the mean of a row's half."""
    values = np.broadcast_to(picture(rng, 1, 8), (8, 8, 3))
    uv, axes = np.array([[0.25, 0.5]]), np.array([[[0.5, 0], [0, 1e-3]]])
    assert TAPS >= 4
    np.testing.assert_allclose(
        sampled(Mipmap.of(values), uv, axes)[0], values[0, :4].mean(axis=0), rtol=2 * STORED
    )


@pytest.fixture
def checker(tmp_path):
    rows, columns = np.mgrid[:64, :64] // 8
    path = tmp_path / "checker.png"
    PIL.Image.fromarray(np.uint8(255 * ((rows + columns) % 2))).save(path)
    return str(path)


def test_a_distant_checker_does_not_alias(checker):
    camera = tfm.Camera(from_=(0, 1, 0), to=(0.3, 0.97, -1), fov=20, res=(40, 30))
    tracer = Tracer([PlaneSolid(albedo=checker, texture_scale=2.0)])
    rays = camera.rays()
    filtered, single = (tracer.nearest(*rays, spread) for spread in (camera.pixel_width, 0.0))
    # A square of 1/4 is half of a pixel wide there, and less along the ray.
    distant = np.isfinite(filtered.distance) & (filtered.distance * camera.pixel_width > 0.5)
    assert distant.sum() > 50
    assert np.abs(filtered.albedo[distant] - 0.5).max() < ALIASING
    assert np.abs(single.albedo[distant] - 0.5).max() > 0.45
    # And nearby it is seen.
    above = np.array([[0.125, 1, -0.125], [0.375, 1, -0.125]])
    near = tracer.nearest(above, [0, -1, 0], camera.pixel_width)
    assert near.albedo[:, 0].tolist() == [1, 0]


def test_a_mesh_has_it_where_a_plane_does(checker):
    camera = tfm.Camera(from_=(0.4, 2, 1), to=(0, 0, -3), fov=60, res=(60, 40))
    vertices = np.array([[-9, 0, 5], [9, 0, 5], [9, 0, -40], [-9, 0, -40.0]])
    mesh = MeshSolid.from_arrays(
        vertices, [[0, 1, 2], [0, 2, 3]], checker, uv=vertices[:, [0, 2]] * (0.5, -0.5)
    )
    one, other = (
        Tracer([solid]).nearest(*camera.rays(), camera.pixel_width)
        for solid in (mesh, PlaneSolid(albedo=checker, texture_scale=2.0))
    )
    met = np.isfinite(one.distance)
    assert met.sum() > 1000
    # The mesh's barycentric coordinates are float32: of texels, these are 64 * 45 / 2.
    np.testing.assert_allclose(one.albedo[met], other.albedo[met], atol=64 * 45 / 2 * 8 * FLOAT32)


def test_a_wall_shows_it_upright(tmp_path):
    path = tmp_path / "halves.png"
    PIL.Image.fromarray(np.uint8([[[255, 0, 0]], [[0, 0, 255]]])).save(path)
    wall = PlaneSolid(normal=(0, 0, 1), albedo=str(path), transform=np.diag([2.0, 2, 2, 1]))
    # Its image is 2 wide and 4 high, from the point upwards.
    hits = Tracer([wall]).nearest([[0.5, 1, 3], [0.5, 3, 3]], [0, 0, -1])
    np.testing.assert_array_equal(hits.albedo, [[0, 0, 1], [1, 0, 0]])


def test_what_is_infinitely_far_is_a_number(checker):
    plane = PlaneSolid(albedo=checker, texture_scale=1e-9)
    directions = np.array([[1, -1e-14, 0], [0, -1, 0]])
    hits = Tracer([plane]).nearest([0, 1e10, 0], directions, 1e-3)
    assert np.isfinite(hits.albedo).all()
