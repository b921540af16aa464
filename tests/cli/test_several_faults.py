"""All that is wrong with a scene is told in one run: a line each."""

import pytest

from tfm_cl.errors import SceneError
from tfm_cl.scene.scene import Scene


@pytest.fixture
def lines(cli, cloud):
    """``lines(TOML text, arguments…)`` are those of a ``tfm render`` that is refused, without the prefix."""

    def run(text, *arguments):
        cloud.with_name("scene.toml").write_text(text)
        done = cli("render", "scene.toml", "-o", "a.png", *arguments)
        assert (done.code, done.out) == (2, "")
        assert not cloud.with_name("a.png").exists()
        found = done.err.splitlines()
        assert all(line.startswith("tfm: scene.toml: ") for line in found)
        return [line.removeprefix("tfm: scene.toml: ") for line in found]

    return run


VOLUME = '[volume]\nfile = "cloud.npy"\n'


def starts(found, expected):
    """Tell whether every line starts with what is expected there."""
    return len(found) == len(expected) and all(map(str.startswith, found, expected))


def test_three_typos_in_three_sections(lines):
    found = lines(VOLUME + '[camera]\nfob = 30\n[map]\ncoefs = 8\n[march]\nsteps = "many"\n')
    assert starts(
        found,
        [
            "unknown key 'fob' in [camera]; did you mean 'fov'? known: ",
            "unknown key 'coefs' in [map]; did you mean 'coeffs'? known: ",
            "march.steps = 'many': should be a whole number from 1 to 100000, or 'auto'",
        ],
    ), found


def test_three_typos_in_one_section(lines):
    found = lines(VOLUME + "[map]\ncoeffs = 0\nstpes = 3\nres = 9999\n")
    assert len(found) == 3
    assert {line.split(":")[0] for line in found} == {
        "map.coeffs = 0",
        "map.res = 9999",
        "unknown key 'stpes' in [map]; did you mean 'steps'? known",
    }


def test_three_typos_in_arrays_and_in_a_section_within(lines):
    found = lines(
        VOLUME + '[medium]\nphase = { type = "hg", g = 3 }\n'
        "[[light]]\nfrom = [1, 2, 3]\nto = [0, 0, 0]\n"
        "[[light]]\nform = [1, 2, 3]\nto = [0, 0, 0]\n"
        '[[solid]]\nshape = "sphere"\nradius = "large"\n'
    )
    assert starts(
        found,
        [
            "medium.phase.g = 3: should be less than 1",
            "light 1: unknown key 'form' in [light]; did you mean 'from'?",
            "solid 0: solid.radius = 'large': should be a valid number",
        ],
    ), found


def test_what_is_in_a_misspelt_section_is_looked_at(lines):
    found = lines('[volum]\nfile = "cloud.npy"\n[camrea]\nfov = 0\n')
    assert starts(
        found,
        [
            "unknown key 'volum'; did you mean 'volume'?",
            "unknown key 'camrea'; did you mean 'camera'?",
            "camera.fov = 0: should be greater than 0",
        ],
    ), found


def test_sections_of_a_wrong_form(lines):
    found = lines("camera = 3\n" + VOLUME + "[light]\ncone = 3\n[[map]]\n")
    assert found == [
        "camera should be a table [camera]",
        "light should be [[light]] tables",
        "map should be a table [map]",
    ]


def test_three_typos_on_the_command_line(cli, cloud):
    changes = ("--set", "map.bytes_=3", "--set", "camera.fov=wide", "--set", "light.frm=1,2,3")
    done = cli("render", cloud, "-o", "a.png", *changes, "--cone", "100")
    assert done.code == 2
    assert starts(
        [line.removeprefix(f"tfm: {cloud}: ") for line in done.err.splitlines()],
        [
            "unknown key 'bytes_' in [map]; did you mean 'bytes'?",
            "camera.fov = 'wide': should be a valid number",
            "light.cone = 100.0: should be less than 90",
            "unknown key 'frm' in [light]; did you mean 'from'?",
        ],
    ), done.err


def test_three_flags_that_are_not_of_their_form(cli, cloud):
    done = cli("render", cloud, "-o", "a.png", "--res", "16", "--set", "fov=3", "--camera-to", "x")
    assert done.code == 2
    assert starts(
        done.err.splitlines(),
        [
            "tfm: --res: '16' is not WIDTHxHEIGHT",
            "tfm: --camera-to: 'x' is not a number",
            "tfm: --set fov=3: should be SECTION.KEY=VALUE",
        ],
    ), done.err


def test_a_place_that_is_left_out_is_not_complained_about(cli, cloud):
    """What is checked before the volume is read stands on places that will be others."""
    for change in ("camera.from=0,0,0", "camera.to=1,2,3", "light.from=0,0,0", "light.to=1,2,3"):
        assert cli("render", cloud, "--print-config", "--set", change).code == 0, change


def test_the_library_raises_them_together(cloud):
    path = cloud.with_name("scene.toml")
    path.write_text(VOLUME + "[camera]\nfob = 30\n[map]\ncoeffs = 0\n")
    with pytest.raises(SceneError) as raised:
        Scene.load(path)
    assert len(raised.value.args) == 2
    assert str(raised.value).splitlines() == list(raised.value.args)
