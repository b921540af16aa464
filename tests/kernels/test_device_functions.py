"""Device functions, one by one, against float64 NumPy."""

import numpy as np
import pyopencl as cl
import pytest
from scenes import make_scene
from scipy import integrate
from tolerances import DEVICE_FUNCTION, FLOAT32, GRAZING, RECURRENCE

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.device import params as parameters
from tfm_cl.device.bricks import build_bricks
from tfm_cl.maps.bases import BASES
from tfm_cl.maps.bases.cosine import Cosines
from tfm_cl.maps.light_pass import map_variant
from tfm_cl.maps.resolved import resolve
from tfm_cl.render.renderer import NO_MAP
from tfm_cl.scene.phases import PHASES, HenyeyGreenstein, Isotropic

GRID = object()


class Device:
    """Calls the kernels of ``device_functions.cl`` for one scene."""

    def __init__(self, launcher, scene=None, *, coeffs=4, storage_bits=32, density_weighting=1.0):
        self.launcher = launcher
        self.scene = scene or make_scene()
        light = self.scene.lights[0]
        self.bricks = build_bricks(launcher, [self.scene.volume.leaves], "the volume", "f32")
        self.headers = (BASES["dct"].header, *light.headers, self.scene.medium.phase.HEADER)
        self.defines = {"TFM_N_COEFF": coeffs, "TFM_STORAGE_BITS": storage_bits, **self.bricks.defines}
        self.defines |= map_variant(NO_MAP, light, self.bricks)[1] | self.defines
        struct = parameters.fill(
            self.scene,
            light,
            crop=(0, 0, 1, 1),
            density_weighting=density_weighting,
            bricks=self.bricks,
        )
        self.params = launcher.upload("params", struct)
        self.centre = self.scene.volume.bounds.mean(axis=0)

    def run(self, name, count, *args, shape, dtype=np.float32, with_params=True):
        """Arrays are uploaded, `...` is the output, `GRID` the volume, numbers are passed by value."""
        buffers, output = [self.params] if with_params else [], None
        for arg in args:
            if arg is ...:
                output = self.launcher.empty("output", int(np.prod(shape)) * np.dtype(dtype).itemsize)
                buffers.append(output)
            elif arg is GRID:
                buffers.extend(self.bricks.arguments)
            elif isinstance(arg, np.ndarray):
                buffers.append(self.launcher.upload("input", arg))
            else:
                buffers.append(arg)
        kernel = self.launcher.kernels.kernel(name, "device_functions.cl", self.headers, self.defines)
        self.launcher.run(kernel, (count,), *buffers, np.int32(count))
        return self.launcher.download(output, shape, dtype)

    def local(self, world):
        """World points in the frame of the device."""
        return (world - self.centre).astype(np.float32)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_struct_offsets_agree_with_the_compiler(launcher):
    fields = [field.name for field in parameters.FIELDS]
    stores = "".join(
        f"offsets[{i}] = (int)((__global const char *)&p->{name} - (__global const char *)p);"
        for i, name in enumerate(fields)
    )
    text = f"""{parameters.c_declaration()}
    __kernel void offsets_of(PARAMS p, __global int *offsets)
    {{ {stores} offsets[{len(fields)}] = (int)sizeof(Params); }}"""
    program = cl.Program(launcher.context, text).build(["-cl-std=CL1.2"])
    offsets = launcher.empty("offsets", 4 * (len(fields) + 1))
    params = launcher.upload("params", np.zeros((), parameters.DTYPE))
    launcher.run(cl.Kernel(program, "offsets_of"), (1,), params, offsets)

    expected = [parameters.DTYPE.fields[name][1] for name in fields] + [parameters.DTYPE.itemsize]

    assert launcher.download(offsets, (len(fields) + 1,), np.int32).tolist() == expected


