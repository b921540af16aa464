"""The NanoVDB reader against real files, against an encoder written for these tests, and under attack."""

import itertools
import math
import os
import re
import struct
import tracemalloc
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path

import blosc
import numpy as np
import pytest
from memory import peak_of

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import binary, choose_grid, nvdb, open_grids
from tfm_cl.files.volume_io import tree as vdb_tree
from tfm_cl.files.volume_io.limits import MAX_LEAVES
from tfm_cl.files.volume_io.nvdb_layout import Layout
from tfm_cl.scene.bodies.volume import Volume

ROOT = Path(__file__).resolve().parents[3]
VOLUMES = Path(os.environ.get("TFM_VOLUMES", ROOT.parent / "shared" / "volumes"))
REAL = ("openvdb_smoke_blosc.nvdb", "teapot_cloud.nvdb", "warp_rocks.nvdb")

NONE, ZIP, BLOSC = 0, 1, 2
SMALL = 1 << 22
"""Voxels that a test reads of a file whose shape it cannot know."""


# ------------------------------------------------------------------------------------ real files


def real_volume(name):
    path = VOLUMES / name
    if not path.exists():
        pytest.skip(f"{name} is not in {VOLUMES} (set TFM_VOLUMES)")
    return path


def first_grid(content):
    """Segment metadata and unpacked bytes of the first grid of a file, by offsets alone."""
    (codec,) = struct.unpack_from("<H", content, 14)
    metadata = content[16 : 16 + 176]
    at = 16 + 176 + struct.unpack_from("<I", metadata, 136)[0]
    (size,) = struct.unpack_from("<Q", content, at)
    packed = content[at + 8 : at + 8 + size]
    return metadata, zlib.decompress(packed) if codec == ZIP else blosc.decompress(packed)


@pytest.mark.parametrize("name", REAL)
def test_real_volume_agrees_with_its_own_metadata(name):
    path = real_volume(name)
    (grid,) = open_grids(path)
    metadata, content = first_grid(path.read_bytes())
    values = grid.read()
    assert values.dtype == np.float32
    assert values.shape == grid.shape
    assert grid.active_voxels == struct.unpack_from("<Q", metadata, 24)[0]
    # Statistics that the writer stored in the root.
    root = 672 + struct.unpack_from("<4Q", content, 672)[3]
    background, low, high, mean, deviation = struct.unpack_from("<5f", content, root + 28)
    assert grid.background == np.float32(background)
    if grid.grid_class == "level set":
        active = values[np.abs(values) < background]
        assert grid.active_voxels - 10 <= len(active) <= grid.active_voxels
        assert (active.min(), active.max()) == (np.float32(low), np.float32(high))
        assert (values == -background).any()
    else:
        # Inactive voxels are all 0 in a fog volume, but for their number.
        assert values.max() == np.float32(high)
        count = grid.active_voxels
        sum_of, square = values.sum(dtype=np.float64), (values.astype(np.float64) ** 2).sum()
        assert sum_of / count == pytest.approx(mean, rel=1e-5)
        assert math.sqrt(square / count - (sum_of / count) ** 2) == pytest.approx(deviation, rel=1e-4)
        # The active voxels' box, and no value outside.
        box = np.array(struct.unpack_from("<6i", metadata, 88)).reshape(2, 3)
        size = struct.unpack_from("<3d", metadata, 112)
        world = np.array(struct.unpack_from("<6d", metadata, 40)).reshape(2, 3)
        first = np.rint((grid.world_from_index[:3, 3] - world[0]) / size + box[0]).astype(int)
        z, y, x = (
            slice(a, b) for a, b in zip((box[0] - first)[::-1], (box[1] - first)[::-1] + 1, strict=True)
        )
        outside = values.copy()
        outside[z, y, x] = 0
        assert not outside.any()
        assert values[z, y, x].any(axis=(1, 2))[[0, -1]].all()


def test_smoke_is_the_same_in_both_formats():
    (nano,) = open_grids(real_volume("openvdb_smoke_blosc.nvdb"))
    (vdb,) = open_grids(real_volume("cortex_smoke.vdb"))
    assert nano.active_voxels == vdb.active_voxels == 1_049_275
    np.testing.assert_array_equal(nano.read().view(np.int32), vdb.read().view(np.int32))


def test_teapot_has_tiles_inside():
    path = real_volume("teapot_cloud.nvdb")
    _, content = first_grid(path.read_bytes())
    grid = binary.Cursor(memoryview(content), "teapot")
    topology = nvdb.walk_topology(grid, Layout("float32", np.dtype("<f4")))
    small = [tiles for tiles in topology.tree.tiles if tiles.edge == 8]
    node_counts, tile_counts = np.frombuffer(content, "<u4", 6, 672 + 32).reshape(2, 3)
    assert len(topology.leaves_at) == node_counts[0]
    assert sum(len(tiles.values) for tiles in small) == tile_counts[0] > 1000
    assert choose_grid(path).shape == (184, 144, 272)


