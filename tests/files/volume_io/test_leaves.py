"""Sparse voxels against NumPy on the dense array."""

import math
import tracemalloc
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tfm_cl.errors import VolumeError
from tfm_cl.files.volume_io import leaves as module
from tfm_cl.files.volume_io.leaves import Leaves

SUM = 1e-12
"""Relative: a few thousand float64 terms added in another order than NumPy's."""


@pytest.fixture(autouse=True, scope="module")
def small_batches():
    """Several batches and blocks even for small grids."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_BATCH", 3)
        patch.setattr(module, "_BLOCK", (8, 16, 8))
        yield


def array_of(shape, seed, share, low):
    """Voxels of which a share is set in clumps, so that some leaves stay empty; low < 0: also negative."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(low, 1, shape).astype(np.float32)
    clumps = rng.random([-(-n // 5) for n in shape]) < share
    for axis in range(3):
        clumps = clumps.repeat(5, axis)
    return np.where(clumps[tuple(slice(n) for n in shape)], values, np.float32(0))


shapes = st.tuples(*[st.integers(1, 29)] * 3)
arrays = st.builds(
    array_of, shapes, st.integers(0, 99), st.sampled_from([0.0, 0.05, 0.5, 1.0]), st.sampled_from([0, -1])
)
firsts = st.tuples(*[st.integers(0, 7)] * 3)


def leaves_of(array, first):
    """Leaves of an array whose voxel (0, 0, 0) lies at ``first``, by padding."""
    padded = Leaves.from_dense(np.pad(array, [(offset, 0) for offset in first]))
    return Leaves(array.shape, first, padded.coordinates, padded.values)


def bits(array):
    return np.ascontiguousarray(array, np.float32).view(np.int32)


# ------------------------------------------------------------------------------------- dense and back


@given(arrays, firsts)
def test_round_trip(array, first):
    leaves = leaves_of(array, first)
    assert leaves.shape == array.shape
    dense = leaves.to_dense()
    assert dense.flags.c_contiguous
    np.testing.assert_array_equal(bits(dense), bits(array))


@given(arrays)
def test_leaves_are_the_blocks_that_hold_something(array):
    leaves = Leaves.from_dense(array)
    padded = np.pad(array, [(0, -n % 8) for n in array.shape])
    z, y, x = (n // 8 for n in padded.shape)
    blocks = padded.reshape(z, 8, y, 8, x, 8).transpose(0, 2, 4, 1, 3, 5)
    expected = np.argwhere(blocks.any(axis=(3, 4, 5)))
    assert leaves.first == (0, 0, 0)
    assert leaves.dims == (z, y, x)
    np.testing.assert_array_equal(leaves.coordinates, expected)
    np.testing.assert_array_equal(leaves.values, blocks[tuple(expected.T)])
    assert leaves.nbytes == len(expected) * (3 * 4 + 512 * 4)


def test_what_is_no_plain_number_survives():
    array = np.zeros((9, 9, 9), np.float32)
    array[0, 0, :6] = [np.nan, np.inf, -np.inf, -0.0, 1e-45, 3.4e38]
    array[8, 8, 8] = -0.0
    leaves = Leaves.from_dense(array)
    assert len(leaves.values) == 2
    np.testing.assert_array_equal(bits(leaves.to_dense()), bits(array))


@pytest.mark.parametrize("dtype", ["?", "u1", "i8", "f2", ">f4", "f8"])
def test_other_types_and_layouts(dtype):
    array = array_of((17, 9, 12), 1, 0.5, 0) * 100
    for same in (array.astype(dtype).T, array.astype(dtype)[::-1, ::2, 1:]):
        np.testing.assert_array_equal(Leaves.from_dense(same).to_dense(), same.astype(np.float32))


def test_an_array_without_a_voxel():
    leaves = Leaves.from_dense(np.zeros((0, 3, 4)))
    assert leaves.to_dense().shape == leaves.shape == (0, 3, 4)
    assert (leaves.active(), leaves.occupied_box()) == (0, None)
    assert math.isnan(leaves.mean())


def peak_of(function, *arguments):
    tracemalloc.start()
    result = function(*arguments)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return result, peak


@pytest.mark.quick("shape0")
@pytest.mark.parametrize("shape", [(256, 256, 256), (1, 4096, 4096), (4001, 4001, 1), (1, 1, 1 << 24)])
def test_no_second_dense_array(shape, monkeypatch):
    array = np.zeros(shape, np.float32)
    array[0, 0, 0] = array[-1, -1, -1] = 1
    monkeypatch.setattr(module, "_BLOCK", (8, 64, 4096))
    leaves, peak = peak_of(Leaves.from_dense, array)
    assert len(leaves.values) == 2
    # The blocks looked at, and the table of occupied leaves with its byte each.
    assert peak < (4 << 20) + 4 * math.prod(leaves.dims)


def test_too_many_leaves_are_refused(monkeypatch):
    monkeypatch.setattr(module, "MAX_LEAVES", 7)
    array = np.ones((16, 16, 16), np.float32)
    with pytest.raises(VolumeError, match=r"16×16×16 voxels make 8 leaves .*; the limit is 7"):
        Leaves.from_dense(array)
    array[8:, 8:, 8:] = 0
    assert len(Leaves.from_dense(array).values) == 7


# -------------------------------------------------------------------------------------- what they are


def test_voxels_outside_the_grid_become_zero():
    coordinates = np.argwhere(np.ones((2, 1, 2))).astype(np.int32)
    values = np.full((4, 8, 8, 8), 2, np.float32)
    leaves = Leaves((9, 3, 8), (1, 2, 4), coordinates, values)
    expected = np.zeros((16, 8, 16), np.float32)
    expected[1:10, 2:5, 4:12] = 2
    inner = leaves.values.reshape(2, 2, 8, 8, 8).transpose(0, 2, 3, 1, 4).reshape(16, 8, 16)
    np.testing.assert_array_equal(inner, expected)
    assert leaves.active() == 9 * 3 * 8
    assert (values == 2).all()  # the caller's array is as it was


def test_arrays_are_read_only_and_not_copied():
    coordinates, values = np.zeros((1, 3), np.int32), np.ones((1, 8, 8, 8), np.float32)
    leaves = Leaves((8, 8, 8), (0, 0, 0), coordinates, values)
    assert np.shares_memory(leaves.values, values)
    for array in (leaves.values, leaves.coordinates):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


def test_identity():
    array = np.ones((8, 8, 8))
    one, other = Leaves.from_dense(array), Leaves.from_dense(array)
    assert one == one  # noqa: PLR0124 - what is tested
    assert one != other
    assert len({one, other}) == 2
    assert weakref.ref(one)() is one


GOOD = {
    "shape": (16, 16, 16),
    "first": (0, 0, 0),
    "coordinates": np.array([[0, 0, 1], [0, 1, 0]], np.int32),
    "values": np.zeros((2, 8, 8, 8), np.float32),
}


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"shape": (16, -1, 16)}, r"shape is three .* got \(16, -1, 16\)"),
        ({"first": (0, 8, 0)}, r"first is three .* got \(0, 8, 0\)"),
        ({"coordinates": np.zeros((2, 3))}, r"coordinates is int32 \[2, 3\]; got float64"),
        ({"coordinates": np.zeros((2, 2), np.int32)}, r"coordinates is int32 \[2, 3\]"),
        ({"values": np.zeros((3, 8, 8, 8), np.float32)}, r"values is float32 \[2, 8, 8, 8\]"),
        ({"values": np.zeros((2, 8, 8, 8))}, r"values is float32"),
        ({"coordinates": np.array([[0, 0, 1], [0, 0, 2]], np.int32)}, r"below \(2, 2, 2\); got .* 2\]"),
        ({"coordinates": np.array([[0, -1, 1], [0, 0, 1]], np.int32)}, "≥ 0"),
        ({"shape": (16, 8, 16)}, r"below \(2, 1, 2\)"),
        ({"shape": (0, 16, 16)}, r"below \(0, 2, 2\)"),
        ({"coordinates": np.array([[0, 1, 0], [0, 0, 1]], np.int32)}, "not ordered"),
        ({"coordinates": np.array([[0, 1, 0], [0, 1, 0]], np.int32)}, "repeat"),
    ],
)
def test_arrays_that_are_no_leaves(changed, message):
    Leaves(**GOOD)
    with pytest.raises(VolumeError, match=message):
        Leaves(**GOOD | changed)