def test_density_is_trilinear_and_0_outside(launcher, rng):
    device = Device(launcher)
    volume = device.scene.volume
    index = rng.uniform(-2.5, np.add(volume.shape[::-1], 1.5), (4000, 3))
    points = index @ volume.world_from_index[:3, :3].T + volume.world_from_index[:3, 3]

    densities = device.run("call_density_at", 4000, GRID, device.local(points), ..., shape=(4000,))

    expected = reference.density(volume, points)
    assert np.count_nonzero(expected) > 500
    # A coordinate is rounded to half an ulp of the grid's width; the slope is at most 4 per voxel.
    assert np.abs(densities - expected).max() < 16 * volume.density_scale * 16 * FLOAT32


def test_medium_clip(launcher, rng):
    device = Device(launcher)
    volume = device.scene.volume
    size = np.linalg.norm(np.diff(volume.bounds, axis=0))
    origins = device.centre + rng.normal(size=(5000, 3)) * size
    directions = unit(rng.normal(size=(5000, 3)) * 0.4 + device.centre - origins)
    origins[:500] = device.centre + rng.uniform(-0.1, 0.1, (500, 3)) * size  # from inside
    axes = volume.world_from_index[:3, :3].T
    directions[:500] = unit(axes[rng.integers(0, 3, 500)])  # along the faces

    intervals = device.run(
        "call_medium_clip", 5000, device.local(origins), directions.astype(np.float32), ..., shape=(5000, 2)
    )

    expected = np.stack(reference.march_bounds(volume, origins, directions), axis=1)
    near_miss = np.diff(expected, axis=1)[:, 0] < 1e-4 * size
    assert np.abs(intervals - expected)[~near_miss].max() < 1e-5 * size
    assert 1000 < np.count_nonzero(expected[:, 1]) < 5000


def spot_rays(light, rng, count):
    """Rays of every kind: inside, outside, through the apex, along the side, along the axis."""
    matrix = light.frame().world_from_light
    apex, axis = matrix[:3, 3], matrix[:3, 2]
    origins = apex + rng.normal(size=(count, 3)) * 3
    directions = unit(rng.normal(size=(count, 3)))
    part = count // 8
    angle = rng.uniform(0, 2 * np.pi, part)
    tangent = np.tan(np.radians(light.cone))
    side = unit(
        np.cos(angle)[:, None] * tangent * matrix[:3, 0]
        + np.sin(angle)[:, None] * tangent * matrix[:3, 1]
        + axis
    )
    directions[:part] = unit(apex - origins[:part])
    directions[part : 2 * part] = side * rng.choice([-1, 1], part)[:, None]
    directions[2 * part : 3 * part] = axis * rng.choice([-1, 1], part)[:, None]
    origins[3 * part : 4 * part] = apex + axis * rng.uniform(0.1, 3, part)[:, None]
    origins[4 * part : 5 * part] = apex + side * rng.uniform(0.1, 3, part)[:, None]
    directions[5 * part : 6 * part] = unit(
        apex + axis * 2 + rng.normal(size=(part, 3)) - origins[5 * part : 6 * part] * 1.0
    )
    return origins, directions


@pytest.mark.parametrize("cone", [1.0, 24.0, 60.0, 89.0])
def test_light_clip_against_points_on_100_000_rays(launcher, rng, cone):
    light = tfm.SpotLight(from_=(0.4, 0.5, -0.3), to=(0, -0.2, 0.1), cone=cone)
    device = Device(launcher, make_scene(lights=[light]))
    count = 100_000
    origins, directions = spot_rays(light, rng, count)

    intervals = device.run(
        "call_light_clip", count, device.local(origins), directions.astype(np.float32), ..., shape=(count, 2)
    ).astype(np.float64)

    # Brute force: points along every ray are inside the cone exactly when they are inside the interval.
    matrix = light.frame().world_from_light
    tangent = np.tan(np.radians(cone))
    wrong = 0
    for t in rng.uniform(0, 8, (64, count)):
        local = (origins + t[:, None] * directions - matrix[:3, 3]) @ matrix[:3, :3]
        radius, height = np.hypot(local[:, 0], local[:, 1]), local[:, 2]
        # Angular distance to the side: rounding may decide there.
        clear = np.abs(np.arctan2(radius, height) - np.radians(cone)) > GRAZING
        clear &= np.linalg.norm(local, axis=1) > GRAZING
        inside = (height > 0) & (radius <= tangent * height)
        claimed = (t >= intervals[:, 0]) & (t <= intervals[:, 1])
        wrong += np.count_nonzero(clear & (inside != claimed))
    assert wrong == 0


