"""The OpenVDB reader against OpenVDB itself, against an encoder written for these tests, and under attack."""

import itertools
import math
import os
import re
import shutil
import struct
import tracemalloc
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import blosc
import numpy as np
import pytest
from memory import peak_of
from openvdb_reading import ask_openvdb, assert_is_what_openvdb_reads

from tfm_cl.cli.info import describe
from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import binary, choose_grid, open_grids, vdb
from tfm_cl.files.volume_io import tree as vdb_tree
from tfm_cl.files.volume_io.limits import MAX_LEAVES
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.optical_depth import density_scale_for
from tfm_cl.scene.placement import camera_for

ROOT = Path(__file__).resolve().parents[3]
DATA = Path(__file__).parent / "data"
VOLUMES = Path(os.environ.get("TFM_VOLUMES", ROOT.parent / "shared" / "volumes"))
FIXTURES = ("negative", "tiles", "half", "sphere", "several")
REAL = ("wdas_cloud_sixteenth", "cortex_smoke", "cortex_sphere")

ZIP, MASK, BLOSC = 1, 2, 4
LONGEST_MESSAGE = 500
"""Characters, whatever a file claims its names to be."""
SMALL = 1 << 22
"""Voxels that a test reads of a file whose shape it cannot know."""


# --------------------------------------------------------------------------- OpenVDB's own reading


def real_volume(name):
    path = VOLUMES / name
    if not path.exists():
        pytest.skip(f"{name} is not in {VOLUMES} (set TFM_VOLUMES)")
    return path


@pytest.mark.parametrize("name", FIXTURES)
def test_fixture_is_what_openvdb_reads(name):
    assert_is_what_openvdb_reads(DATA / f"{name}.vdb")


@pytest.mark.parametrize("name", REAL)
def test_real_volume_is_what_openvdb_reads(name, tmp_path):
    path = tmp_path / f"{name}.vdb"
    shutil.copyfile(real_volume(path.name), path)
    ask_openvdb(path)
    assert_is_what_openvdb_reads(path)


def test_descriptions_of_fixtures_are_current(tmp_path):
    paths = [Path(shutil.copyfile(DATA / f"{name}.vdb", tmp_path / f"{name}.vdb")) for name in FIXTURES]
    ask_openvdb(*paths)
    for path in paths:
        with np.load(path.with_suffix(".npz")) as new, np.load(DATA / f"{path.stem}.npz") as kept:
            assert set(new) == set(kept)
            assert all(np.array_equal(new[key], kept[key]) for key in new)


def test_several_grids_are_listed():
    grids = open_grids(DATA / "several.vdb")
    assert [(grid.name, grid.value_type, grid.unsupported) for grid in grids] == [
        ("density[0]", "float32", ""),
        ("density[1]", "float32", ""),
        ("shared", "float32", ""),
        ("mask", "bool", ""),
        ("velocity", "vec3s", vdb_tree.VECTORS),
        ("", "float", "a frustum transform; resample the grid to a linear one first"),
    ]
    with pytest.raises(VolumeError, match=r"'velocity' cannot be read: vectors.*volume\.colour=NAME"):
        grids[4].read()
    with pytest.raises(VolumeError, match=r"'velocity' cannot be rendered: vectors.*volume\.colour=NAME"):
        choose_grid(DATA / "several.vdb", "velocity")
    assert choose_grid(DATA / "several.vdb", "shared").active_voxels == 64


# ----------------------------------------------------------------------------- an encoder for tests

TYPES = {"float": "<f4", "double": "<f8", "half": "<f2", "int32": "<i4", "int64": "<i8", "bool": "u1"}
TYPES |= {"mask": "u1", "vec3s": "<f4,<f4,<f4", "vec3d": "<f8,<f8,<f8", "vec3i": "<i4,<i4,<i4"}
HALF = {"<f4": "<f2", "<f8": "<f2", TYPES["vec3s"]: "<f2,<f2,<f2", TYPES["vec3d"]: "<f2,<f2,<f2"}


@dataclass
class Tree:
    """What a written tree holds; `dense` paints it."""

    leaves: dict = field(default_factory=dict)
    """origin -> values, active: both [x, y, z] of 8³."""
    tiles: dict = field(default_factory=dict)
    """(origin, edge) -> value, active."""
    background: float = 0.0
    type: str = "float"
    half: bool = False
    compression: int = MASK
    transform: bytes = b""
    version: int = 224

    @property
    def dtype(self):
        return np.dtype(TYPES[self.type])

    def box(self):
        cubes = [(np.array(o), 8) for o in self.leaves]
        cubes += [(np.array(o), e) for (o, e), (v, _) in self.tiles.items() if v != self.background]
        return np.min([o for o, _ in cubes], axis=0), np.max([o + e for o, e in cubes], axis=0)

    def dense(self):
        """float32 [z, y, x], of vectors [z, y, x, 3]."""
        low, high = self.box()
        dense = np.full(high - low, np.array(self.background, self.dtype))
        cubes = [(origin, 8, values) for origin, (values, _) in self.leaves.items()]
        cubes += [(origin, edge, value) for (origin, edge), (value, _) in self.tiles.items()]
        for origin, edge, values in cubes:
            at = np.array(origin) - low
            if (at >= 0).all() and (at + edge <= dense.shape).all():
                dense[tuple(slice(a, a + edge) for a in at)] = values
        dense = dense.transpose(2, 1, 0)
        names = dense.dtype.names
        return np.stack([dense[n] for n in names], -1) if names else dense.astype(np.float32)

    def active_voxels(self):
        in_leaves = sum(int(active.sum()) for _, active in self.leaves.values())
        return in_leaves + sum(edge**3 for (_, edge), (_, active) in self.tiles.items() if active)