# ----------------------------------------------------------------------------- an encoder for tests


@dataclass
class Form:
    """How a value type is laid out; the numbers are those of the format's own table."""

    id: int
    dtype: str
    leaf_values_at: int = 96
    bits: int = 0
    root: tuple = (28, 64)
    """Where its background lies, and where its tiles begin."""
    tile: tuple = (20, 32)
    """Where its value lies, and its size."""
    tables: tuple = (8256, 1088)
    """Where those of upper and lower nodes begin."""
    stride: int = 8
    """Bytes of an entry of a table."""

    def node_size(self, dim):
        return self.tables[dim == 16] + dim**3 * self.stride


WIDE = {"root": (32, 96), "tile": (24, 32)}


FORMS = {
    "float32": Form(1, "<f4"),
    "float64": Form(2, "<f8", 128, **WIDE),
    "int16": Form(3, "<i2"),
    "int32": Form(4, "<i4"),
    "int64": Form(5, "<i8", 128, **WIDE),
    "mask": Form(8, "u1", 96),
    "float16": Form(9, "<f2"),
    "uint32": Form(10, "<u4"),
    "bool": Form(11, "u1", 80),
    "fp4": Form(13, "<f4", bits=4),
    "fp8": Form(14, "<f4", bits=8),
    "fp16": Form(15, "<f4", bits=16),
    "fpn": Form(16, "<f4", bits=-1),
    "uint8": Form(26, "u1"),
}
VECTORS = {
    "vec3f": Form(6, "<f4,<f4,<f4", 128, root=(28, 96), stride=16),
    "vec3d": Form(7, "<f8,<f8,<f8", 160, root=(32, 128), tile=(24, 64), tables=(8288, 1120), stride=24),
}
INDICES = {"index": Form(19, "<u8", 80, **WIDE), "on-index": Form(20, "<u8", 80, **WIDE)}


@dataclass
class Tree:
    """What a written tree holds; `dense` paints it."""

    leaves: dict = field(default_factory=dict)
    """origin -> values, active: both [x, y, z] of 8³; quantised: (codes, bits, minimum, quantum), active."""
    tiles: dict = field(default_factory=dict)
    """(origin, edge) -> value, active."""
    background: float = 0.0
    type: str = "float32"
    grid_class: int = 2
    matrix: tuple = (1, 0, 0, 0, 1, 0, 0, 0, 1)
    translation: tuple = (0, 0, 0)

    @property
    def form(self):
        return (FORMS | VECTORS | INDICES)[self.type]

    def leaf_values(self, origin):
        values, _ = self.leaves[origin]
        if not self.form.bits:
            return values
        codes, _, minimum, quantum = values
        return codes.astype(np.float32) * np.float32(quantum) + np.float32(minimum)

    def box(self):
        cubes = [(np.array(o), 8) for o in self.leaves]
        cubes += [(np.array(o), e) for (o, e), (v, _) in self.tiles.items() if v != self.background]
        return np.min([o for o, _ in cubes], axis=0), np.max([o + e for o, e in cubes], axis=0)

    def dense(self):
        low, high = self.box()
        dtype = self.form.dtype if self.type in VECTORS else np.float32
        dense = np.full(high - low, np.array(self.background, dtype))
        cubes = [(origin, 8, self.leaf_values(origin)) for origin in self.leaves]
        cubes += [(origin, edge, value) for (origin, edge), (value, _) in self.tiles.items()]
        for origin, edge, values in cubes:
            at = np.array(origin) - low
            if (at >= 0).all() and (at + edge <= dense.shape).all():
                dense[tuple(slice(a, a + edge) for a in at)] = values
        dense = dense.transpose(2, 1, 0)
        names = dense.dtype.names
        return np.stack([dense[name] for name in names], -1) if names else dense

    def active_voxels(self):
        in_leaves = sum(int(active.sum()) for _, active in self.leaves.values())
        return in_leaves + sum(edge**3 for (_, edge), (_, active) in self.tiles.items() if active)


def bits(flags):
    return np.packbits(np.asarray(flags, bool), bitorder="little").tobytes()