def test_light_clip_agrees_with_the_reference(launcher, rng):
    light = tfm.SpotLight(from_=(0.4, 0.5, -0.3), to=(0, -0.2, 0.1), cone=24)
    device = Device(launcher, make_scene(lights=[light]))
    origins, directions = spot_rays(light, rng, 20_000)

    intervals = device.run(
        "call_light_clip",
        20_000,
        device.local(origins),
        directions.astype(np.float32),
        ...,
        shape=(20_000, 2),
    )

    begin, end = reference.cone_interval(light, origins, directions)
    bounded = np.minimum(end, 100), np.minimum(intervals[:, 1], 100)
    close = (np.abs(begin - intervals[:, 0]) < GRAZING * 5) & (
        np.abs(bounded[0] - bounded[1]) < GRAZING * 100
    )
    # Rays parallel to the side have an end that any rounding moves to infinity or back.
    assert np.count_nonzero(close) > 0.85 * 20_000


@pytest.mark.parametrize("falloff", ["none", "inverse-square"])
@pytest.mark.parametrize("blend", [0.0, 0.3, 1.0])
def test_light_at(launcher, rng, falloff, blend):
    light = tfm.SpotLight(
        from_=(2, 3, 1), to=(0, 0, 0), cone=24, falloff=falloff, blend=blend, intensity=(3, 2, 1)
    )
    device = Device(launcher, make_scene(lights=[light]))
    matrix, tangent = light.frame().world_from_light, np.tan(np.radians(24))
    uv = rng.uniform(0.16, 0.84, (500, 2))  # inside the cone's circle
    z = rng.uniform(0.5, 5, (500, 1))
    points = np.column_stack([(2 * uv - 1) * tangent * z, z]) @ matrix[:3, :3].T + matrix[:3, 3]
    uv_distance, radiance = (np.empty((500, 3), np.float32) for _ in range(2))
    kernel = launcher.kernels.kernel("call_light_at", "device_functions.cl", device.headers, device.defines)
    out = [launcher.empty("out", 12 * 500) for _ in range(2)]
    uploaded = launcher.upload("points", device.local(points))
    launcher.run(kernel, (500,), device.params, uploaded, *out, np.int32(500))
    uv_distance, radiance = (launcher.download(buffer, (500, 3), np.float32) for buffer in out)

    expected = reference.unshadowed(device.scene.volume, light, points)

    assert np.abs(uv_distance[:, :2] - uv).max() < 1e-5
    assert np.allclose(uv_distance[:, 2], np.linalg.norm(points - matrix[:3, 3], axis=1), rtol=1e-6)
    assert np.allclose(radiance, expected, rtol=1e-4, atol=1e-5)


def test_texel_rays_point_where_light_at_looks_them_up(launcher, rng):
    device = Device(launcher)
    light = device.scene.lights[0]
    uv = rng.uniform(0, 1, (300, 2)).astype(np.float32)
    directions = device.run("call_light_texel_ray", 300, uv, ..., shape=(300, 3))
    points = np.asarray(light.from_) + directions * 2.5
    kernel = launcher.kernels.kernel("call_light_at", "device_functions.cl", device.headers, device.defines)
    out = [launcher.empty("out", 12 * 300) for _ in range(2)]
    uploaded = launcher.upload("points", device.local(points))
    launcher.run(kernel, (300,), device.params, uploaded, *out, np.int32(300))

    assert np.abs(launcher.download(out[0], (300, 3), np.float32)[:, :2] - uv).max() < 1e-5


def phases():
    return [Isotropic(), *(HenyeyGreenstein(g) for g in (-0.99, -0.4, 0.0, 0.3, 0.8, 0.99))]


