import json

import numpy as np
import pytest

from tfm_cl.errors import VolumeError
from tfm_cl.files import volume_io
from tfm_cl.files.volume_io import FORMATS, choose_grid, open_grids, read_grid, read_stored
from tfm_cl.files.volume_io.grid import Grid
from tfm_cl.files.volume_io.leaves import Leaves


@pytest.fixture
def archive(tmp_path):
    """Write an archive with grids of these names, each full of its own number 1, 2 …."""

    def write(*names, **others):
        path = tmp_path / "a.npz"
        arrays = {name: np.full((2, 3, 4), 1 + i, np.float32) for i, name in enumerate(names)}
        np.savez(path, **arrays, **others)
        return path

    return write


@pytest.fixture
def described(tmp_path, monkeypatch):
    """Pretend that a file holds these grids; fields not named are those of a sound one."""

    def describe(*fields):
        sound = {
            "name": "density",
            "grid_class": "fog volume",
            "value_type": "float32",
            "shape": (2, 3, 4),
            "world_from_index": np.eye(4),
            "has_transform": True,
            "read": lambda: np.zeros((2, 3, 4), np.float32),
        }
        grids = [Grid(**(sound | changed)) for changed in fields]
        monkeypatch.setattr(volume_io, "open_grids", lambda _: grids)
        return tmp_path / "a.vdb"

    return describe


def test_the_grid_named_is_chosen(archive):
    path = archive("density", "heat")
    assert read_grid(path, choose_grid(path, "heat")).max() == 2


def test_density_is_the_default(archive):
    path = archive("heat", "density", "fuel")
    assert read_grid(path, choose_grid(path)).max() == 2


def test_the_only_grid_is_the_default(archive):
    assert choose_grid(archive("smoke")).name == "smoke"


def test_the_only_grid_that_can_be_rendered_is_the_default(archive):
    path = archive("smoke", velocity=np.zeros((2, 3, 4), np.complex64), empty=np.zeros((0, 3, 4)))
    assert choose_grid(path).name == "smoke"


def test_several_grids_are_listed(archive):
    with pytest.raises(VolumeError, match=r"'heat', 'fuel'\); choose one with --grid NAME"):
        choose_grid(archive("heat", "fuel"))


def test_unknown_names_list_the_known_ones(archive):
    with pytest.raises(VolumeError, match=r"no grid named 'heta'; it has 'density', 'heat'"):
        choose_grid(archive("density", "heat"), "heta")


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"grid_class": "level set"}, "is a level set .*sdfToFogVolume"),
        ({"unsupported": "vec3s values"}, "cannot be rendered: vec3s values"),
        (
            {"shape": (2048, 2048, 2048)},
            r"spans 2048×2048×2048 = 8,589,934,592 voxels; the limit is 2,147,483,648",
        ),
        ({"shape": (0, 3, 4)}, "is empty"),
    ],
)
def test_grids_that_are_no_density(described, fields, message):
    path = described(fields)
    for name in (None, "density"):
        with pytest.raises(VolumeError, match=f"a.vdb: grid 'density' {message}"):
            choose_grid(path, name)


def test_a_colour_too_large_for_three_dense_channels(described):
    fields = {"shape": (1024, 1024, 1024), "read_colour": lambda: None}
    with pytest.raises(VolumeError, match="spans 3072×1024×1024"):
        choose_grid(described(fields))


def test_a_background_does_not_hinder(described):
    assert choose_grid(described({"background": 0.5})).background == 0.5


def shared(name, count, **fields):
    return [{"name": f"{name}[{number}]", "shared_name": name} | fields for number in range(count)]


@pytest.mark.parametrize("asked", ["density", None])
def test_a_shared_name_takes_the_first_and_says_so(described, asked):
    path = described({"name": "heat"}, *shared("density", 3))
    grid = choose_grid(path, asked)
    assert grid.name == "density[0]"
    (note,) = grid.notes
    assert note == (
        f"{path}: 3 grids are named 'density'; this is 'density[0]', choose 'density[1]', 'density[2]' "
        "with --grid"
    )
    for number in range(3):
        grid = choose_grid(path, f"density[{number}]")
        assert (grid.name, grid.notes) == (f"density[{number}]", ())


def test_the_first_of_a_shared_name_that_can_be_rendered_is_the_default(described):
    path = described(*shared("density", 1, grid_class="level set"), *shared("density", 2)[1:])
    assert choose_grid(path).name == "density[1]"
    with pytest.raises(VolumeError, match=r"grid 'density\[0\]' is a level set"):
        choose_grid(path, "density")


def test_other_shared_names_are_listed(described):
    path = described(*shared("smoke", 2))
    with pytest.raises(VolumeError, match=r"several grids \('smoke\[0\]', 'smoke\[1\]'\)"):
        choose_grid(path)
    assert choose_grid(path, "smoke").name == "smoke[0]"


