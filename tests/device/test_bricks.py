"""The volume on the device: what was put into the bricks comes out of them, and only that takes memory."""

import itertools
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kernel_calls import GridCalls
from scenes import make_scene
from scipy import ndimage
from tolerances import DEVICE_FUNCTION

import tfm_cl as tfm
from tfm_cl import reference
from tfm_cl.constants import BLOCK_NUMBERS
from tfm_cl.device import bricks as module
from tfm_cl.device.bricks import (
    ONE_FIELD,
    brick_count_of,
    brick_table,
    build_bricks,
    device_bytes,
    record_bytes,
)
from tfm_cl.device.launch import Launcher
from tfm_cl.errors import DeviceMemoryError
from tfm_cl.files.volume_io.leaves import Leaves

pytestmark = pytest.mark.lanes

VOXELS = ["f32", "f16", "u8"]
HALF = 2.0**-11
"""Half a unit in the last place of a half, relative."""
HALF_DENORMAL = 3e-8
"""Half the least denormal half, where the largest voxel is stored as 1."""
BYTE = 1 / 510
"""Half a step of 255."""
REACH = 11
"""Voxels along an edge of a record, at most: whose largest one 255 stands for."""


# ----------------------------------------------------------------------------------------------- table


def table_by_hand(flags, farthest):
    """Numbers of blocks, in their order, and minus chessboard distances, found the slow way."""
    numbers, found = {}, np.argwhere(flags)
    for z, y, x in found // module.BLOCK_BRICKS:
        numbers.setdefault((int(z), int(y), int(x)), None)
    numbers = {block: 1 + n for n, block in enumerate(sorted(numbers))}
    table = np.zeros(flags.shape, np.int32)
    for place in np.ndindex(flags.shape):
        if flags[place]:
            table[place] = numbers[tuple(i // module.BLOCK_BRICKS for i in place)]
        else:
            nearest = np.abs(found - place).max(axis=1).min(initial=farthest)
            table[place] = -min(nearest, farthest)
    return table


def blocks_of(flags):
    z, y, x = (n // module.BLOCK_BRICKS for n in flags.shape)
    return flags.reshape(z, 2, y, 2, x, 2).any(axis=(1, 3, 5))


def flags_of(blocks, seed, share):
    """Bricks of which about a share has density; of whole blocks."""
    rng = np.random.default_rng(seed)
    return rng.random([module.BLOCK_BRICKS * n for n in blocks]) < share


all_flags = st.builds(
    flags_of,
    st.tuples(*[st.integers(1, 6)] * 3),
    st.integers(0, 999),
    st.sampled_from([0.0, 0.004, 0.02, 0.3, 1.0]),
)


@given(all_flags)
def test_table_is_the_chessboard_distance(flags):
    table = brick_table(flags, blocks_of(flags))

    assert table.dtype == np.int32
    assert (table == table_by_hand(flags, module.FARTHEST)).all()


@given(all_flags, st.integers(1, 99), st.sampled_from([1, 3]))
def test_blocks_of_several_records_are_numbered_by_their_first(flags, first, records):
    table = brick_table(flags, blocks_of(flags), first, records)

    expected = table_by_hand(flags, module.FARTHEST)
    assert (table == np.where(expected > 0, first + records * (expected - 1), expected)).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_distances_stop_at_the_farthest(axis):
    shape = [2, 2, 2]
    shape[axis] = 4 * module.FARTHEST
    flags = np.zeros(shape, np.bool_)
    flags[0, 0, 0] = True

    table = brick_table(flags, blocks_of(flags))

    assert (table == table_by_hand(flags, module.FARTHEST)).all()
    assert table.min() == -module.FARTHEST


@given(st.lists(st.tuples(all_flags, st.sampled_from([1, 3])), min_size=1, max_size=3))
def test_every_record_knows_its_block_and_the_ones_after_it(grids):
    blocks = [blocks_of(flags) for flags, _ in grids]
    channels = [count for _, count in grids]
    records = 1 + sum(count * int(of_grid.sum()) for of_grid, count in zip(blocks, channels, strict=True))

    places = module._places(blocks, channels, records)

    first, expected = 1, np.zeros((records, BLOCK_NUMBERS), np.int32)
    expected[:, 3] = -1  # the zero record, and those of further channels
    for grid, (has_density, step) in enumerate(zip(blocks, channels, strict=True)):
        corners = [tuple(corner) for corner in np.argwhere(has_density).tolist()]
        numbers = {corner: first + step * n for n, corner in enumerate(corners)}
        for (z, y, x), number in numbers.items():
            after = [numbers.get((z + k, y + j, x + i), 0) for k, j, i in itertools.product((0, 1), repeat=3)]
            expected[number] = [x, y, z, grid, 0, *after[1:]]
        first += step * len(corners)
    assert places.dtype == np.int32
    assert (places == expected).all()


@pytest.mark.parametrize("channels", [1, 3])
def test_records_lie_where_the_table_says(launcher, channels):
    shape = (20, 9, 33)
    volumes = [a_rainbow(shape, 5, 0.1) if channels == 3 else a_volume(clumps(shape, 5, 0.1))] * 2
    built = build_bricks(launcher, [volume.channel_leaves for volume in volumes], "the volumes", "f32")
    places = launcher.download(built.blocks, (built.records, BLOCK_NUMBERS), np.int32)

    start, seen = 0, set()
    table = launcher.download(built.table, (int(built.table.size) // 4,), np.int32)
    for grid, count in enumerate(built.brick_counts):
        bricks = table[start : start + int(np.prod(count))].reshape(count[::-1])
        start += int(np.prod(count))
        for z, y, x in np.argwhere(bricks > 0):
            record = bricks[z, y, x]
            seen.add(int(record))
            assert places[record, :4].tolist() == [*(n // module.BLOCK_BRICKS for n in (x, y, z)), grid]
    assert seen == set(np.flatnonzero(places[:, 3] >= 0).tolist())


# --------------------------------------------------------------------------------------- back to points


class OnDevice:
    """A volume in bricks, and its density read back by the function that the marches read it with."""

    def __init__(self, launcher, volume, voxels="f32", *, skip_empty=True):
        scene = make_scene(volume=volume, march=tfm.MarchSettings(skip_empty=skip_empty, voxels=voxels))
        self.channels = len(volume.channel_leaves)
        defines = ONE_FIELD | {"TFM_AMOUNTS": self.channels}
        self._calls = GridCalls(launcher, scene, voxels, defines)
        self.bricks = self._calls.bricks
        self.centre = volume.bounds.mean(axis=0)

    def densities(self, points, length=1.0):
        """Optical depths of marches of one step that stay at world points [N, 3], over their length.

        [N], or [N, 3] of a volume with a colour.
        """
        shape = () if self.channels == 1 else (self.channels,)
        rays = np.concatenate([points - self.centre, np.zeros_like(points)], axis=1)
        # In parts: the buffers of some devices here are small.
        parts = [
            self._calls("call_march_amounts", rays[n : n + 1024], *shape, begin=0, end=length, steps=1)
            for n in range(0, len(points), 1024)
        ]
        return np.concatenate(parts) / length


def a_volume(voxels):
    """Voxel (x, y, z) lies at (x, y, z) in the world."""
    return tfm.Volume(voxels, world_from_index=np.eye(4))


def leaves_of(data, first=(0, 0, 0)):
    """Leaves of an array whose voxel (0, 0, 0) lies at ``first`` in its leaf."""
    padded = Leaves.from_dense(np.pad(data, [(offset, 0) for offset in first]))
    return Leaves(data.shape, first, padded.coordinates, padded.values)


def points_of(shape, rng, count=4096):
    """Points in and around a grid whose coordinates, of unit voxels, are exact in float32.

    Lanes take what lies beside each other in the list: a half is scattered, and the other one is in groups as
    close as tiles are: within 1, 2, 4 or 30 voxels.
    """
    upper = np.array(shape[::-1])
    scattered = rng.uniform(-1.7, upper + 0.7, (count // 2, 3))
    groups = count // 2 // 32
    spread = rng.choice([0.0, 1.0, 2.0, 4.0, 30.0], (groups, 1, 1))
    near = rng.uniform(-1.5, upper + 0.5, (groups, 1, 3)) + spread * rng.uniform(-0.5, 0.5, (groups, 32, 3))
    corners = list(itertools.product(*((-1.0, -0.5, 0.0, n / 2, n - 1.0, n - 0.5, n) for n in upper)))
    return np.round(np.concatenate([scattered, near.reshape(-1, 3), corners]) * 256) / 256


def around(data, points, size, filtered=ndimage.maximum_filter):
    """Largest voxel in the cube of ``size`` around each point."""
    wide = filtered(np.pad(data, REACH), size, mode="constant")
    place = np.clip(np.rint(points).astype(int), -REACH, np.array(data.shape[::-1]) + REACH - 1) + REACH
    return wide[tuple(place[:, ::-1].T)].astype(np.float64)


def check(launcher, volume, data, rng, voxels="f32", *, skip_empty=True):
    """Compare densities at random points with NumPy's, to what the type of the voxels promises."""
    device = OnDevice(launcher, volume, voxels, skip_empty=skip_empty)
    points = points_of(data.shape, rng)
    found, expected = device.densities(points), reference.density(volume, points)
    near = around(data, points, 5)
    bound = DEVICE_FUNCTION * near
    if voxels == "f16":
        bound += HALF * near + HALF_DENORMAL * float(data.max())
    elif voxels == "u8":
        bound += BYTE * around(data, points, 2 * REACH + 1)
    else:
        assert ((found > 0) == (expected > 0)).all()
    wrong = np.abs(found - expected) > bound
    assert not wrong.any(), (points[wrong][0], found[wrong][0], expected[wrong][0])
    return device


def clumps(shape, seed, share):
    """Random voxels between 0.5 and 1.5, of which a share is there, each by itself or in a leaf's company."""
    rng = np.random.default_rng(seed)
    return (rng.uniform(0.5, 1.5, shape) * (rng.random(shape) < share)).astype(np.float32)


SHAPES = [(1, 1, 1), (3, 5, 7), (8, 8, 8), (9, 16, 17), (33, 7, 8), (15, 33, 9), (17, 6, 33), (1, 40, 1)]


@pytest.mark.parametrize("voxels", VOXELS)
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("share", [1.0, 0.05])
def test_density_of_awkward_shapes(launcher, rng, shape, share, voxels):
    data = clumps(shape, 5, share)
    data[(-1, -1, -1)] = 1.0

    check(launcher, a_volume(data), data, rng, voxels)


@pytest.mark.parametrize("shape", SHAPES[1:6], ids=str)
def test_density_without_skipping(launcher, rng, shape):
    data = clumps(shape, 6, 0.02)
    data[0, 0, 0] = 1.0

    check(launcher, a_volume(data), data, rng, skip_empty=False)


@pytest.mark.parametrize("voxels", VOXELS)
@pytest.mark.parametrize("first", [(1, 0, 0), (0, 7, 3), (7, 7, 7), (4, 1, 6)], ids=str)
def test_density_where_the_grid_begins_inside_a_leaf(launcher, rng, first, voxels):
    data = clumps((9, 20, 18), 7, 0.1)
    data[0, 0, 0] = data[-1, -1, -1] = 1.5
    volume = a_volume(leaves_of(data, first))

    check(launcher, volume, data, rng, voxels)


@pytest.mark.parametrize("shape", [(9, 16, 17), (8, 7, 24)], ids=str)
def test_a_lone_voxel_in_each_corner(launcher, rng, shape):
    for corner in itertools.product((0, -1), repeat=3):
        data = np.zeros(shape, np.float32)
        data[corner] = 3.0
        check(launcher, a_volume(data), data, rng)


@pytest.mark.parametrize("place", [3, 4, 5, 6, 7, 8, 9, 10, 11])
def test_a_lone_voxel_beside_the_borders_of_bricks_and_blocks(launcher, rng, place):
    data = np.zeros((20, 20, 20), np.float32)
    data[place, place, place] = 2.0
    device = check(launcher, a_volume(data), data, rng)

    # All around it, as close as its density reaches: every point in a tile with others.
    grid = np.arange(-1.125, 1.126, 0.125) + place
    points = np.stack(np.meshgrid(grid, grid, grid, indexing="ij"), axis=-1).reshape(-1, 3)
    expected = 2.0 * np.clip(1 - np.abs(points - place), 0, None).prod(axis=1)
    assert np.abs(device.densities(points) - expected).max() <= DEVICE_FUNCTION * 2.0


def test_8_bits_span_what_lies_near(launcher, rng):
    # A block that is a million times brighter takes nothing from a dim one far away.
    data = np.zeros((12, 12, 60), np.float32)
    data[2:10, 2:10, 2:10] = rng.uniform(0.5, 1, (8, 8, 8))
    data[2:10, 2:10, 48:56] = 1e6

    check(launcher, a_volume(data), data, rng, "u8")


@pytest.mark.parametrize("exponent", [-100, -20, 0, 20, 100])
def test_values_that_are_halves_are_exact_in_16_bits(launcher, rng, exponent):
    shape = (9, 10, 17)
    halves = rng.uniform(0.01, 15, shape).astype(np.float16).astype(np.float32)
    halves[rng.random(shape) < 0.3] = 0
    data = np.ldexp(halves, exponent)
    volume = a_volume(data)
    device = OnDevice(launcher, volume, "f16")

    places = np.argwhere(np.ones(shape))[:, ::-1]
    # A short step: optical depths end at 1e30.
    assert (device.densities(places, 2.0**-20) == data.ravel()).all()
    assert device.bricks.exponents[0][0] == np.floor(np.log2(data.max()))


@pytest.mark.parametrize("voxels", VOXELS)
@pytest.mark.parametrize("largest", [3e38, 1e-30, 1e-37, 1e-44], ids=str)
def test_the_largest_and_the_least_densities(launcher, voxels, largest):
    data = np.zeros((9, 9, 9), np.float32)
    data[4, 4, 4], data[4, 4, 5] = largest, largest / 2
    data[1, 1, 1] = 1e-45
    device = OnDevice(launcher, a_volume(data), voxels)

    points = np.array([[4.0, 4, 4], [5, 4, 4], [7, 7, 7]])
    # Optical depths end at 1e30.
    at, beside, dark = device.densities(points, 2.0**-40 if largest > 1e30 else 1.0)

    # Denormal numbers: to one of them, where the device has them.
    denormal = 2 * float(np.finfo(np.float32).tiny) if largest < 1e-36 else 0.0
    assert at == pytest.approx(float(data[4, 4, 4]), rel=2 * HALF, abs=denormal)
    assert beside == pytest.approx(float(data[4, 4, 5]), rel=2 * BYTE, abs=denormal)
    assert dark == 0


@pytest.mark.parametrize("voxels", VOXELS)
def test_an_empty_volume(launcher, rng, voxels):
    data = np.zeros((9, 17, 8), np.float32)

    device = check(launcher, a_volume(data), data, rng, voxels)

    assert device.bricks.occupied == 0
    assert device.densities(points_of(data.shape, rng)).max() == 0


# ---------------------------------------------------------------------------------------------- memory


def test_memory_follows_density(launcher):
    shape = (600, 600, 600)
    ball = np.linalg.norm(np.indices((24, 24, 24)) - 11.5, axis=0) < 11
    values = ball.reshape(3, 8, 3, 8, 3, 8).transpose(0, 2, 4, 1, 3, 5).reshape(27, 8, 8, 8)
    places = np.argwhere(np.ones((3, 3, 3)))
    leaves = Leaves(
        shape,
        (0, 0, 0),
        np.concatenate([places, places + 72]).astype(np.int32),
        np.concatenate([values, values]).astype(np.float32),
    )

    built = build_bricks(launcher, [(leaves,)], "the volume", "f32")

    table = 4 * int(np.prod(brick_count_of(shape)))
    # A ball meets at most 5 blocks along an axis, wherever it lies.
    most = 2 * 5**3 + 1
    assert 2 < built.records <= most
    assert table < built.nbytes <= table + most * record_bytes(launcher.lanes, "f32")
    assert built.nbytes < 4 * np.prod(shape, dtype=np.int64) / 50


@pytest.mark.parametrize("voxels", VOXELS)
def test_records_take_the_bytes_of_their_voxels(launcher, voxels):
    one = build_bricks(launcher, [(leaves_of(np.ones((3, 3, 3), np.float32)),)], "v", voxels)

    edge = 9 if launcher.lanes == 1 else REACH
    least = 2 * edge**3 * {"f32": 4, "f16": 2, "u8": 1}[voxels]
    assert one.records == 2
    # Beside them, the table of 8 bricks, and where each record's block is.
    assert least <= one.nbytes - 4 * 8 - one.records * 4 * BLOCK_NUMBERS <= 1.02 * least


def test_twice_the_density_takes_twice_the_records(launcher):
    one = np.zeros((8, 8, 200), np.float32)
    one[3:5, 3:5, 10] = 1
    two = one.copy()
    two[3:5, 3:5, 170] = 1

    records = [build_bricks(launcher, [(leaves_of(data),)], "v", "f32").records - 1 for data in (one, two)]

    assert records[1] == 2 * records[0] == 2


def a_rainbow(shape, seed, share):
    """Coloured voxels: where the density is there is some of each colour, but for a corner without blue."""
    density = clumps(shape, seed, share)
    z, y, x = np.meshgrid(*(np.linspace(0, 1, n) for n in shape), indexing="ij")
    colour = np.stack([1.5 - 1.4 * x, 0.6 + 0.5 * np.sin(7 * y + 2 * z), 0.1 + 1.2 * x * z], axis=-1)
    colour[: shape[0] // 3, ..., 2] = 0
    return tfm.Volume(density, world_from_index=np.eye(4), colour=colour)


def check_colours(launcher, volume, rng, voxels):
    """Compare the densities of the three channels at random points with NumPy's."""
    device = OnDevice(launcher, volume, voxels)
    points = points_of(volume.shape, rng, 2048)
    found = device.densities(points)
    for c, channel in enumerate(volume.channels):
        data = channel.data
        near = around(data, points, 5)
        bound = DEVICE_FUNCTION * near
        if voxels == "f16":
            bound += HALF * near + HALF_DENORMAL * float(data.max())
        elif voxels == "u8":
            bound += BYTE * around(data, points, 2 * REACH + 1)
        assert (np.abs(found[:, c] - reference.density(channel, points)) <= bound).all(), c
    assert (found.max(axis=0) > 0.1).all()
    return device


@pytest.mark.quick("f32", "u8")
@pytest.mark.parametrize("voxels", VOXELS)
def test_colours_of_voxels(launcher, rng, voxels):
    volume = a_rainbow((20, 9, 33), 5, 0.1)

    device = check_colours(launcher, volume, rng, voxels)

    # Three records for every block that any colour is in, and the one that is all zero.
    grey = build_bricks(launcher, [(leaves_of(volume.channels[0].data),)], "the volume", voxels)
    assert device.bricks.records == 1 + 3 * (grey.records - 1)
    assert device.bricks.channels == 3
    assert device.bricks.nbytes == device_bytes(volume.channel_leaves, launcher.lanes, voxels)


def test_a_coloured_grid_beside_grey_ones(launcher, rng):
    grids = [
        a_volume(clumps((9, 9, 9), 1, 0.3)),
        a_rainbow((9, 10, 11), 2, 0.3),
        a_volume(clumps((8, 8, 8), 3, 1)),
    ]
    built = build_bricks(launcher, [grid.channel_leaves for grid in grids], "the volumes", "f32")
    alone = [build_bricks(launcher, [grid.channel_leaves], "the volume", "f32") for grid in grids]
    calls = GridCalls(launcher, make_scene(volume=grids), "f32", ONE_FIELD | {"TFM_AMOUNTS": 3})
    centre = np.concatenate([grid.bounds for grid in grids]).reshape(-1, 2, 3)
    centre = (centre[:, 0].min(axis=0) + centre[:, 1].max(axis=0)) / 2
    points = points_of((10, 11, 12), rng, 1024)

    found = calls("call_densities_at", points - centre, 3)

    assert built.records == 1 + sum(one.records - 1 for one in alone)
    assert [len(exponents) for exponents in built.exponents] == [1, 3, 1]
    coloured = np.stack([reference.density(part, points) for part in grids[1].channels], axis=-1)
    # What has no colour adds the same to all three.
    expected = coloured + sum(reference.density(grid, points) for grid in grids[::2])[:, None]
    assert np.abs(found - expected).max() <= 3 * DEVICE_FUNCTION * 1.5


def several_pools(launcher, nbytes):
    """The same device, whose buffers are small."""
    folder = Path(__file__).resolve().parents[1] / "kernels"
    options = "-Werror", "-I", str(folder)  # as the fixture's: what it has compiled is not compiled again
    return Launcher(launcher.device, options, lanes=launcher.lanes, largest_buffer=nbytes)


@pytest.mark.quick("f16")
@pytest.mark.parametrize("voxels", VOXELS)
def test_density_in_several_pools_uploaded_layer_by_layer(launcher, rng, voxels):
    data = clumps((160, 10, 12), 9, 0.05)
    data[60:90] = 0
    volume = a_volume(leaves_of(data, (5, 0, 2)))
    whole = OnDevice(launcher, a_volume(data), voxels)
    size = record_bytes(launcher.lanes, voxels)
    # The leaves of a layer of blocks have to fit as well.
    small = several_pools(launcher, max(size * -(-whole.bricks.records // 7), 26_000))

    parts = check(small, volume, data, rng, voxels)

    points = points_of(data.shape, rng)
    assert (parts.densities(points) == whole.densities(points)).all()
    assert 2 <= len(parts.bricks.pools) <= 7
    assert parts.bricks.defines["TFM_POOLS"] == 8
    assert whole.bricks.defines["TFM_POOLS"] == 1
    assert parts.bricks.records == whole.bricks.records
    assert parts.bricks.occupied == whole.bricks.occupied


@pytest.mark.quick("u8")
@pytest.mark.parametrize("voxels", VOXELS)
def test_colours_in_several_pools(launcher, rng, voxels):
    volume = a_rainbow((90, 10, 12), 9, 0.05)
    whole = OnDevice(launcher, volume, voxels)
    # Of three pools one at least ends between the three records of a block, the first record being alone.
    size = record_bytes(launcher.lanes, voxels) * -(-whole.bricks.records // 6)
    small = several_pools(launcher, max(size, 26_000))

    parts = check_colours(small, volume, rng, voxels)

    points = points_of(volume.shape, rng, 2048)
    assert (parts.densities(points) == whole.densities(points)).all()
    assert 3 <= len(parts.bricks.pools) <= 7


@pytest.mark.slow
@pytest.mark.parametrize("pools", [2, 5, 8])
def test_pools_do_not_show(device_name, launcher, pools):
    data = clumps((160, 40, 40), 60, 0.3)  # a pool holds more than a light's coarse ranges
    camera = tfm.Camera(from_=(100, 60, 40), to=(6, 6, 80), fov=60, res=(33, 26))
    light = tfm.SpotLight(from_=(40, 120, 20), to=(6, 6, 80), cone=30)
    scene = tfm.Scene(
        tfm.Volume(data, density_scale=0.3),
        camera=camera,
        lights=[light],
        map=tfm.MapSettings(basis="dct", density_weighting=10.0, res=20, steps=40),
        march=tfm.MarchSettings(steps=50),
    )
    lanes = launcher.lanes
    records = build_bricks(launcher, [scene.volume.channel_leaves], "the volume", "f32").records
    nbytes = record_bytes(lanes, "f32") * -(-records // pools)
    options = {"lanes": lanes, "build_options": ("-Werror",)}
    with tfm.Renderer(device_name, **options) as renderer:
        expected = renderer.render(scene)
    with tfm.Renderer(device_name, **options, largest_buffer=nbytes) as renderer:
        grid = build_bricks(renderer._launcher, [scene.volume.channel_leaves], "the volume", "f32")
        result = renderer.render(scene)

    assert len(grid.pools) == pools
    assert expected.image[..., :3].max() > 0.001
    assert (result.image == expected.image).all()
    for name, layer in expected.aovs.items():
        assert (result.aovs[name] == layer).all(), name


@pytest.mark.parametrize(("voxels", "hint"), [("f32", True), ("f16", True), ("u8", False)])
def test_too_many_pools_are_refused(launcher, voxels, hint):
    leaves = leaves_of(clumps((640, 16, 16), 11, 0.05))
    small = several_pools(launcher, 48_000)

    expected = r"^the cloud needs [\d.]+ MiB; .* allows 0\.4 MiB in 8 buffers"
    with pytest.raises(DeviceMemoryError, match=expected) as error:
        build_bricks(small, [(leaves,)], "the cloud", voxels)

    assert ("--voxels f16 or u8" in str(error.value)) == hint