@pytest.mark.parametrize("phase", phases(), ids=str)
def test_phase_functions(launcher, phase):
    device = Device(launcher, make_scene(medium=tfm.Medium(phase=phase)))
    mu = np.concatenate([np.linspace(-1, 1, 999), [1.0]]).astype(np.float32)

    values = device.run("call_phase_eval", 1000, mu, ..., shape=(1000,))

    # The peak divides by (1 - |g|)³, and g is rounded once.
    worst = 10 * FLOAT32 / (1 - abs(getattr(phase, "g", 0.0)))
    assert np.allclose(values, phase.evaluate(mu), rtol=worst)
    assert {type(one) for one in phases()} == set(PHASES.values())


@pytest.mark.parametrize("phase", phases(), ids=str)
def test_phase_functions_integrate_to_1(phase):
    integral, _ = integrate.quad(lambda mu: float(phase.evaluate(mu)), -1, 1, epsabs=1e-9, limit=1000)

    assert 2 * np.pi * integral == pytest.approx(1, abs=1e-6)


def test_warp_is_exactly_projective_and_ends_exactly(launcher, rng):
    device = Device(launcher)
    depths = rng.uniform(0.5, 1.5, (1000, 2)).astype(np.float32)
    s = rng.uniform(0, 1, 1000).astype(np.float32)
    s[:4] = 0, 1, 0, 1

    t = device.run(
        "call_warp_fraction", 1000, depths, s, ..., np.float32(4), shape=(1000,), with_params=False
    )

    # A point at fraction t has depth w(t) = (1-t) wA + t wB; its projection lies at s = t wB / w(t).
    w_a, w_b = depths.T.astype(np.float64)
    assert np.allclose(t * w_b / ((1 - t) * w_a + t * w_b), s, atol=DEVICE_FUNCTION)
    assert t[:4].tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("max_stretch", [1.0, 4.0, 50.0])
@pytest.mark.parametrize("depths", [(0, 1), (1, 0), (1e-6, 3), (0, 0), (2, 2)])
def test_no_step_is_longer_than_max_stretch_mean_steps(launcher, max_stretch, depths):
    device = Device(launcher)
    s = np.linspace(0, 1, 1001).astype(np.float32)

    t = device.run(
        "call_warp_fraction",
        1001,
        np.tile(np.float32(depths), (1001, 1)),
        s,
        ...,
        np.float32(max_stretch),
        shape=(1001,),
        with_params=False,
    )

    steps = np.diff(t.astype(np.float64)) * 1000
    assert t[0] == 0
    assert t[-1] == 1
    assert steps.min() >= 0
    assert steps.max() <= max_stretch * 1.001


@pytest.mark.parametrize("tau", [1e-3, 0.5, 4.0, 30.0])
@pytest.mark.parametrize("alpha", [1.0, 10.0])
def test_dct_of_an_exponential_has_the_closed_form(launcher, tau, alpha):
    coeffs, steps = 16, 1000
    device = Device(launcher, coeffs=coeffs, density_weighting=alpha)
    assert device.scene.map.steps >= coeffs
    u = (np.arange(steps) + 0.5) / steps
    depths = (tau * u).astype(np.float32)[None]
    settings = resolve(tfm.MapSettings(basis="dct", coeffs=coeffs, steps=steps))
    table = BASES["dct"].table(Cosines(coeffs, of_extinction=False), settings, steps)

    c = device.run("call_basis_project", 1, depths, ..., np.int32(steps), table, shape=(1, coeffs))[0]

    # bases/dct.py: the closed form for e^{-τu}, with τ/α for the weighted transmittance.
    k, j = tau / alpha, np.arange(coeffs)
    expected = 2 * k * (1 - (-1.0) ** j * np.exp(-k)) / (k**2 + (j * np.pi) ** 2)
    expected[0] = (1 - np.exp(-k)) / k
    # Each addition may round by half an ulp of the sum, and the midpoint rule is off by τ²/24 M² per τ.
    rounding, midpoints = steps * FLOAT32, (k**2 + (coeffs * np.pi) ** 2) / (24 * steps**2)
    assert np.abs(c - expected).max() < (rounding + 2 * midpoints) * min(1, k)