def node_of(origin, edge):
    return tuple(c // edge * edge for c in origin)


def encode_leaf(tree, origin):
    form = tree.form
    values, active = tree.leaves[origin]
    flags = 0
    head = b""
    if form.bits:
        codes, width, minimum, quantum = values
        flags = (width.bit_length() - 1) << 5
        head = struct.pack("<2f", minimum, quantum)
        every_bit = codes.ravel()[:, None] >> np.arange(width) & 1
        data = np.packbits(every_bit.astype(bool), bitorder="little").tobytes()
    elif tree.type in INDICES:
        data = struct.pack("<QQ", values, 0)
    elif tree.type == "bool":
        data = bits(values) + bytes(16)
    elif tree.type == "mask":
        data = b""
    else:
        data = values.astype(form.dtype).tobytes()
    leaf = struct.pack("<3i4B", *(c + 1 for c in origin), 6, 6, 6, flags) + bits(active) + head
    return leaf.ljust(form.leaf_values_at, b"\xee") + data


def encode_node(tree, origin, dim, edge, children, at, child_at):
    """An upper or lower node that begins at byte ``at``; ``child_at`` says where children begin."""
    table = np.zeros((dim**3, tree.form.stride), np.uint8)
    value = np.array(tree.background, tree.form.dtype)
    table[:, : value.itemsize] = np.frombuffer(value.tobytes(), np.uint8)
    active, has_child = np.zeros(dim**3, bool), np.zeros(dim**3, bool)

    def entry(corner):
        x, y, z = ((c - o) // edge for c, o in zip(corner, origin, strict=True))
        return (x * dim + y) * dim + z

    for (corner, tile_edge), (tile_value, is_active) in tree.tiles.items():
        if tile_edge == edge and node_of(corner, dim * edge) == origin:
            active[entry(corner)] = is_active
            tile = np.array(tile_value, tree.form.dtype)
            table[entry(corner), : tile.itemsize] = np.frombuffer(tile.tobytes(), np.uint8)
    for corner in children:
        has_child[entry(corner)] = True
        table[entry(corner), :8] = np.frombuffer(struct.pack("<q", child_at[corner] - at), np.uint8)
    node = struct.pack("<6iQ", *origin, *origin, 0) + bits(active) + bits(has_child)
    return node.ljust(tree.form.tables[dim == 16], b"\xee") + table.tobytes()


def indexed(tree):
    """An index tree in the place of one of values, and these values."""
    values = [tree.background]
    leaves, tiles = {}, {}
    for origin, (stored, active) in tree.leaves.items():
        leaves[origin] = (len(values), active)
        values += stored[active].tolist() if tree.type == "on-index" else stored.ravel().tolist()
    for place, (value, active) in tree.tiles.items():
        tiles[place] = (len(values), active)
        values.append(value)
    return replace(tree, leaves=leaves, tiles=tiles, background=0), np.array(values, "<f4").tobytes()


def blind_data(*items):
    """(class, type, size of a value, bytes) each, behind their descriptions."""
    head, body = b"", b""
    for number, (data_class, number_type, size, data) in enumerate(items):
        offset = 288 * (len(items) - number) + len(body)
        head += struct.pack("<qQ4I", offset, len(data) // size, size, 0, data_class, number_type)
        head += b"channel_0".ljust(256, b"\0")
        body += data
    return head + body


def encode_grid(tree, name="density", *, version=(32, 6), magic=b"NanoVDB0", channels=True):
    form, channel = tree.form, None
    if tree.type in INDICES:
        tree, channel = indexed(tree)
    lowers = sorted(
        {node_of(o, 128) for o in tree.leaves} | {node_of(o, 128) for o, e in tree.tiles if e == 8}
    )
    uppers = sorted(
        {node_of(o, 4096) for o in lowers} | {node_of(o, 4096) for o, e in tree.tiles if e == 128}
    )
    root_tiles = [(o, *entry) for (o, edge), entry in tree.tiles.items() if edge == 4096]
    root_at = 672 + 64
    upper_at = root_at + form.root[1] + form.tile[1] * (len(uppers) + len(root_tiles))
    lower_at = upper_at + form.node_size(32) * len(uppers)
    leaf_at = lower_at + form.node_size(16) * len(lowers)
    leaves = {origin: encode_leaf(tree, origin) for origin in tree.leaves}
    where_leaf = dict(zip(leaves, leaf_at + np.cumsum([0, *map(len, leaves.values())]), strict=False))
    where_lower = {o: lower_at + form.node_size(16) * i for i, o in enumerate(lowers)}
    where_upper = {o: upper_at + form.node_size(32) * i for i, o in enumerate(uppers)}

    value = np.array(tree.background, form.dtype).tobytes()
    root = struct.pack("<6iI", *(0,) * 6, len(uppers) + len(root_tiles))
    root = (root.ljust(form.root[0], b"\xee") + value).ljust(form.root[1], b"\xee")
    for origin, child, tile, active in [
        *((o, where_upper[o] - root_at, tree.background, 1) for o in uppers),
        *((o, 0, tile, active) for o, tile, active in root_tiles),
    ]:
        x, y, z = ((c & 0xFFFFFFFF) >> 12 for c in origin)
        entry = struct.pack("<QqI", x << 42 | y << 21 | z, child, active)
        entry = entry.ljust(form.tile[0], b"\xee") + np.array(tile, form.dtype).tobytes()
        root += entry.ljust(form.tile[1], b"\xee")
    body = root
    for origin in uppers:
        inside = [o for o in lowers if node_of(o, 4096) == origin]
        body += encode_node(tree, origin, 32, 128, inside, where_upper[origin], where_lower)
    for origin in lowers:
        inside = [o for o in leaves if node_of(o, 128) == origin]
        body += encode_node(tree, origin, 16, 8, inside, where_lower[origin], where_leaf)
    body += b"".join(leaves.values())
    blind_at = root_at + len(body)
    if channel is not None and channels:
        body += blind_data((3, 0, 1, b"density\0"), (4, 6, 12, bytes(24)), (4, 1, 4, channel))

    size = root_at + len(body)
    number = version[0] << 21 | version[1] << 10
    head = magic + struct.pack("<QIIIIQ", 0, number, 0, 0, 1, size) + name.encode()[:255].ljust(256, b"\0")
    head += bytes(88) + struct.pack("<9d", *tree.matrix) + bytes(72) + struct.pack("<3d", *tree.translation)
    head += bytes(8 + 48 + 24) + struct.pack("<2I", tree.grid_class, form.id)
    offsets = (leaf_at - 672, lower_at - 672, upper_at - 672, 64)
    header = struct.pack("<4Q6IQ", *offsets, len(leaves), len(lowers), len(uppers), 0, 0, 0, 0)
    head += struct.pack("<qI", blind_at, 3 if channel is not None and channels else 0)
    return head.ljust(672, b"\0") + header + body


def encode(grids, *, codec=NONE, version=(32, 6), magic=b"NanoVDB0", file_size=None):
    """One segment of (name, grid bytes)."""
    number = version[0] << 21 | version[1] << 10
    head, body = magic + struct.pack("<IHH", number, len(grids), codec), b""
    for name, grid in grids:
        data = grid
        if codec:
            data = zlib.compress(grid) if codec == ZIP else blosc.compress(grid, 1, 9, blosc.SHUFFLE, "lz4")
            data = struct.pack("<Q", len(data)) + data
        grid_class, grid_type = struct.unpack_from("<2I", grid, 632)
        metadata = struct.pack("<4Q", len(grid), len(data) if file_size is None else file_size, 0, 0)
        metadata += struct.pack("<2I", grid_type, grid_class) + bytes(96)
        metadata += struct.pack("<I", len(name) + 1) + bytes(28) + struct.pack("<HHI", codec, 0, number)
        assert len(metadata) == 176
        head += metadata + name.encode() + b"\0"
        body += data
    return head + body


def random_tree(seed=0, kind="float32", **options):
    """Leaves in two nodes of the root, inactive values too, and active and inactive tiles."""
    rng = np.random.default_rng(seed)
    tree = Tree(type=kind, **options)
    for place in range(7):
        origin = (-8 - 128 * (place % 2), 8 * place, 16 if place < 5 else -16)
        active = rng.random((8, 8, 8)) < 0.5
        width = abs(tree.form.bits) if tree.form.bits > 0 else 1 << place % 5
        most = {"float16": 11, "uint8": 8, "bool": 1, "mask": 1}.get(kind, 14)
        codes = rng.integers(0, 1 << min(width, most), (8, 8, 8))
        codes = active.astype(int) if kind == "mask" else codes
        codes = np.where(active, codes, tree.background) if kind == "on-index" else codes
        tree.leaves[origin] = (
            (codes, width, -0.5 + place, 0.125 * place) if tree.form.bits else codes,
            active,
        )
    tree.tiles |= {((-24, 0, 0), 8): (1, True), ((-32, 0, 0), 8): (tree.background, True)}
    tree.tiles |= {((-40, 8, 0), 8): ({"bool": 1, "mask": 0}.get(kind, 5), False)}
    if kind == "mask":
        tree.tiles[(-32, 0, 0), 8] = (0, False)
    return tree


def vector_tree(kind):
    """Vectors (v, 2v, -v) in the place of the numbers v of a random tree."""
    tree = random_tree(background=2)

    def vectors(v):
        found = np.empty(np.shape(v), VECTORS[kind].dtype)
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


def write(tmp_path, content, name="file.nvdb"):
    path = tmp_path / name
    path.write_bytes(content)
    return path


def assert_reads(path, tree, index=0):
    grid = open_grids(path)[index]
    expected = tree.dense()
    assert grid.shape == expected.shape[:3]
    assert grid.active_voxels == tree.active_voxels()
    assert grid.value_type == tree.type
    np.testing.assert_array_equal(grid.world_from_index[:3, 3], tree.box()[0])
    if tree.type in VECTORS:
        assert grid.colour_background == tree.background
        np.testing.assert_array_equal(grid.read_colour(), expected)
        return
    assert grid.background == tree.background
    np.testing.assert_array_equal(grid.read(), expected)


def background_of(kind):
    """Something that the type can hold, but not 0 where it can be another."""
    return {"bool": 1, "mask": 0}.get(kind, 2)


@pytest.mark.parametrize("kind", FORMS | INDICES)
def test_value_types(kind, tmp_path):
    tree = random_tree(kind=kind, background=background_of(kind))
    assert_reads(write(tmp_path, encode([("density", encode_grid(tree))])), tree)


@pytest.mark.parametrize("kind", VECTORS)
def test_vectors_are_colours(kind, tmp_path):
    tree = vector_tree(kind)
    path = write(tmp_path, encode([("Cd", encode_grid(tree))], codec=ZIP))
    assert_reads(path, tree)
    with pytest.raises(VolumeError, match=r"'Cd' cannot be rendered: vectors.*--set volume.colour=NAME"):
        choose_grid(path)
    with pytest.raises(VolumeError, match="'Cd' cannot be read: vectors"):
        open_grids(path)[0].read()


@pytest.mark.parametrize("kind", FORMS | VECTORS | INDICES)
def test_layouts(kind):
    """The arithmetic of nodes' sizes against the format's own table."""
    form = (FORMS | VECTORS | INDICES)[kind]
    layout = nvdb._LAYOUTS[form.id]
    assert layout.name == kind
    assert (layout.background_at, layout.root_size) == form.root
    assert (layout.root_tile.fields["value"][1], layout.root_tile.itemsize) == form.tile
    assert (layout.table_at(128), layout.table_at(8)) == form.tables
    assert (layout.node_size(128), layout.node_size(8)) == (form.node_size(32), form.node_size(16))


@pytest.mark.parametrize("kind", INDICES)
def test_indices_without_values_are_refused(kind, tmp_path):
    path = write(tmp_path, encode([("density", encode_grid(random_tree(kind=kind), channels=False))]))
    with pytest.raises(VolumeError, match=f"{kind} values without the numbers they are indices of; write"):
        choose_grid(path)


def test_an_index_beyond_the_values_is_noticed(tmp_path):
    grid = bytearray(encode_grid(random_tree(kind="on-index")))
    blind_at, _ = struct.unpack_from("<qI", grid, 640)
    (count,) = struct.unpack_from("<Q", grid, blind_at + 2 * 288 + 8)
    struct.pack_into("<Q", grid, blind_at + 2 * 288 + 8, count - 600)
    path = write(tmp_path, encode([("density", bytes(grid))]))
    assert re.search(r"damaged.* an index of \d+ for \d+ values", try_to_read(path))


@pytest.mark.parametrize("codec", [NONE, ZIP])
def test_bytes_behind_the_last_grid_are_passed_over(codec, tmp_path):
    tree = random_tree()
    content = encode([("density", encode_grid(tree))], codec=codec)
    for behind in (b"\0", bytes(4096), b"more than a magic"):
        assert_reads(write(tmp_path, content + behind), tree)
    with pytest.raises(VolumeError, match="damaged or incomplete"):
        open_grids(write(tmp_path, content + content[:7]))  # a segment cut short


@pytest.mark.parametrize("codec", [NONE, ZIP, BLOSC])
@pytest.mark.parametrize("file_size", [None, 0, 1 << 60])
def test_codecs_whatever_the_size_in_the_metadata(codec, file_size, tmp_path):
    """Writers differ in what they count, so the size in the file is that of the packed chunks."""
    trees = [random_tree(seed) for seed in (1, 2)]
    grids = [(f"grid {i}", encode_grid(tree)) for i, tree in enumerate(trees)]
    path = write(tmp_path, encode(grids, codec=codec, file_size=file_size))
    for index, tree in enumerate(trees):
        assert_reads(path, tree, index)


def test_large_grids_are_blosc_blocks_one_behind_the_other(tmp_path, monkeypatch):
    step = 100_000
    monkeypatch.setattr(nvdb, "_BLOSC_CHUNK", step)  # a GiB in earnest
    tree = random_tree()
    grid = encode_grid(tree)
    content = encode([("density", grid)])
    head = bytearray(content[: len(content) - len(grid)])
    struct.pack_into("<H", head, 14, BLOSC)
    for start in range(0, len(grid), step):
        packed = blosc.compress(grid[start : start + step], 1, 9, blosc.SHUFFLE, "lz4")
        head += struct.pack("<Q", len(packed)) + packed
    assert len(grid) > 3 * step
    assert_reads(write(tmp_path, bytes(head)), tree)


def test_segments_follow_each_other(tmp_path):
    trees = [random_tree(1), random_tree(2, "float64"), random_tree(3)]
    parts = [
        encode([("a", encode_grid(trees[0]))], codec=BLOSC),
        encode([("b", encode_grid(trees[1])), ("a", encode_grid(trees[2]))], codec=ZIP, magic=b"NanoVDB2"),
    ]
    path = write(tmp_path, b"".join(parts))
    assert [grid.name for grid in open_grids(path)] == ["a[0]", "b", "a[1]"]
    for index, tree in enumerate(trees):
        assert_reads(path, tree, index)


@pytest.mark.parametrize("magic", [b"NanoVDB0", b"NanoVDB1"])
def test_bare_grids(magic, tmp_path):
    trees = {"smoke": random_tree(1), "fire": random_tree(2)}
    path = write(tmp_path, b"".join(encode_grid(tree, name, magic=magic) for name, tree in trees.items()))
    assert [grid.name for grid in open_grids(path)] == ["smoke", "fire"]
    for index, tree in enumerate(trees.values()):
        assert_reads(path, tree, index)


def test_long_names_come_from_the_segment(tmp_path):
    name = "n" * 300
    (grid,) = open_grids(write(tmp_path, encode([(name, encode_grid(random_tree(), name))])))
    assert grid.name == name


def test_tiles_of_all_sizes(tmp_path):
    tree = random_tree()
    tree.tiles |= {((128, 0, -128), 128): (2, True), ((256, 0, 0), 128): (0, True)}
    assert_reads(write(tmp_path, encode([("density", encode_grid(tree))])), tree)
    tree.tiles[(4096, 0, -4096), 4096] = (3, False)
    path = write(tmp_path, encode([("density", encode_grid(tree))]))
    (grid,) = open_grids(path)
    assert grid.shape == (4096 + 24, 4096, 8192 + 136)
    assert grid.active_voxels == tree.active_voxels()
    with pytest.raises(VolumeError, match="limit"):
        grid.read()


def test_empty_tree(tmp_path):
    (grid,) = open_grids(write(tmp_path, encode([("density", encode_grid(Tree()))])))
    assert (grid.shape, grid.active_voxels) == ((0, 0, 0), 0)
    assert grid.read().shape == (0, 0, 0)


def test_leaves_far_apart_keep_their_places(tmp_path):
    leaf = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    tree = Tree(leaves={(-(2**31), 0, 0): leaf, (2**31 - 8, -(2**31), 2**31 - 8): leaf})
    (grid,) = open_grids(write(tmp_path, encode([("density", encode_grid(tree))])))
    assert grid.shape == (2**31, 2**31 + 8, 2**32)
    np.testing.assert_array_equal(grid.world_from_index[:3, 3], [-(2**31), -(2**31), 0])


def test_transform_is_a_full_matrix(tmp_path):
    matrix, translation = (1, 2, 3, 0, 4, 5, 0, 0, 6), (7, 8, 9)
    tree = random_tree(matrix=matrix, translation=translation)
    (grid,) = open_grids(write(tmp_path, encode([("density", encode_grid(tree))])))
    np.testing.assert_array_equal(grid.world_from_index[:3, :3], np.reshape(matrix, (3, 3)))
    expected = np.reshape(matrix, (3, 3)) @ tree.box()[0] + translation
    np.testing.assert_array_equal(grid.world_from_index[:3, 3], expected)


@pytest.mark.parametrize(
    ("number", "name"), [(0, "unknown"), (1, "level set"), (2, "fog volume"), (9, "unknown")]
)
def test_grid_class(number, name, tmp_path):
    content = encode([("density", encode_grid(random_tree(grid_class=number)))])
    assert open_grids(write(tmp_path, content))[0].grid_class == name


def test_other_types_are_listed(tmp_path):
    grid = bytearray(encode_grid(random_tree()))
    struct.pack_into("<I", grid, 636, 12)
    path = write(
        tmp_path, encode([("velocity", bytes(grid)), ("density", encode_grid(random_tree()))], codec=ZIP)
    )
    grids = open_grids(path)
    assert [(grid.name, grid.unsupported) for grid in grids] == [
        ("velocity", "rgba8 values; convert them to a grid of numbers first"),
        ("density", ""),
    ]
    with pytest.raises(VolumeError, match=r"velocity.*rgba8"):
        grids[0].read()


@pytest.mark.parametrize(
    ("version", "is_read"), [((32, 3), True), ((32, 9), True), ((32, 2), False), ((33, 0), False)]
)
def test_versions(version, is_read, tmp_path):
    tree = random_tree()
    path = write(tmp_path, encode([("density", encode_grid(tree, version=version))], version=version))
    if is_read:
        assert_reads(path, tree)
    else:
        with pytest.raises(VolumeError, match=rf"version {version[0]}\.{version[1]}.*convert") as caught:
            open_grids(path)
        assert ("update tfm_cl" in str(caught.value)) == (version[0] > 32)


# --------------------------------------------------------------------------------------- leaves


def assert_leaves_are_the_dense_voxels(grid):
    """Leaves hold the same bits as the dense array, and none is empty."""
    leaves = grid.read_leaves()
    assert leaves.shape == grid.shape
    assert len(leaves.values) <= grid.leaf_count
    assert leaves.values.view(np.int32).any(axis=(1, 2, 3)).all()
    np.testing.assert_array_equal(leaves.to_dense().view(np.int32), grid.read().view(np.int32))


@pytest.mark.parametrize("name", REAL)
def test_leaves_of_real_volumes(name):
    (grid,) = open_grids(real_volume(name))
    assert_leaves_are_the_dense_voxels(grid)


@pytest.mark.quick("float32-2-2", "float16-2-256", "fpn-0-256", "mask-0-2")
@pytest.mark.parametrize("batch", [2, 256])
@pytest.mark.parametrize("background", [0, 2])
@pytest.mark.parametrize("kind", FORMS | INDICES)
def test_leaves_of_every_type(kind, background, batch, tmp_path, monkeypatch):
    monkeypatch.setattr(vdb_tree, "LEAVES_PER_BATCH", batch)
    tree = random_tree(kind=kind, background=min(background, background_of(kind)))
    tree.tiles |= {((128, 0, -128), 128): (min(2, background_of(kind)), True), ((256, 0, 0), 128): (0, True)}
    for codec in (NONE, ZIP, BLOSC):
        (grid,) = open_grids(write(tmp_path, encode([("density", encode_grid(tree))], codec=codec)))
        assert_leaves_are_the_dense_voxels(grid)


def test_other_types_have_no_leaves(tmp_path):
    grid = bytearray(encode_grid(random_tree()))
    struct.pack_into("<I", grid, 636, 12)
    (listed,) = open_grids(write(tmp_path, encode([("velocity", bytes(grid))])))
    assert listed.read_leaves is None


def test_leaves_far_apart_are_read_without_the_space_between(tmp_path):
    ones = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    tree = Tree(leaves={(0, 0, 0): ones, (2000, 2000, 2000): ones})
    path = write(tmp_path, encode([("density", encode_grid(tree))], codec=ZIP))
    volume, peak = peak_of(lambda: Volume.load(path))
    assert volume.shape == (2008, 2008, 2008)
    assert volume.leaves.coordinates.tolist() == [[0, 0, 0], [250, 250, 250]]
    assert peak < 4 << 20


def test_tiles_that_expand_to_too_many_leaves_cost_nothing(tmp_path):
    """A small file whose tiles, each of 4096 leaves, would take more than 8 GiB."""
    places = list(itertools.product(range(11), range(10), range(10)))
    tree = Tree(tiles={((128 * x, 128 * y, 128 * z), 128): (1, True) for x, y, z in places})
    path = write(tmp_path, encode([("density", encode_grid(tree))], codec=ZIP))
    (grid,) = open_grids(path)
    for function in (lambda: choose_grid(path), grid.read_leaves):
        error, peak = peak_of(function)
        assert isinstance(error, VolumeError)
        assert str(path) in str(error)
        assert f"takes {1100 * 4096:,} leaves of 8³ voxels; the limit is {MAX_LEAVES:,}" in str(error)
        assert peak < 4 << 20


@pytest.mark.parametrize("codec", [NONE, ZIP, BLOSC])
def test_leaves_take_no_more_memory_than_they_must(codec, tmp_path):
    numbers = np.arange(512, dtype="<f4").reshape(8, 8, 8)
    corners = itertools.product(range(0, 128, 8), repeat=3)
    tree = Tree(leaves={corner: (numbers, np.ones((8, 8, 8), bool)) for corner in corners})
    content = encode_grid(tree)
    (grid,) = open_grids(write(tmp_path, encode([("density", content)], codec=codec)))
    leaves, peak = peak_of(grid.read_leaves)
    unpacked = len(content) if codec else 0
    # Besides, some batches of 256 leaves, and the piece that a step of zlib returns.
    assert peak < 1.1 * leaves.nbytes + unpacked + (6 << 20)


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


@pytest.mark.parametrize("codec", [NONE, ZIP, BLOSC])
def test_every_truncation_is_noticed(codec, tmp_path):
    content = encode(
        [("a", encode_grid(random_tree(kind="fpn"))), ("b", encode_grid(random_tree()))], codec=codec
    )
    rng = np.random.default_rng(5)
    for size in [*range(1, 400, 11), *rng.integers(400, len(content), 40).tolist(), len(content) - 1]:
        path = write(tmp_path, content[:size])
        message = try_to_read(path)
        assert str(path) in message, f"cut to {size} of {len(content)} bytes"
        assert "\n" not in message


def flip_bits(kind, codec, trials, seed, tmp_path):
    """Read files with two bits flipped in the packed file or in the grid before packing."""
    grid = encode_grid(vector_tree(kind) if kind in VECTORS else random_tree(kind=kind))
    packed = encode([("a", grid)], codec=codec)
    leaves_at = 672 + struct.unpack_from("<Q", grid, 672)[0]
    rng = np.random.default_rng(seed)
    noticed = 0
    for trial in range(trials):
        original, nodes = (grid, leaves_at) if trial % 2 else (packed, 400)
        damaged = np.frombuffer(original, np.uint8).copy()
        # Most bytes are empty tables or voxels: aim at the others, and at the headers and nodes.
        busy = np.flatnonzero(damaged)
        aims = [busy[busy < nodes], busy, 1000, len(damaged)]
        at = rng.choice(aims[trial // 2 % 4], 2)
        damaged[at] ^= (1 << rng.integers(0, 8, 2)).astype(np.uint8)
        content = encode([("a", damaged.tobytes())], codec=codec) if trial % 2 else damaged.tobytes()
        noticed += bool(try_to_read(write(tmp_path, content)))
    return noticed


@pytest.mark.parametrize(
    ("kind", "codec"),
    [("float32", NONE), ("fpn", ZIP), ("float64", BLOSC), ("on-index", ZIP), ("vec3d", NONE)],
)
def test_flipped_bits_raise_only_volume_errors(kind, codec, tmp_path):
    tracemalloc.start()
    noticed = flip_bits(kind, codec, 60, 6, tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert noticed > 5
    assert peak < 8 * SMALL


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "codec"),
    [("float32", NONE), ("fpn", ZIP), ("float64", BLOSC), ("fp4", BLOSC), ("on-index", ZIP), ("bool", NONE)],
)
def test_many_flipped_bits_raise_only_volume_errors(kind, codec, tmp_path):
    assert flip_bits(kind, codec, 500, 7, tmp_path) > 30


ABSURD = 0x7FFFFFFF
ROOT_AT = 672 + 64
UPPER_AT = ROOT_AT + 64 + 2 * 32


@pytest.mark.parametrize(
    ("offset", "layout", "number"),
    [
        (0, "Q", 0),  # magic of the grid
        (16, "I", 31 << 21),  # version
        (636, "I", 2),  # type
        (672 + 24, "Q", 1 << 63),  # offset of the root
        (672 + 24, "Q", (1 << 64) - 672),  # the same, wrapping
        (ROOT_AT + 24, "I", ABSURD),  # tiles
        (ROOT_AT + 64, "Q", 0),  # a key that repeats
        (ROOT_AT + 72, "q", 1 << 62),  # upper node
        (ROOT_AT + 72, "q", -(1 << 63)),
        (ROOT_AT + 72, "q", -ROOT_AT),  # an upper node that is the grid's header
        (UPPER_AT + 4128, "Q", (1 << 64) - 1),  # 64 children whose offsets are tile values
        (296 + 88, "d", math.nan),  # transform
    ],
)
def test_absurd_numbers_cost_nothing(offset, layout, number, tmp_path):
    tree = random_tree()
    tree.leaves = {origin: leaf for origin, leaf in tree.leaves.items() if origin[2] >= 0}
    tree.leaves[0, 0, 0] = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    grid = bytearray(encode_grid(tree))
    keys = np.frombuffer(bytes(grid), "<u8", 8, ROOT_AT + 64)[[0, 4]]
    assert 0 in keys
    if number == 0 and offset == ROOT_AT + 64:
        struct.pack_into("<Q", grid, ROOT_AT + 64, 0)
        struct.pack_into("<Q", grid, ROOT_AT + 96, 0)
    struct.pack_into("<" + layout, grid, offset, number)
    path = write(tmp_path, encode([("density", bytes(grid))]))
    tracemalloc.start()
    message = try_to_read(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "damaged or incomplete" in message or "version 31" in message
    assert peak < 4 << 20


def test_one_node_behind_all_pointers_costs_nothing(tmp_path):
    """A file of 300 kB whose pointers all lead to the same node would be a tree of 134 million leaves."""
    leaf = (np.ones((8, 8, 8)), np.ones((8, 8, 8), bool))
    grid = bytearray(encode_grid(Tree(leaves={(0, 0, 0): leaf})))
    upper_at = ROOT_AT + 64 + 32
    for at, size, table_at, count in (
        (upper_at, 270400, 8256, 32**3),
        (upper_at + 270400, 33856, 1088, 16**3),
    ):
        grid[at + 32 + count // 8 : at + 32 + count // 4] = b"\xff" * (count // 8)
        grid[at + table_at : at + size] = struct.pack("<q", upper_at + 270400 - at or 33856) * count
    path = write(tmp_path, encode([("density", bytes(grid))]))
    tracemalloc.start()
    message = try_to_read(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "32768 nodes of 33856 bytes do not lie in the grid" in message
    assert peak < 8 << 20


def test_type_of_grid_and_metadata_must_be_the_same(tmp_path):
    content = bytearray(encode([("density", encode_grid(random_tree()))]))
    struct.pack_into("<I", content, 16 + 32, 4)  # int32, of the same layout
    with pytest.raises(VolumeError, match="of type 1, not 4"):
        open_grids(write(tmp_path, bytes(content)))


@pytest.mark.parametrize("codec", [ZIP, BLOSC])
def test_a_size_that_cannot_be_is_not_allocated(codec, tmp_path):
    content = bytearray(encode([("density", encode_grid(random_tree()))], codec=codec))
    for size in (1 << 29, 1 << 62, 0):
        struct.pack_into("<Q", content, 16, size)
        tracemalloc.start()
        message = try_to_read(write(tmp_path, bytes(content)))
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert "damaged or incomplete" in message
        assert peak < 4 << 20


def test_other_files_are_refused(tmp_path):
    for wrong, words in [
        (b"", "not a NanoVDB file"),
        (b" BDV" + bytes(100), "not a NanoVDB file"),
        (b"NanoVDB0", "cut short"),
        (encode([("a", encode_grid(random_tree()))], codec=3), "damaged or incomplete"),
    ]:
        with pytest.raises(VolumeError, match=words):
            open_grids(write(tmp_path, wrong))