def test_arrays_of_two_axes_are_refused():
    with pytest.raises(VolumeError, match=r"shape \(3, 4\)"):
        Leaves.from_dense(np.zeros((3, 4)))


# ---------------------------------------------------------------------------------------- statistics


@given(arrays, firsts)
def test_statistics(array, first):
    leaves = leaves_of(array, first)
    assert leaves.max() == array.max()
    assert leaves.min() == array.min()
    assert leaves.mean() == pytest.approx(array.mean(dtype=np.float64), rel=SUM, abs=SUM)
    assert leaves.active() == np.count_nonzero(array)
    assert leaves.not_finite() == 0


@given(arrays, firsts)
def test_occupied_box(array, first):
    places = np.argwhere(array > 0)
    box = leaves_of(array, first).occupied_box()
    if len(places) == 0:
        assert box is None
    else:
        assert box == (tuple(places.min(axis=0)), tuple(places.max(axis=0)))


def placed(leaves, axis, columns, blocks):
    """Sums of columns of leaves as of the dense array."""
    one, two = (other for other in range(3) if other != axis)
    padded = np.zeros((leaves.dims[one], 8, leaves.dims[two], 8))
    padded[columns[:, 0], :, columns[:, 1], :] = blocks
    lines = padded.reshape(8 * leaves.dims[one], 8 * leaves.dims[two])
    low, size = leaves.first, leaves.shape
    return lines[low[one] : low[one] + size[one], low[two] : low[two] + size[two]]