@pytest.mark.parametrize("coeffs", [1, 2, 3, 8, 16, 31, 32])
def test_basis_evaluates_every_size(launcher, rng, coeffs):
    device = Device(launcher, coeffs=coeffs, density_weighting=3.0)
    c = rng.normal(size=(400, coeffs)).astype(np.float32) * 0.1 / coeffs
    c[:, 0] = rng.uniform(0.3, 0.7, 400)
    u = rng.uniform(0, 1, 400).astype(np.float32)
    u[:2] = 0, 1

    depths = device.run("call_basis_optical_depth", 400, c, u, ..., shape=(400,))

    f = (c * np.cos(np.pi * np.arange(coeffs) * u[:, None].astype(np.float64))).sum(axis=1)
    assert 0 < f.min() < f.max() < 1
    assert np.abs(depths - -3.0 * np.log(f)).max() < 3.0 * RECURRENCE / f.min()


def test_basis_clamps_before_the_power(launcher):
    device = Device(launcher, coeffs=2, density_weighting=10.0)
    c = np.float32([[-0.05, 0], [1.2, 0], [0, 0], [np.float32(1e-30), 0]])

    depths = device.run("call_basis_optical_depth", 4, c, np.zeros(4, np.float32), ..., shape=(4,))

    assert np.isfinite(depths).all()
    assert depths[0] == depths[2] > 800  # below 0: dark, not a bright ghost
    assert depths[1] == 0  # above 1: clear


@pytest.mark.parametrize(("bits", "error"), [(32, 0.0), (16, 2.0**-11), (8, 0.51 / 255)])
def test_map_storage_error(launcher, rng, bits, error):
    values = rng.uniform(-1, 1, (200, 4)).astype(np.float32)
    values[:, 3] = 0.25  # a coefficient that does not vary
    ranges = np.stack([values.min(axis=0), np.ptp(values, axis=0)], axis=1)
    device = Device(launcher, coeffs=4, storage_bits=bits)
    kernel = launcher.kernels.kernel(
        "call_map_storage", "device_functions.cl", device.headers, device.defines
    )
    loaded = launcher.empty("loaded", values.nbytes)
    launcher.run(
        kernel,
        (200,),
        launcher.upload("values", values),
        launcher.upload("ranges", ranges),
        launcher.empty("map", values.nbytes * bits // 32),
        loaded,
        np.int32(200),
    )

    difference = np.abs(launcher.download(loaded, values.shape, np.float32) - values)

    # f16 rounds to 11 bits, relative to at most 1; u8 to half a step of 1/255 of the extent (≤ 2).
    assert difference.max() <= error * (2 if bits == 8 else 1) + FLOAT32
    assert bits == 32 or difference.max() > 0


def test_optical_depth_of_a_march(launcher):
    device = Device(launcher)
    volume = device.scene.volume
    origins = device.centre + np.array([[0.0, 0, 3], [0.2, -0.1, 3], [0, 0.3, 3]])
    directions = unit(np.array([[0, 0, -1.0], [0.02, 0, -1], [-0.05, -0.1, -1]]))

    depths = device.run(
        "call_march_optical_depth",
        3,
        GRID,
        device.local(origins),
        directions.astype(np.float32),
        ...,
        np.float32(1.0),
        np.float32(5.0),
        np.int32(200),
        shape=(3,),
    )

    t = 1 + (np.arange(200) + 0.5) * 4 / 200
    points = origins[:, None] + t[None, :, None] * directions[:, None]
    expected = reference.density(volume, points).sum(axis=1) * 4 / 200
    assert expected.min() > 0.5
    assert np.allclose(depths, expected, rtol=1e-5)


def test_opacity_keeps_its_digits(launcher):
    depths = np.concatenate([[0, 0.25, np.nextafter(0.25, 0), 100, 1e30], np.logspace(-30, 2, 2000)])
    depths = depths.astype(np.float32)

    opacities = Device(launcher).run(
        "call_opacity_of", len(depths), depths, ..., shape=depths.shape, with_params=False
    )

    # Beyond 0.25, 1 - e^-τ rounds e^-τ ≤ 0.78 once more: 0.78 / 0.22 half ulps.
    assert np.allclose(opacities, -np.expm1(-depths.astype(np.float64)), rtol=8 * FLOAT32, atol=0)
    assert opacities.max() == 1
