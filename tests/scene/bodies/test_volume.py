import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

from tfm_cl.errors import VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io import limits
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.scene.bodies.volume import Volume

SPARSE = Path(__file__).resolve().parents[2] / "files" / "volume_io" / "data" / "negative.vdb"
"""Three leaves in a box of 45; they lie at negative coordinates."""
SHEARED = np.array([[0, -2, 0, 10], [3, 0, 1, 20], [0, 0, 4, 30], [0, 0, 0, 1]], dtype=np.float64)


@pytest.fixture
def data():
    return np.random.default_rng(0).random((2, 3, 4), np.float32)


@pytest.mark.parametrize("dtype", ["?", "u1", "i8", "f2", ">f4", "f8"])
def test_any_real_type_becomes_float32(dtype):
    array = np.arange(24).reshape(2, 3, 4) % 2
    volume = Volume(array.astype(dtype))
    assert volume.data.dtype == np.float32
    assert volume.data.flags.c_contiguous
    np.testing.assert_array_equal(volume.data, array)


def test_lists_and_transposed_arrays(data):
    assert Volume([[[1, 2]]]).shape == (1, 1, 2)
    np.testing.assert_array_equal(Volume(data.T).data, data.T)


def test_the_callers_array_is_neither_kept_nor_frozen(data):
    volume, before = Volume(data), data.copy()
    data[:] = 7
    np.testing.assert_array_equal(volume.data, before)
    with pytest.raises(ValueError, match="read-only"):
        volume.data[0, 0, 0] = 1
    with pytest.raises(ValueError, match="read-only"):
        volume.world_from_index[0, 0] = 1


def test_by_default_voxels_are_units_with_the_low_corner_at_0(data):
    volume = Volume(data)
    np.testing.assert_array_equal(volume.world_from_index @ [0, 0, 0, 1], [0.5, 0.5, 0.5, 1])
    np.testing.assert_array_equal(volume.voxel_size, [1, 1, 1])


def test_voxel_size_and_origin(data):
    volume = Volume(data, voxel_size=(1, 2, 4), origin=(10, 20, 30))
    np.testing.assert_allclose(volume.world_from_index @ [3, 2, 1, 1], [13.5, 25, 36, 1])
    np.testing.assert_allclose(Volume(data, voxel_size=0.5).voxel_size, [0.5] * 3)


def test_bounds_include_the_border_voxel(data):
    # 4×3×2 voxels: outermost centres at 0.5 and 3.5 (x); one voxel further the density is 0.
    np.testing.assert_allclose(Volume(data).bounds, [[-0.5, -0.5, -0.5], [4.5, 3.5, 2.5]])


def test_bounds_of_a_sheared_grid(data):
    volume = Volume(data, world_from_index=SHEARED)
    # Index corners -1 and 4, 3, 2. x = 10 - 2j, y = 20 + 3i + k, z = 30 + 4k.
    np.testing.assert_allclose(volume.bounds, [[10 - 6, 20 - 3 - 1, 30 - 4], [10 + 2, 20 + 12 + 2, 30 + 8]])
    np.testing.assert_allclose(volume.voxel_size, [3, 2, np.sqrt(17)])


def test_occupied_bounds_are_tight_and_include_the_border():
    data = np.zeros((10, 10, 10))
    data[2, 3, 4] = data[5, 3, 7] = 1
    volume = Volume(data, voxel_size=2)
    # Centres at 2(i + ½): x from 9 to 15, y at 7, z from 5 to 11; a border of 2 around.
    np.testing.assert_allclose(volume.occupied_bounds, [[7, 5, 3], [17, 9, 13]])


def test_occupied_bounds_of_nothing_are_all(data):
    volume = Volume(np.zeros_like(data))
    np.testing.assert_array_equal(volume.occupied_bounds, volume.bounds)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -1.0])
def test_values_that_are_no_density(data, value):
    data[1, 2, 3] = value
    with pytest.raises(VolumeError, match=r"1 densities .* at \[z=1, y=2, x=3\].*sanitize"):
        Volume(data)
    volume = Volume(data, sanitize=True)
    assert volume.data[1, 2, 3] == 0
    np.testing.assert_array_equal(volume.data.ravel()[:-1], data.ravel()[:-1])