def test_grids_of_one_value_come_before_colours(described):
    colour = {"name": "colour", "read_colour": lambda: None}
    parts = [{"name": f"colour[{number}]", "is_part": True} for number in range(3)]
    assert choose_grid(described(colour, {"name": "smoke"})).name == "smoke"
    assert choose_grid(described(colour, *parts)).name == "colour"
    assert choose_grid(described(colour, *parts), "colour[1]").name == "colour[1]"


def test_long_names_and_many_are_cut_in_messages(described):
    name = "\x1b" + "n" * 20_000
    path = described({"name": name}, *({"name": f"grid {number}"} for number in range(500)))
    for asked in (None, "no" * 10_000):
        with pytest.raises(VolumeError) as caught:
            choose_grid(path, asked)
        assert "\x1b" not in str(caught.value)
        assert "and 489 more" in str(caught.value)
        assert len(str(caught.value)) < 700
    with pytest.raises(VolumeError) as caught:
        choose_grid(described({"name": name, "shape": (0, 0, 0)}))
    assert len(str(caught.value)) < 300


def test_the_largest_grid_is_accepted(described):
    assert choose_grid(described({"shape": (2048, 1024, 1024)})).name == "density"


def no_leaves():
    return Leaves.from_dense(np.zeros((2, 3, 4)))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (
            {"shape": (4096, 4096, 1032)},
            r"spans 1032×4096×4096 = 17,314,086,912 voxels; the limit is 17,179,869,184",
        ),
        ({"shape": (8, 8, (1 << 24) + 8)}, r"spans 16777224×8×8 voxels; .* along an axis is 16,777,216"),
        ({"leaf_count": (1 << 22) + 1}, r"takes 4,194,305 leaves of 8³ voxels; the limit is 4,194,304"),
    ],
)
def test_grids_of_too_many_leaves(described, fields, message):
    path = described(fields | {"read_leaves": no_leaves})
    with pytest.raises(VolumeError, match=f"a.vdb: grid 'density' {message}"):
        choose_grid(path)


@pytest.mark.parametrize("shape", [(4096, 2048, 2048), (8, 128, 1 << 24)])
def test_the_largest_grid_of_leaves_is_accepted(described, shape):
    fields = {"shape": shape, "read_leaves": no_leaves, "leaf_count": 1 << 22}
    assert choose_grid(described(fields)).name == "density"


def test_what_is_stored_is_read(described):
    path = described({"read_leaves": no_leaves})
    assert isinstance(read_stored(path, choose_grid(path)), Leaves)
    path = described({})
    assert isinstance(read_stored(path, choose_grid(path)), np.ndarray)


def test_a_level_set_beside_a_fog_volume_is_passed_over(described):
    path = described({"name": "surface", "grid_class": "level set"}, {"name": "smoke"})
    assert choose_grid(path).name == "smoke"


def test_no_failure_while_reading_is_another_exception(described):
    def read():
        raise PermissionError(13, "Permission denied")

    path = described({"read": read})
    with pytest.raises(VolumeError, match=r"a\.vdb: cannot be read \(Permission denied\)"):
        read_grid(path, choose_grid(path))
    path = described({"read_leaves": read})
    with pytest.raises(VolumeError, match=r"a\.vdb: cannot be read \(Permission denied\)"):
        read_stored(path, choose_grid(path))


def test_unknown_extension_lists_the_known(tmp_path):
    with pytest.raises(
        VolumeError, match=r"'\.obj'; known: \.nhdr \.npy \.npz \.nrrd \.nvdb \.raw \.vdb \.vol"
    ):
        open_grids(tmp_path / "a.obj")


@pytest.mark.parametrize("extension", FORMATS)
def test_missing_files_and_directories(tmp_path, extension):
    with pytest.raises(VolumeError, match="no such file"):
        open_grids(tmp_path / f"a{extension}")
    (tmp_path / f"a{extension}").mkdir()
    with pytest.raises(VolumeError, match="is not a file"):
        open_grids(tmp_path / f"a{extension}")


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("content", [b"", b"\0" * 1000, b"\xff" * 1000, b"plain text\n" * 100])
def test_files_of_another_kind(tmp_path, extension, content):
    path = tmp_path / f"a{extension}"
    path.write_bytes(content)
    with pytest.raises(VolumeError, match=r"a\.") as caught:
        open_grids(path)
    assert "\n" not in str(caught.value)


def test_extensions_in_capitals(tmp_path):
    (tmp_path / "A.RAW").write_bytes(bytes(24))
    (tmp_path / "A.RAW.json").write_text(json.dumps({"shape": [2, 3, 4], "dtype": "uint8"}))
    assert choose_grid(tmp_path / "A.RAW").shape == (2, 3, 4)