def bits(flags):
    return np.packbits(np.asarray(flags, bool), bitorder="little").tobytes()


def text(string):
    data = string.encode()
    return struct.pack("<I", len(data)) + data


def packed(data, compression):
    if compression & BLOSC:
        chunk = blosc.compress(data, 1, 9, blosc.SHUFFLE, "lz4") if data else b""
        shorter = len(chunk) > 0
    elif compression & ZIP:
        chunk = zlib.compress(data)
        shorter = len(chunk) < len(data)
    else:
        return data
    return struct.pack("<q", len(chunk)) + chunk if shorter else struct.pack("<q", -len(data)) + data


def block(tree, values, active, children):
    """A node's values with the least that restores the inactive ones."""
    values, background = values.astype(tree.dtype), np.array(tree.background, tree.dtype).item()
    if tree.dtype.names:
        minus = tuple(-b for b in background)
    else:
        minus = int(not background) if tree.dtype == "u1" else -background
    other = np.unique(values[~active & ~children]).tolist()
    choice, stored = b"", []
    if not tree.compression & MASK or len(other) > 2:
        kind = 6
    elif len(other) < 2:
        kind = 0 if other in ([], [background]) else 1 if other == [minus] else 2
        stored = other if kind == 2 else []
    else:
        other.sort(key=lambda value: value == background)  # the background comes second
        kind = 5 if background not in other else 3 if other[0] == minus else 4
        stored = other if kind == 5 else other[:1] if kind == 4 else []
        choice = bits(~active & (values == np.array(other[1], tree.dtype)))
    kept = values if kind == 6 else values[active]
    if tree.version < 222:
        kind, choice, stored, kept = None, b"", [], values[~children]
    if tree.half and TYPES[tree.type] in HALF:
        kept = kept.astype(HALF[TYPES[tree.type]])
        data = packed(kept.tobytes(), tree.compression) if kept.size else b""
    else:
        data = packed(kept.tobytes(), tree.compression)
    return bytes([] if kind is None else [kind]) + np.array(stored, tree.dtype).tobytes() + choice + data