def test_values_beyond_float32_are_found():
    with pytest.raises(VolumeError, match="infinite"):
        Volume(np.full((1, 1, 1), 1e300))


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((3, 4)), r"shape \(3, 4\)"),
        (np.zeros((0, 3, 4)), "non-empty"),
        (np.zeros((2, 3, 4), complex), "complex128"),
        (np.full((2, 3, 4), "a"), "type <U1"),
        (np.full((2, 3, 4), None), "type object"),
    ],
)
def test_arrays_that_are_no_volume(array, message):
    with pytest.raises(VolumeError, match=message):
        Volume(array)


@pytest.mark.parametrize(
    ("placed", "message"),
    [
        ({"voxel_size": 0}, "voxel_size is > 0"),
        ({"voxel_size": (1, -1, 1)}, "voxel_size is > 0"),
        ({"voxel_size": (1, 1)}, "voxel_size is three"),
        ({"voxel_size": np.nan}, "finite"),
        ({"origin": (0, 0)}, "origin is three"),
        ({"origin": (0, 0, np.inf)}, "finite"),
        ({"world_from_index": np.eye(3)}, "finite 4×4 matrix"),
        ({"world_from_index": np.full((4, 4), np.nan)}, "finite 4×4 matrix"),
        ({"world_from_index": np.ones((4, 4))}, "affine"),
        ({"world_from_index": np.diag([1, 1, 0, 1])}, "cannot be inverted"),
        ({"world_from_index": SHEARED, "voxel_size": 1}, "brings its own transform"),
        ({"world_from_index": SHEARED, "origin": (0, 0, 0)}, "brings its own transform"),
        ({"density_scale": -1}, "density_scale"),
        ({"density_scale": np.inf}, "density_scale"),
    ],
)
def test_wrong_placement_and_scale(data, placed, message):
    with pytest.raises(VolumeError, match=message):
        Volume(data, **placed)


def test_flat_but_not_singular_voxels_are_accepted(data):
    assert Volume(data, voxel_size=(1, 1, 1e-9)).voxel_size[2] == pytest.approx(1e-9)


def test_another_density_scale_shares_the_voxels(data):
    volume = Volume(data, density_scale=2.0)
    other = volume.with_density_scale(3.0)
    assert (volume.density_scale, other.density_scale) == (2.0, 3.0)
    assert other.data is volume.data
    with pytest.raises(VolumeError, match="density_scale"):
        volume.with_density_scale(-1)


def test_repr_tells_name_size_and_scale(data):
    text = repr(Volume(data, name="smoke", density_scale=2))
    assert text == "Volume(smoke, 4×3×2 voxels, density_scale=2)"


def test_load_places_a_file_without_a_transform(tmp_path, data):
    np.save(tmp_path / "a.npy", data)
    volume = Volume.load(str(tmp_path / "a.npy"), voxel_size=2.0, origin=(1, 1, 1), density_scale=3)
    np.testing.assert_array_equal(volume.data, data)
    np.testing.assert_array_equal(volume.world_from_index @ [0, 0, 0, 1], [2, 2, 2, 1])
    assert (volume.name, volume.source, volume.density_scale) == ("density", tmp_path / "a.npy", 3)


def test_load_takes_the_transform_of_the_file(tmp_path, data):
    np.savez(tmp_path / "a.npz", fog=data, world_from_index=SHEARED)
    np.testing.assert_array_equal(Volume.load(tmp_path / "a.npz", "fog").world_from_index, SHEARED)
    with pytest.raises(VolumeError, match=r"a\.npz: grid 'fog': it brings its own transform"):
        Volume.load(tmp_path / "a.npz", voxel_size=1.0)


def test_load_names_the_file_in_its_errors(tmp_path, data):
    data[0, 0, 0] = -1
    np.save(tmp_path / "a.npy", data)
    with pytest.raises(VolumeError, match=r"a\.npy: grid 'density': 1 densities"):
        Volume.load(tmp_path / "a.npy")
    assert Volume.load(tmp_path / "a.npy", sanitize=True).data[0, 0, 0] == 0
    with pytest.raises(VolumeError, match="no grid named 'heat'"):
        Volume.load(tmp_path / "a.npy", "heat")


