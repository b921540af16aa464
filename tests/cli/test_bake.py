"""``tfm bake``: what is written, what is refused."""

import json

import pytest

from tfm_cl.bake import KINDS
from tfm_cl.cli.bake import PICTURES, command


@pytest.fixture
def small(device_name):
    return ("--map-res", "16", "--light-steps", "24", *(("--device", device_name) if device_name else ()))


def test_a_bare_volume_is_baked_whole_into_a_new_or_an_old_folder(cli, cloud, folder, small):
    done = cli("bake", cloud.name, "-o", "maps", *small)
    assert done.code == 0, done.err
    first = {path.name for path in (folder / "maps").iterdir()}
    assert {f"maps/{name}" for name in first} == set(done.out.splitlines())
    assert json.loads((folder / "maps" / "maps.json").read_text())["maps"][0]["res"] == 16
    (folder / "maps" / "mine.txt").write_text("stays")
    assert cli("bake", cloud.name, "-o", "maps", "-q", "--what", "map", *small).out == ""
    assert {path.name for path in (folder / "maps").iterdir()} == first | {"mine.txt"}
    assert not list(folder.glob(".tfm*"))


REFUSED = {
    "an input that is the output": (("-o", "cloud.npy"), "is the input itself"),
    "a folder in none": (("-o", "no/maps"), "there is no directory no"),
    "a setting of pictures": (
        ("-o", "maps", "--set", "image.samples=4"),
        "image.samples: makes no",
    ),
    "a method": (("-o", "maps", "--set", "march.method='dual'"), "march.method: makes no difference"),
    "another kind": (("-o", "maps", "--what", "moon"), "'moon' is not"),
    "another format": (("-o", "maps", "--formats", "tiff"), "unknown format 'tiff'; known: exr, ktx2"),
    "another basis": (("-o", "maps", "--basis", "moments", "--coeffs", "5"), "is no series"),
    "an unknown option": (("-o", "maps", "--samples", "4"), "--samples"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_baked_is_refused(case, refused, cloud, small):
    arguments, why = REFUSED[case]
    assert why in refused("bake", cloud.name, *arguments, *small)


def test_every_option_of_a_kind_is_a_flag_of_its_name():
    flags = {flag for parameter in command.params for flag in parameter.opts}
    for kind in KINDS.values():
        assert {"--" + name.replace("_", "-") for name in kind.model_fields} <= flags
    assert not flags & set(PICTURES)