def encode_tree(tree, root_order=1):
    """Topology, the root's children in any order, and leaf buffers, always by the children's origins."""
    by_root = {}
    for origin, edge in [*((origin, 8) for origin in tree.leaves), *tree.tiles]:
        root = by_root.setdefault(tuple(c // 4096 * 4096 for c in origin), {})
        if edge == 8:
            root.setdefault(tuple(c // 128 * 128 for c in origin), None)
    root_tiles = [(o, *entry) for (o, edge), entry in tree.tiles.items() if edge == 4096]
    children = {o: lowers for o, lowers in sorted(by_root.items()) if (o, 4096) not in tree.tiles}
    topology = struct.pack("<i", 1) + np.array(tree.background, tree.dtype).tobytes()
    topology += struct.pack("<2I", len(root_tiles), len(children))
    for origin, value, active in root_tiles:
        topology += struct.pack("<3i", *origin) + np.array(value, tree.dtype).tobytes() + bytes([active])
    buffers, branches = b"", []
    for origin, lowers in children.items():
        branch = struct.pack("<3i", *origin) + encode_node(tree, origin, 32, 128, lowers)
        for lower in sorted(lowers):
            inside = {o for o in tree.leaves if tuple(c // 128 * 128 for c in o) == lower}
            branch += encode_node(tree, lower, 16, 8, inside)
            for leaf in sorted(inside):
                values, active = (array.ravel() for array in tree.leaves[leaf])
                branch += bits(active)
                buffers += bits(active)
                if tree.dtype == "u1" or tree.version < 222:
                    buffers += struct.pack("<3i", *leaf)
                if tree.dtype == "u1":
                    buffers += bits(values) if tree.type == "bool" else b""
                else:
                    buffers += b"\1" if tree.version < 222 else b""
                    buffers += block(tree, values, active, np.zeros(512, bool))
        branches.append(branch)
    return topology + b"".join(branches[::root_order]), buffers


def encode_node(tree, origin, dim, edge, children):
    def entry(corner):
        x, y, z = ((c - o) // edge for c, o in zip(corner, origin, strict=True))
        return (x * dim + y) * dim + z

    values, active = np.full(dim**3, np.array(tree.background, tree.dtype)), np.zeros(dim**3, bool)
    for (corner, tile_edge), (value, is_active) in tree.tiles.items():
        if tile_edge == edge and all(0 <= c - o < dim * edge for c, o in zip(corner, origin, strict=True)):
            values[entry(corner)], active[entry(corner)] = value, is_active
    has_child = np.zeros(dim**3, bool)
    has_child[[entry(corner) for corner in children]] = True
    return bits(has_child) + bits(active) + block(tree, values, active, has_child)


IDENTITY = text("TranslationMap") + struct.pack("<3d", 0, 0, 0)


def encode(trees, *, version=224, offsets=True, metadata=(), root_order=1):
    """A file of trees by unique name; before version 222 all are compressed as the first is."""
    trees = {name: replace(tree, version=version) for name, tree in trees.items()}
    out = struct.pack("<qIIIB", 0x56444220, version, 10, 0, offsets)
    if version < 222:
        out += bytes([next(iter(trees.values())).compression & ZIP])
    out += b"01234567-89ab-cdef-0123-456789abcdef"
    out += struct.pack("<I", 0) + struct.pack("<i", len(trees))
    for name, tree in trees.items():
        topology, buffers = encode_tree(tree, root_order)
        items = [("name", "string", name.encode()), *metadata]
        items += [("is_saved_as_half_float", "bool", b"\1")] if tree.half else []
        head = struct.pack("<I", tree.compression) if version >= 222 else b""
        head += struct.pack("<I", len(items))
        for key, kind, value in items:
            head += text(key) + text(kind) + struct.pack("<I", len(value)) + value
        head += tree.transform or IDENTITY
        out += text(name) + text(f"Tree_{tree.type}_5_4_3" + "_HalfFloat" * tree.half) + text("")
        at = len(out) + 24
        ends = np.cumsum([at, len(head) + len(topology), len(buffers)]) if offsets else (0, 0, 0)
        out += struct.pack("<3q", *ends) + head + topology + buffers
    return out


def random_tree(seed=0, **options):
    """Leaves in two nodes of the root, with inactive values of every kind, and active and inactive tiles."""
    rng = np.random.default_rng(seed)
    tree = Tree(**options)
    plus, is_bool = tree.background, tree.type == "bool"
    minus = 1 - plus if is_bool else -plus
    inactive = [[plus], [minus], [3], [plus, minus], [3, plus], [3, 4], [3, 4, 5]]
    for place, others in enumerate(inactive):
        origin = (-8 - 128 * (place % 2), 8 * place, 16 if place < 5 else -16)
        active = rng.random((8, 8, 8)) < (0.0, 0.3, 1.0)[place % 3]
        values = np.where(active, rng.integers(-99, 99, (8, 8, 8)) / 4, rng.choice(others, (8, 8, 8)))
        tree.leaves[origin] = (values.astype(bool) if is_bool else values.astype(tree.dtype), active)
    tree.tiles |= {((-24, 0, 0), 8): (1, True), ((-32, 0, 0), 8): (plus, True), ((-40, 8, 0), 8): (0, False)}
    return tree


def of_vectors(tree, kind):
    """A tree of vectors (v, 2v, -v) in the place of numbers v."""

    def vectors(v):
        found = np.empty(np.shape(v), TYPES[kind])
        for name, factor in zip(found.dtype.names, (1, 2, -1), strict=True):
            found[name] = factor * np.asarray(v)
        return found

    return replace(
        tree,
        type=kind,
        background=vectors(tree.background).item(),
        leaves={origin: (vectors(values), active) for origin, (values, active) in tree.leaves.items()},
        tiles={place: (vectors(value).item(), active) for place, (value, active) in tree.tiles.items()},
    )


def write(tmp_path, content, name="file.vdb"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def assert_reads(path, tree, index=0):
    grid = open_grids(path)[index]
    expected = tree.dense()
    assert grid.shape == expected.shape[:3]
    assert grid.active_voxels == tree.active_voxels()
    np.testing.assert_array_equal(grid.world_from_index[:3, 3], tree.box()[0])
    np.testing.assert_array_equal(grid.read_colour() if tree.dtype.names else grid.read(), expected)


STORAGE = list(itertools.product((0, ZIP, BLOSC), (0, MASK), (False, True)))


@pytest.mark.parametrize(("codec", "mask", "half"), STORAGE)
@pytest.mark.parametrize("background", [0.0, 0.5])
def test_storage(codec, mask, half, background, tmp_path):
    tree = random_tree(background=background, compression=codec | mask, half=half)
    assert_reads(write(tmp_path, encode({"density": tree})), tree)


def test_encoder_is_right(tmp_path):
    """OpenVDB reads the encoder's files as we do, so that they can stand for OpenVDB's."""
    paths = [
        write(
            tmp_path,
            encode({"a": random_tree(background=0.5, compression=codec | mask, half=half)}),
            f"{codec}{mask}{half:d}.vdb",
        )
        for codec, mask, half in STORAGE
    ]
    paths += [
        write(tmp_path, encode({"a": of_vectors(tree, "vec3s")}), f"vectors{half:d}.vdb")
        for half in (False, True)
        for tree in [random_tree(background=0.5, half=half)]
    ]
    paths += [
        write(
            tmp_path,
            encode({"a": random_tree(compression=codec, half=half, type=kind)}, version=version),
            f"{version}{codec}{half:d}{kind}.vdb",
        )
        for version, codec, half, kind in [
            *((220, 0, False, "float"), (221, ZIP, False, "float"), (221, ZIP, True, "float")),
            (221, ZIP, False, "bool"),
        ]
    ]
    ask_openvdb(*paths)
    for path in paths:
        assert_is_what_openvdb_reads(path)


@pytest.mark.parametrize("compression", [MASK, MASK | BLOSC, 0])
@pytest.mark.parametrize("kind", ["double", "half", "int32", "int64", "bool"])
def test_value_types(kind, compression, tmp_path):
    tree = random_tree(type=kind, background=1, compression=compression)
    path = write(tmp_path, encode({"density": tree}))
    assert_reads(path, tree)
    assert open_grids(path)[0].value_type == ("bool" if kind == "bool" else tree.dtype.name)


@pytest.mark.parametrize("compression", [MASK, MASK | BLOSC, ZIP])
@pytest.mark.parametrize(
    ("kind", "half"), [("vec3s", False), ("vec3s", True), ("vec3d", True), ("vec3i", False)]
)
def test_vectors_are_colours(kind, half, compression, tmp_path):
    tree = of_vectors(random_tree(background=1, compression=compression, half=half), kind)
    path = write(tmp_path, encode({"Cd": tree}))
    assert_reads(path, tree)
    (grid,) = open_grids(path)
    assert (grid.value_type, grid.colour_background) == (kind, (1, 2, -1))


def test_voxels_of_a_mask_are_1_where_it_is_active(tmp_path):
    active = np.random.default_rng(3).random((8, 8, 8)) < 0.3
    leaves = {(0, 8, -8): (active.astype("u1"), active)}
    tiles = {((128, 0, 0), 128): (1, True), ((0, 0, 0), 8): (1, True), ((0, 0, 8), 8): (0, False)}
    tree = Tree(type="mask", leaves=leaves, tiles=tiles)
    path = write(tmp_path, encode({"mask": tree}))
    assert_reads(path, tree)
    # A mask of another tree's topology leaves the values of active tiles off.
    off = replace(tree, tiles={place: (0, active) for place, (_, active) in tiles.items()})
    path.write_bytes(encode({"mask": off}))
    assert_reads(path, tree)
    assert choose_grid(path).value_type == "mask"


@pytest.mark.parametrize("version", [220, 221, 222, 223, 224, 225])
@pytest.mark.parametrize("offsets", [True, False])
def test_versions_and_streams(version, offsets, tmp_path):
    codec = BLOSC if version > 221 else ZIP
    trees = {
        "a": random_tree(1, compression=MASK | codec),
        "b": random_tree(2, type="bool", compression=MASK if version > 221 else ZIP),
        "c": of_vectors(random_tree(4, compression=MASK | codec, half=True), "vec3s"),
        "d": random_tree(3, compression=MASK if version > 221 else ZIP),
    }
    path = write(tmp_path, encode(trees, version=version, offsets=offsets))
    for index, tree in enumerate(trees.values()):
        assert_reads(path, tree, index)


def test_large_tiles(tmp_path):
    tree = Tree(tiles={((128, 0, -128), 128): (2, True), ((0, 0, 0), 128): (0, True)}, leaves={})
    tree.leaves[136, 128, 0] = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    path = write(tmp_path, encode({"density": tree}))
    assert_reads(path, tree)
    assert open_grids(path)[0].shape == (136, 136, 128)


def test_root_tiles_are_described_and_too_large_to_read(tmp_path):
    tree = Tree(tiles={((-4096, 0, 4096), 4096): (2, True), ((0, 0, 0), 4096): (0, True)})
    path = write(tmp_path, encode({"density": tree}))
    (grid,) = open_grids(path)
    assert grid.shape == (4096, 4096, 4096)
    assert grid.active_voxels == 2 * 4096**3
    with pytest.raises(VolumeError, match="limit"):
        choose_grid(path)
    with pytest.raises(VolumeError, match="limit"):
        grid.read()


def test_empty_tree(tmp_path):
    (grid,) = open_grids(write(tmp_path, encode({"density": Tree()})))
    assert (grid.shape, grid.active_voxels) == ((0, 0, 0), 0)
    assert grid.read().shape == (0, 0, 0)


def test_leaves_far_apart_have_a_huge_shape_and_cost_nothing(tmp_path):
    leaf = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    tree = Tree(leaves={(-(2**31), 0, 0): leaf, (2**31 - 8, 0, 0): leaf})
    path = write(tmp_path, encode({"density": tree}))
    tracemalloc.start()
    (grid,) = open_grids(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grid.shape == (8, 8, 2**32)
    assert peak < 4 << 20
    with pytest.raises(VolumeError, match="limit"):
        grid.read()


def test_order_of_root_children_does_not_matter_for_the_buffers(tmp_path):
    tree = random_tree()
    content = encode({"density": tree}, root_order=-1)
    assert content != encode({"density": tree})
    assert_reads(write(tmp_path, content), tree)


TRANSFORMS = {
    "UniformScaleMap": ([2, 2, 2] * 5, np.diag([2, 2, 2, 1])),
    "ScaleMap": ([2, 3, 4] * 5, np.diag([2, 3, 4, 1])),
    "UniformScaleTranslateMap": (
        [5, 6, 7] + [2, 2, 2] * 5,
        [[2, 0, 0, 5], [0, 2, 0, 6], [0, 0, 2, 7], [0, 0, 0, 1]],
    ),
    "ScaleTranslateMap": (
        [5, 6, 7] + [2, 3, 4] * 5,
        [[2, 0, 0, 5], [0, 3, 0, 6], [0, 0, 4, 7], [0, 0, 0, 1]],
    ),
    "TranslationMap": ([5, 6, 7], [[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]),
    "UnitaryMap": (
        [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1],
        [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
    ),
    "AffineMap": (
        [1, 2, 0, 0, 0, 3, 0, 0, 0, 0, 4, 0, 5, 6, 7, 1],
        [[1, 0, 0, 5], [2, 3, 0, 6], [0, 0, 4, 7], [0, 0, 0, 1]],
    ),
}


def tree_under(name):
    numbers, matrix = TRANSFORMS[name]
    tree = random_tree(transform=text(name) + struct.pack(f"<{len(numbers)}d", *numbers))
    return tree, np.array(matrix, float)


@pytest.mark.parametrize("name", TRANSFORMS)
def test_transforms(name, tmp_path):
    tree, matrix = tree_under(name)
    (grid,) = open_grids(write(tmp_path, encode({"density": tree})))
    np.testing.assert_array_equal(grid.world_from_index[:, 3], matrix @ [*tree.box()[0], 1])
    np.testing.assert_array_equal(grid.world_from_index[:, :3], matrix[:, :3])


def test_openvdb_agrees_on_transforms(tmp_path):
    paths = [write(tmp_path, encode({"a": tree_under(name)[0]}), f"{name}.vdb") for name in TRANSFORMS]
    ask_openvdb(*paths)
    for path in paths:
        assert_is_what_openvdb_reads(path)


def test_metadata_does_not_decide_the_box(tmp_path):
    tree = random_tree()
    lies = [("file_bbox_min", "vec3i", bytes(12)), ("file_bbox_max", "vec3i", b"\1\0\0\0" * 3)]
    metadata = [*lies, ("class", "string", b"level set")]
    path = write(tmp_path, encode({"density": tree}, metadata=metadata))
    assert_reads(path, tree)
    assert open_grids(path)[0].grid_class == "level set"
    with pytest.raises(VolumeError, match="level set"):
        choose_grid(path)


def test_values_that_are_not_numbers_survive(tmp_path):
    values = np.zeros((8, 8, 8), "<f4")
    values[0, 0] = [np.nan, np.inf, -np.inf, -0.0, 1e-45, 3.4e38, 0, 1]
    tree = Tree(leaves={(0, 0, 0): (values, np.ones((8, 8, 8), bool))}, half=True, compression=0)
    with np.errstate(over="ignore"):
        path = write(tmp_path, encode({"density": tree}))
        expected = values.astype("<f2").astype("<f4").transpose(2, 1, 0)
    read = open_grids(path)[0].read()
    np.testing.assert_array_equal(read.view(np.int32), np.ascontiguousarray(expected).view(np.int32))


def test_grids_behind_an_unreadable_one_in_a_stream_are_named_lost(tmp_path):
    trees = {"a": random_tree(1), "b": random_tree(2), "c": random_tree(3)}
    content = encode(trees, offsets=False)
    at = content.index(b"Tree_float", content.index(text("b") + text("Tree_float_5_4_3")))
    path = write(tmp_path, content[:at] + b"Tree_vec4s" + content[at + 10 :])
    grids = open_grids(path)
    assert [grid.name for grid in grids] == ["a", "b"]
    assert re.match("vec4s values: known: float .*; 1 grid.s. behind it cannot", grids[1].unsupported)


# --------------------------------------------------------------------------------------- leaves


def assert_leaves_are_the_dense_voxels(grid):
    """Leaves hold the same bits as the dense array, and none is empty."""
    leaves = grid.read_leaves()
    assert leaves.shape == grid.shape
    assert len(leaves.values) <= grid.leaf_count
    assert leaves.values.view(np.int32).any(axis=(1, 2, 3)).all()
    np.testing.assert_array_equal(leaves.to_dense().view(np.int32), grid.read().view(np.int32))
    return leaves


@pytest.mark.parametrize("name", FIXTURES)
def test_leaves_of_fixtures(name):
    for grid in open_grids(DATA / f"{name}.vdb"):
        if grid.unsupported:
            assert grid.read_leaves is None
        else:
            assert_leaves_are_the_dense_voxels(grid)


@pytest.mark.parametrize("name", REAL)
def test_leaves_of_real_volumes(name):
    (grid,) = open_grids(real_volume(f"{name}.vdb"))
    assert_leaves_are_the_dense_voxels(grid)


@pytest.mark.parametrize("batch", [2, 256])
@pytest.mark.parametrize("background", [0.0, 0.5])
@pytest.mark.parametrize("kind", ["float", "double", "int32", "bool"])
def test_leaves_of_every_type(kind, background, batch, tmp_path, monkeypatch):
    monkeypatch.setattr(vdb_tree, "LEAVES_PER_BATCH", batch)
    stored = random_tree(type=kind, background=1 if background and kind == "bool" else background)
    stored.leaves[-1600, 0, 0] = (
        np.full((8, 8, 8), stored.background).astype(stored.dtype),
        np.ones((8, 8, 8), bool),
    )
    (grid,) = open_grids(write(tmp_path, encode({"density": stored})))
    leaves = assert_leaves_are_the_dense_voxels(grid)
    assert len(leaves.values) < grid.leaf_count  # at least one is empty


def test_leaves_of_large_tiles(tmp_path):
    stored = Tree(tiles={((128, 0, -128), 128): (2, True), ((0, 0, 0), 128): (0, True)})
    stored.tiles |= {((384, 8, 0), 8): (3, False), ((384, 16, 0), 8): (-0.0, True)}
    stored.leaves[136, 128, 0] = (np.arange(512).reshape(8, 8, 8), np.ones((8, 8, 8), bool))
    (grid,) = open_grids(write(tmp_path, encode({"density": stored})))
    assert grid.leaf_count == 16**3 + 2
    leaves = assert_leaves_are_the_dense_voxels(grid)
    assert len(leaves.values) == 16**3 + 2


def test_leaves_keep_a_negative_zero(tmp_path):
    values = np.zeros((8, 8, 8))
    values[1, 2, 3] = -0.0
    stored = Tree(leaves={(0, 0, 0): (values, np.ones((8, 8, 8), bool))})
    (grid,) = open_grids(write(tmp_path, encode({"density": stored})))
    leaves = assert_leaves_are_the_dense_voxels(grid)
    assert np.signbit(leaves.values[0, 3, 2, 1])


def test_an_empty_tree_has_no_leaves(tmp_path):
    (grid,) = open_grids(write(tmp_path, encode({"density": Tree()})))
    assert len(grid.read_leaves().values) == 0
    zeros = Tree(leaves={(0, 0, 0): (np.zeros((8, 8, 8)), np.ones((8, 8, 8), bool))})
    (grid,) = open_grids(write(tmp_path, encode({"density": zeros})))
    assert grid.read_leaves().to_dense().shape == (8, 8, 8)
    assert len(grid.read_leaves().values) == 0


def two_leaves(tmp_path, corner):
    ones = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    return write(tmp_path, encode({"density": Tree(leaves={(0, 0, 0): ones, corner: ones})}))


def test_leaves_far_apart_are_read_without_the_space_between(tmp_path):
    path = two_leaves(tmp_path, (2000, 2000, 2000))
    describe(path, open_grids(path)[0])  # what is imported on first use is not counted
    volume, peak = peak_of(lambda: Volume.load(path))
    assert volume.shape == (2008, 2008, 2008)
    assert volume.leaves.coordinates.tolist() == [[0, 0, 0], [250, 250, 250]]
    assert peak < 4 << 20
    (grid,) = open_grids(path)
    for function in (
        lambda: camera_for([volume]),
        lambda: density_scale_for(volume),
        lambda: describe(path, grid),
    ):
        result, peak = peak_of(function)
        assert not isinstance(result, VolumeError)
        assert peak < 4 << 20
    assert result["mean"] == pytest.approx(1024 / 2008**3)
    assert (result["renders"], result["active_voxels"]) == ("yes", 1024)
    with pytest.raises(
        VolumeError, match=r"file\.vdb: .*spans 2008×2008×2008 = 8,096,384,512 .*2,147,483,648.*\.leaves"
    ):
        _ = volume.data


def test_a_box_beyond_the_limits_is_refused(tmp_path):
    for corner, words in [
        ((1 << 24, 0, 0), r"spans 16777224×8×8 voxels; the limit along an axis is 16,777,216"),
        ((1 << 20, 1 << 12, 0), r"spans 1048584×4104×8 = 34,427,109,888 voxels; the limit is 17,179,869,184"),
    ]:
        path = two_leaves(tmp_path, corner)
        with pytest.raises(VolumeError, match=words):
            choose_grid(path)
        (grid,) = open_grids(path)
        with pytest.raises(VolumeError, match=words):
            grid.read_leaves()
        assert describe(path, grid)["max"] is None


def test_tiles_that_expand_to_too_many_leaves_cost_nothing(tmp_path):
    """A file of some kB whose tiles, each of 4096 leaves, would take more than 8 GiB."""
    places = list(itertools.product(range(11), range(10), range(10)))
    tiles = {((128 * x, 128 * y, 128 * z), 128): (1, True) for x, y, z in places}
    path = write(tmp_path, encode({"density": Tree(tiles=tiles, compression=ZIP | MASK)}))
    assert path.stat().st_size < 20_000
    words = f"takes {1100 * 4096:,} leaves of 8³ voxels; the limit is {MAX_LEAVES:,}"
    (grid,) = open_grids(path)
    for function in (lambda: choose_grid(path), grid.read_leaves):
        error, peak = peak_of(function)
        assert isinstance(error, VolumeError)
        assert str(error).startswith(str(path))
        assert words in str(error)
        assert peak < 4 << 20
    shown = describe(path, grid)
    assert (shown["max"], shown["renders"]) == (None, words)


def test_leaves_take_no_more_memory_than_they_must(tmp_path):
    ones = np.ones((8, 8, 8), bool)
    numbers = np.arange(512, dtype="<f4").reshape(8, 8, 8)
    corners = itertools.product(range(0, 128, 8), repeat=3)
    stored = Tree(leaves=dict.fromkeys(corners, (numbers, ones)), compression=BLOSC | MASK)
    (grid,) = open_grids(write(tmp_path, encode({"density": stored})))
    leaves, peak = peak_of(grid.read_leaves)
    assert len(leaves.values) == 4096
    assert peak < 1.1 * leaves.nbytes + (3 << 20)  # besides, some batches of 256 leaves


def test_leaves_of_a_changed_file(tmp_path):
    path = write(tmp_path, encode({"density": random_tree()}))
    (grid,) = open_grids(path)
    path.unlink()  # the old pages stay mapped
    two_leaves(tmp_path, (2000, 0, 0))
    with pytest.raises(VolumeError, match=r"changed since|damaged"):
        grid.read_leaves()


# --------------------------------------------------------------------------------------- damage


def try_to_read(path):
    """Read all that is small; returns what a `VolumeError` says, any other error escapes."""
    try:
        for grid in open_grids(path):
            if math.prod(grid.shape) * (1 if grid.read_colour is None else 4) > SMALL:
                continue
            if grid.read_colour is not None:
                grid.read_colour()
            elif not grid.unsupported:
                grid.read()
                grid.read_leaves()
    except VolumeError as error:
        return str(error)
    return ""


SAMPLES = {
    "plain": lambda: encode({"a": random_tree(compression=MASK)}),
    "zip": lambda: encode({"a": random_tree(compression=ZIP | MASK, background=0.5)}),
    "blosc": lambda: encode({"a": random_tree(compression=BLOSC | MASK, half=True)}),
    "stream": lambda: encode(
        {"a": random_tree(compression=BLOSC), "b": random_tree(type="bool")}, offsets=False
    ),
    "several": (DATA / "several.vdb").read_bytes,
    "vectors": lambda: encode({"a": of_vectors(random_tree(compression=BLOSC | MASK, half=True), "vec3s")}),
    "221": lambda: encode({"a": random_tree(compression=ZIP), "b": random_tree(type="mask")}, version=221),
}


@pytest.mark.parametrize("sample", SAMPLES)
def test_every_truncation_is_noticed(sample, tmp_path):
    content = SAMPLES[sample]()
    rng = np.random.default_rng(5)
    for size in [*range(0, 400, 7), *rng.integers(400, len(content), 60).tolist(), len(content) - 1]:
        path = write(tmp_path, content[:size])
        message = try_to_read(path)
        assert str(path) in message, f"cut to {size} of {len(content)} bytes"
        assert "\n" not in message


def flip_bits(content, trials, seed, tmp_path):
    """Read files with two flipped bits; returns how many of them were noticed."""
    content = np.frombuffer(content, np.uint8)
    rng = np.random.default_rng(seed)
    # Most bytes are empty masks: aim half of the flips at the others.
    busy = np.flatnonzero(content)
    noticed = 0
    for trial in range(trials):
        damaged = content.copy()
        at = rng.choice(busy, 2) if trial % 2 else rng.integers(0, len(content), 2)
        damaged[at] ^= (1 << rng.integers(0, 8, 2)).astype(np.uint8)
        message = try_to_read(write(tmp_path, damaged.tobytes()))
        noticed += bool(message)
        assert len(message) < LONGEST_MESSAGE
    return noticed


@pytest.mark.parametrize("sample", SAMPLES)
def test_flipped_bits_raise_only_volume_errors(sample, tmp_path):
    content = SAMPLES[sample]()
    tracemalloc.start()
    noticed = flip_bits(content, 60, 6, tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert noticed > 5
    assert peak < 8 * SMALL


@pytest.mark.slow
@pytest.mark.parametrize("sample", SAMPLES)
def test_many_flipped_bits_raise_only_volume_errors(sample, tmp_path):
    assert flip_bits(SAMPLES[sample](), 700, 7, tmp_path) > 70


def patched(content, offset, layout, *numbers):
    content = bytearray(content)
    struct.pack_into("<" + layout, content, offset, *numbers)
    return bytes(content)


def plain_sample():
    """A one-grid file and the positions of its parts."""
    tree = random_tree(compression=MASK | BLOSC)
    content = encode({"density": tree})
    topology, buffers = encode_tree(tree)
    return content, content.index(topology), content.index(buffers)


ABSURD = 0x7FFFFFFF


@pytest.mark.parametrize(
    ("part", "offset", "number"),
    [
        ("file", 57, ABSURD),  # items of metadata
        ("file", 61, ABSURD),  # grids
        ("file", 65, ABSURD),  # length of a name
        ("topology", -53, ABSURD),  # length of the grid's name in its metadata, before 42 bytes of its map
        ("topology", 0, 2),  # buffers
        ("topology", 8, ABSURD),  # root tiles
        ("topology", 12, ABSURD),  # root children
        ("topology", 16, 7),  # origin of a root child
        ("buffers", 0, ABSURD),  # mask of a leaf
        ("buffers", 65, ABSURD),  # size of a block
    ],
)
def test_absurd_numbers_cost_nothing(part, offset, number, tmp_path):
    content, topology, buffers = plain_sample()
    at = {"file": 0, "topology": topology, "buffers": buffers}[part] + offset
    path = write(tmp_path, patched(content, at, "I", number))
    tracemalloc.start()
    message = try_to_read(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "damaged or incomplete" in message
    assert peak < 4 << 20


def test_other_files_are_refused(tmp_path):
    content, *_ = plain_sample()
    for wrong, words in [
        (b"", "not an OpenVDB file"),
        (b"PK\3\4" + bytes(100), "not an OpenVDB file"),
        (patched(content, 8, "I", 219), "version 219.*save it again with a current OpenVDB"),
        (patched(content, 8, "I", 226), "version 226.*newer.*update tfm_cl, or save it with an older"),
    ]:
        with pytest.raises(VolumeError, match=words):
            open_grids(write(tmp_path, wrong))


def test_damaged_names_are_cut_in_messages(tmp_path):
    name = "\x1b" + "n" * 26_000
    content = encode({name: random_tree(), "b": random_tree()})
    at = content.index(text("Tree_float_5_4_3"))
    for wrong in (
        content[: len(content) // 2],
        patched(content, at + len(text("Tree_float_5_4_3")) + 4, "3q", -1, -1, -1),
        content.replace(text("b") + text("Tree_float_5_4_3") + text(""), text("b") + text(name) + text(name)),
        encode({"a": random_tree()}).replace(
            text("Tree_float_5_4_3"), text("Tree_" + "x" * 26_000 + "_5_4_3")
        ),
        encode({"a": random_tree()}).replace(text("TranslationMap"), text("y" * 26_000)),
        encode({"a": random_tree()}).replace(text("name"), struct.pack("<I", 26_000) + b"name"),
    ):
        path = write(tmp_path, wrong)
        with pytest.raises(VolumeError) as caught:
            choose_grid(path)
        assert len(str(caught.value)) < LONGEST_MESSAGE
        assert "\x1b" not in str(caught.value)


def test_same_unique_name_twice_is_refused(tmp_path):
    content = encode({"a": random_tree(), "b": random_tree()})
    at = content.index(text("b") + text("Tree_float_5_4_3"))
    with pytest.raises(VolumeError, match="unique name 'a'"):
        open_grids(write(tmp_path, content[:at] + text("a") + content[at + 5 :]))


def test_missing_instance_parent_is_refused(tmp_path):
    content = (DATA / "several.vdb").read_bytes()
    parent = text("shared") + text("Tree_float_5_4_3") + text("density\x1e0")
    assert parent in content
    with pytest.raises(VolumeError, match=r"shares the tree of 'density\\x1e7', which is missing"):
        open_grids(write(tmp_path, content.replace(parent, parent[:-1] + b"7")))


def test_many_instances_walk_their_tree_once(tmp_path, monkeypatch):
    content = encode({"a": random_tree()})
    instance = text("Tree_float_5_4_3") + text("a")
    body = struct.pack("<2I", MASK, 0) + IDENTITY
    for index in range(50):
        at = len(content) + len(text(f"{index:2}") + instance) + 24
        positions = struct.pack("<3q", at, at, at + len(body))
        content += text(f"{index:2}") + instance + positions + body
    walks = []
    walk_topology = vdb.walk_topology
    monkeypatch.setattr(vdb, "walk_topology", lambda *args: walks.append(args) or walk_topology(*args))
    grids = open_grids(write(tmp_path, patched(content, 61, "i", 51)))
    assert len(grids) == 51
    assert len(walks) == 1
    np.testing.assert_array_equal(grids[50].read(), random_tree().dense())


def test_instance_of_a_tree_under_a_frustum_is_unsupported(tmp_path):
    content = (DATA / "several.vdb").read_bytes()
    old = text("\x1e0") + text("Tree_float_5_4_3") + text("")
    at = content.rindex(old) + len(old)
    end = struct.unpack_from("<3q", content, at)[2]
    assert end == len(content)
    extra = text("b") + text("Tree_float_5_4_3") + text("\x1e0")
    body = struct.pack("<2I", MASK, 0) + IDENTITY
    start = end + len(extra) + 24
    content += extra + struct.pack("<3q", start, start, start + len(body)) + body
    count = content.index(struct.pack("<i", 6) + text("density\x1e0"))
    grids = open_grids(write(tmp_path, patched(content, count, "i", 7)))
    assert ["frustum" in grid.unsupported for grid in grids[5:]] == [True, True]


def test_a_changed_file_is_noticed(tmp_path):
    path = write(tmp_path, encode({"density": random_tree()}))
    (grid,) = open_grids(path)
    tree = random_tree()
    tree.tiles[(-264, 0, 0), 8] = (1, True)
    path.unlink()  # the old pages stay mapped
    write(tmp_path, encode({"density": tree}))
    with pytest.raises(VolumeError, match="changed since"):
        grid.read()


# ---------------------------------------------------------------------------------- codecs alone


def source():
    return binary.Cursor(memoryview(b""), "file")


def test_a_zlib_bomb_is_not_unpacked():
    bomb = memoryview(zlib.compress(bytes(1 << 24), 9))
    tracemalloc.start()
    with pytest.raises(VolumeError, match="should hold 512"):
        binary.unzip(bomb, 512, source())
    with pytest.raises(VolumeError, match="cannot hold"):
        binary.unzip(bomb, 1 << 34, source())
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1 << 20


@pytest.mark.parametrize("at", range(16))
def test_a_blosc_header_is_not_believed(at):
    data = np.arange(512, dtype="<f4").tobytes()
    block_of_data = bytearray(blosc.compress(data, 1, 9, blosc.SHUFFLE, "lz4"))
    assert binary.unblosc(memoryview(block_of_data), len(data), source()) == data
    for value in (0, 1, 0x7F, 0x80, 0xFF):
        changed = bytearray(block_of_data)
        changed[at] = value
        try:
            plain = binary.unblosc(memoryview(changed), len(data), source())
        except VolumeError:
            continue
        assert len(plain) == len(data)
    with pytest.raises(VolumeError, match="Blosc"):
        binary.unblosc(memoryview(block_of_data)[:-1], len(data), source())


def test_topology_and_leaves_can_be_walked_without_a_dense_array():
    path = DATA / "tiles.vdb"
    file = binary.Cursor(binary.map_file(path), str(path))
    content = bytes(file.data)
    at = content.index(text("ScaleTranslateMap")) + len(text("ScaleTranslateMap")) + 6 * 24
    dtype = np.dtype("<f4")
    stored = vdb.StoredTree(at=at, value=dtype, stored=dtype, name="float", compression=MASK | BLOSC)
    file.at = at
    topology = vdb.walk_topology(file, stored)
    assert {tiles.edge: len(tiles.values) for tiles in topology.tree.tiles} == {8: 7}
    batches = list(vdb.walk_leaves(file, stored, topology))
    assert sum(len(batch.origins) for batch in batches) == 7
    values = batches[0].values[np.flatnonzero((batches[0].origins == (0, 40, 0)).all(axis=1))[0]]
    assert values[1, 0, 2] == 11.0