# ---------------------------------------------------------------------------------- dense or leaves

FORMS = {"dense": lambda array: array, "leaves": Leaves.from_dense}
forms = pytest.mark.parametrize("form", FORMS.values(), ids=FORMS.keys())


def forbid_conversion(monkeypatch):
    """Fail where one form is made of the other."""

    def refuse(*_):
        raise AssertionError("made the other form")

    monkeypatch.setattr(Leaves, "to_dense", refuse)
    monkeypatch.setattr(Leaves, "from_dense", refuse)


@forms
def test_facts_are_the_same_in_both_forms(form, monkeypatch):
    density = blobs((30, 21, 17))
    density[:9] = 0
    stored, placed = form(density), {"world_from_index": SHEARED, "density_scale": 2.0}
    places = np.argwhere(density > 0)
    corners = np.array([places.min(axis=0) - 1, places.max(axis=0) + 1])[:, ::-1]
    box = np.array(np.meshgrid(*corners.T)).reshape(3, -1).T @ SHEARED[:3, :3].T + SHEARED[:3, 3]
    forbid_conversion(monkeypatch)
    volume = Volume(stored, **placed)
    assert volume.shape == (30, 21, 17)
    np.testing.assert_array_equal(volume.bounds, Volume(density, **placed).bounds)
    np.testing.assert_allclose(volume.occupied_bounds, [box.min(axis=0), box.max(axis=0)])
    for axis in range(3):
        sums, expected = volume.line_sums(axis), density.sum(axis=axis, dtype=np.float64)
        assert sums.dtype == np.float64
        np.testing.assert_allclose(np.sort(sums[sums > 0]), np.sort(expected[expected > 0]), rtol=1e-12)
    assert repr(volume) == "Volume(array, 17×21×30 voxels, density_scale=2)"


@forms
def test_either_form_gives_both(form):
    density = blobs((30, 21, 17))
    volume = Volume(form(density))
    np.testing.assert_array_equal(volume.data, density)
    assert volume.data is volume.data
    with pytest.raises(ValueError, match="read-only"):
        volume.data[0, 0, 0] = 1
    np.testing.assert_array_equal(volume.leaves.to_dense(), density)
    assert (volume.leaves is volume.leaves) == (form is FORMS["leaves"])


@forms
def test_occupied_bounds_of_nothing_are_all_in_both_forms(form):
    volume = Volume(form(np.zeros((9, 3, 4))))
    np.testing.assert_array_equal(volume.occupied_bounds, volume.bounds)


@forms
def test_values_that_are_no_density_in_both_forms(form, monkeypatch):
    density = blobs((30, 21, 17))
    # The first in the array's order lies in a later leaf than the second.
    density[3, 2, 16], density[3, 9, 0], density[29, 20, 16] = np.nan, -1, np.inf
    stored = form(density)
    clean = density.copy()
    clean[3, 2, 16] = clean[3, 9, 0] = clean[29, 20, 16] = 0
    message = r"^array: 3 densities are negative, infinite or NaN, the first nan at \[z=3, y=2, x=16\]; .*"
    with monkeypatch.context() as patch:
        forbid_conversion(patch)
        with pytest.raises(VolumeError, match=message):
            Volume(stored)
        volume = Volume(stored, sanitize=True)
    np.testing.assert_array_equal(volume.data, clean)


@forms
def test_a_volume_has_a_voxel_in_both_forms(form):
    with pytest.raises(VolumeError, match=r"non-empty .* the shape \(0, 3, 4\)"):
        Volume(form(np.zeros((0, 3, 4))))


@forms
def test_same_voxels(form):
    stored = form(blobs())
    volume, equal = Volume(stored), Volume(form(blobs()))
    other = volume.with_density_scale(3)
    assert volume.same_voxels(volume)
    assert volume.same_voxels(other)
    assert not volume.same_voxels(equal)
    assert other.data is volume.data  # made once, whichever is asked