@given(arrays, firsts, st.integers(0, 2))
def test_column_sums(array, first, axis):
    leaves = leaves_of(array, first)
    expected = array.sum(axis=axis, dtype=np.float64)
    columns, blocks = leaves.column_sums(axis)
    assert blocks.dtype == np.float64
    sums = placed(leaves, axis, columns, blocks)
    np.testing.assert_allclose(sums, expected, rtol=SUM, atol=SUM * array.shape[axis])
    assert len(columns) == len(blocks) == len(np.unique(np.delete(leaves.coordinates, axis, 1), axis=0))
    np.testing.assert_allclose(
        np.sort(blocks[blocks != 0]), np.sort(sums[sums != 0]), rtol=SUM, atol=SUM * array.shape[axis]
    )


def test_a_grid_without_a_zero():
    array = np.full((9, 8, 10), 2, np.float32)
    assert leaves_of(array, (1, 2, 3)).min() == 2
    assert leaves_of(-array, (1, 2, 3)).max() == -2


def spoilt(array, seed, count):
    """The array with some voxels that are no densities."""
    rng = np.random.default_rng(seed)
    places = tuple(rng.integers(0, n, count) for n in array.shape)
    array[places] = rng.choice([np.nan, np.inf, -np.inf, -1], count)
    return array


wrong_arrays = st.builds(
    spoilt,
    st.builds(array_of, shapes, st.integers(0, 99), st.sampled_from([0.0, 0.5]), st.just(0)),
    st.integers(0, 99),
    st.integers(0, 20),
)


@given(wrong_arrays, firsts)
def test_statistics_leave_out_what_is_not_finite(array, first):
    leaves, finite = leaves_of(array, first), array[np.isfinite(array)]
    assert leaves.not_finite() == array.size - finite.size
    if finite.size:
        assert (leaves.min(), leaves.max()) == (finite.min(), finite.max())
        assert leaves.mean() == pytest.approx(finite.mean(dtype=np.float64), rel=SUM, abs=SUM)
    else:
        assert all(math.isnan(number) for number in (leaves.min(), leaves.max(), leaves.mean()))


@given(wrong_arrays, firsts)
def test_voxels_that_are_no_densities(array, first):
    leaves = leaves_of(array, first)
    is_wrong = ~np.isfinite(array) | (array < 0)
    found = leaves.not_densities()
    if not is_wrong.any():
        assert found is None
        return
    assert found.total == np.count_nonzero(is_wrong)
    assert found.first == tuple(np.argwhere(is_wrong)[0])
    np.testing.assert_equal(np.float32(found.value), array[found.first])
    clean = leaves.sanitized()
    assert clean.values.any(axis=(1, 2, 3)).all()
    np.testing.assert_array_equal(clean.to_dense(), np.where(is_wrong, 0, array))
    assert leaves.not_densities() == found or math.isnan(found.value)  # the first leaves are as they were


def test_statistics_of_a_huge_grid_cost_nothing():
    coordinates = np.array([[0, 0, 0], [0, 5791, 5791]], np.int32)
    values = np.zeros((2, 8, 8, 8), np.float32)
    values[0, 1, 2, 3], values[1, 4, 5, 6] = 2, 4
    leaves = Leaves((8, 46336, 46336), (0, 0, 0), coordinates, values)
    assert math.prod(leaves.shape) > 1 << 33

    def measure():
        sums = [leaves.column_sums(axis)[1].sum() for axis in range(3)]
        return sums, leaves.min(), leaves.max(), leaves.mean(), leaves.active(), leaves.occupied_box()

    measured, peak = peak_of(measure)
    box = (1, 2, 3), (4, 5 + 8 * 5791, 6 + 8 * 5791)
    assert measured == ([6, 6, 6], 0, 4, 6 / math.prod(leaves.shape), 2, box)
    assert peak < 1 << 20