def test_volumes_of_the_same_leaves_have_the_same_voxels():
    leaves = Leaves.from_dense(blobs())
    assert Volume(leaves).same_voxels(Volume(leaves, voxel_size=2))
    assert Volume(leaves).leaves is leaves


@forms
def test_volumes_are_keys(form):
    volume, equal = Volume(form(blobs())), Volume(form(blobs()))
    table = weakref.WeakKeyDictionary({volume: 1, equal: 2})
    assert (table[volume], table[equal]) == (1, 2)
    del equal
    gc.collect()
    assert len(table) == 1


def test_an_array_that_nobody_can_write_to_is_kept():
    density = blobs()
    density.flags.writeable = False
    for frozen in (density, np.frombuffer(density.tobytes(), np.float32).reshape(density.shape)):
        volume = Volume(frozen)
        assert np.shares_memory(volume.data, frozen)
        assert Volume(volume.data).same_voxels(volume)


def frozen_view(array):
    view = array.view()
    view.flags.writeable = False
    return view


@pytest.mark.parametrize(
    "changed",
    [
        frozen_view,
        lambda array: frozen_view(frozen_view(array)[1:]),
        lambda array: frozen_view(np.frombuffer(bytearray(array.tobytes()), np.float32).reshape(array.shape)),
        lambda array: frozen_view(array.copy().T),
        lambda array: frozen_view(array.astype(">f4")),
    ],
)
def test_other_read_only_arrays_are_copied(changed):
    view = changed(blobs())
    volume = Volume(view)
    assert not np.shares_memory(volume.data, view)
    np.testing.assert_array_equal(volume.data, view)


def test_sanitizing_leaves_a_read_only_array_as_it_was():
    density = blobs()
    density[0, 0, 0] = -1
    density.flags.writeable = False
    assert Volume(density, sanitize=True).data[0, 0, 0] == 0
    assert density[0, 0, 0] == -1


def test_load_keeps_the_leaves_of_a_tree(monkeypatch):
    (grid,) = volume_io.open_grids(SPARSE)
    expected = grid.read()
    volume = Volume.load(SPARSE)
    assert volume.leaves is volume.leaves
    np.testing.assert_array_equal(volume.data.view(np.int32), expected.view(np.int32))
    forbid_conversion(monkeypatch)
    again = Volume.load(SPARSE)
    assert again.shape == expected.shape
    np.testing.assert_array_equal(again.occupied_bounds, volume.occupied_bounds)
    assert again.with_density_scale(2).leaves is again.leaves


def test_load_does_not_copy_an_array(tmp_path, data, monkeypatch):
    np.save(tmp_path / "a.npy", data)
    read = []
    read_grid = volume_io.read_grid
    monkeypatch.setattr(volume_io, "read_grid", lambda *args: read.append(read_grid(*args)) or read[-1])
    volume = Volume.load(tmp_path / "a.npy")
    assert volume.data is read[0]
    np.testing.assert_array_equal(volume.data, data)


def test_a_dense_array_of_too_many_voxels_is_refused(monkeypatch):
    monkeypatch.setattr(limits, "MAX_VOXELS", 24 * 24 * 24)
    ones = np.ones((24, 24, 24), np.float32)
    assert Volume(Leaves.from_dense(ones)).data.shape == ones.shape
    wide = np.ones((24, 24, 25), np.float32)
    volume = Volume(Leaves.from_dense(wide), name="fog")
    words = "fog: spans 25×24×24 = 14,400 voxels; the limit is 13,824 for a dense array; .leaves are"
    with pytest.raises(VolumeError, match=words):
        _ = volume.data
    assert volume.occupied_bounds.shape == (2, 3)
    assert Volume(wide).data.shape == wide.shape  # it is there already


def test_too_many_leaves_of_an_array_are_refused(monkeypatch):
    monkeypatch.setattr("tfm_cl.files.volume_io.leaves.MAX_LEAVES", 7)
    with pytest.raises(VolumeError, match=r"^fog: 16×16×16 voxels make 8 leaves .* limit is 7$"):
        _ = Volume(np.ones((16, 16, 16)), name="fog").leaves
