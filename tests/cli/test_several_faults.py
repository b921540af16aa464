"""All that is wrong with a scene is told in one run: a line each."""

import pytest

from tfm_cl.errors import MOST_TOLD, SceneError
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
        assert all(line.startswith("tfm: scene.toml:") for line in found)
        return [line.removeprefix("tfm: scene.toml:") for line in found]

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
            "4: unknown key 'fob' in [camera]; did you mean 'fov'? known: ",
            "6: unknown key 'coefs' in [map]; did you mean 'coeffs'? known: ",
            "8: march.steps = 'many': should be a whole number from 1 to 100000, or 'auto'",
        ],
    ), found


def test_three_typos_in_one_section(lines):
    found = lines(VOLUME + "[map]\ncoeffs = 0\nstpes = 3\nres = 9999\n")
    assert starts(
        found,
        [
            "4: map.coeffs = 0: ",
            "5: unknown key 'stpes' in [map]; did you mean 'steps'? known: ",
            "6: map.res = 9999: ",
        ],
    ), found


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
            "4: medium.phase.g = 3: should be less than 1",
            "9: light 1: unknown key 'form' in [light]; did you mean 'from'?",
            "13: solid 0: solid.radius = 'large': should be a valid number",
        ],
    ), found


def test_what_is_in_a_misspelt_section_is_looked_at(lines):
    found = lines('[volum]\nfile = "cloud.npy"\n[camrea]\nfov = 0\n')
    assert starts(
        found,
        [
            "1: unknown key 'volum'; did you mean 'volume'?",
            "3: unknown key 'camrea'; did you mean 'camera'?",
            "4: camera.fov = 0: should be greater than 0",
        ],
    ), found


def test_sections_of_a_wrong_form(lines):
    found = lines("camera = 3\n" + VOLUME + "[light]\ncone = 3\n[[map]]\n")
    assert found == [
        "1: camera should be a table [camera]",
        "4: light should be [[light]] tables",
        "6: map should be a table [map]",
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


def test_what_is_missing_or_of_a_body_s_medium_is_where_the_table_is(lines):
    found = lines(
        '[[volume]]\nfile = "cloud.npy"\nmedium = { sigma_s = -1 }\n'
        "[[light]]\nfrom = [1, 2, 3]\nto = [0, 0, 0]\n"
        '[[light]]\ntype = "point"\n[[solid]]\nshape = "sphere"\ncenter = 3\n'
    )
    assert starts(
        found,
        [
            "3: volume 0: volume.medium.sigma_s = -1: ",
            "7: light 1: light.from is missing",
            "11: solid 0: solid.centre = 3: ",
        ],
    ), found


def test_what_the_scene_refuses_as_a_whole_has_its_line_too(lines):
    found = lines(VOLUME + "[camera]\nres = [8, 8]\n[image]\ncrop = [0, 0, 9, 9]\n")
    assert found == ["6: image.crop = [0, 0, 9, 9]: does not lie in the image of 8×8 pixels"]


def test_what_the_command_line_says_has_no_line(lines):
    found = lines(VOLUME + "[camera]\nfov = 30\nres = 3\n", "--fov", "300", "--cone", "100")
    assert starts(
        found, ["5: camera.res = 3: ", " camera.fov = 300.0: should be", " light.cone = 100.0: should be"]
    ), found


def test_what_is_no_toml_has_its_line(lines):
    assert lines(VOLUME + "[camera\n") == [
        "3: not TOML: Expected ']' at the end of a table declaration (column 8)"
    ]


WORDS = """
[volume]
file = "cloud.npy"
density = 3
[medium]
albedo = 0.9
extinction = 2
absorption = 1
anisotropy = 0.3
phase = "henyey-greenstein:0.3"
[camera]
position = [1, 2, 3]
lookAt = [0, 0, 0]
resolution = [1, 2]
fstop = 2
[[light]]
type = "directional"
[[light]]
from = [1, 2, 3]
target = [0, 0, 0]
color = [1, 0, 0]
power = 10
angle = 30
[[light]]
type = "point"
from = [1, 2, 3]
target = [0, 0, 0]
[[solid]]
shape = "cube"
[[solid]]
file = "a.ply"
colour = 3
[lights]
"""
SAID = [
    "4: unknown key 'density' in [volume]; write 'density_scale'",
    "6: unknown key 'albedo' in [medium]; here sigma_s and sigma_a: albedo 0.9 at extinction 1 is sigma_s = ",
    "7: unknown key 'extinction' in [medium]; here sigma_s + sigma_a: extinction 2 at albedo 0.9 is ",
    "8: unknown key 'absorption' in [medium]; write 'sigma_a'",
    "9: unknown key 'anisotropy' in [medium]; write phase = { type = 'hg', g = 0.3 }",
    "10: medium.phase = 'henyey-greenstein:0.3': unknown phase function 'henyey-greenstein'; write 'hg'",
    "12: unknown key 'position' in [camera]; write 'from'",
    "13: unknown key 'lookAt' in [camera]; write 'to'",
    "14: unknown key 'resolution' in [camera]; write 'res'",
    "15: unknown key 'fstop' in [camera]; leave it out: the camera is a pinhole, and all is in focus",
    "17: light 0: light.type: unknown light 'directional'; write 'sun'",
    "20: light 1: unknown key 'target' in [light]; write 'to'",
    "21: light 1: unknown key 'color' in [light]; multiply intensity = [r, g, b] by it",
    "22: light 1: unknown key 'power' in [light]; write 'intensity'",
    "23: light 1: unknown key 'angle' in [light]; write cone: the half angle, degrees",
    "27: light 2: unknown key 'target' in [light]; known: ",  # it shines everywhere
    "29: solid 0: solid.shape: unknown shape 'cube'; write 'box'",
    "31: solid 1: unknown key 'file' in [solid]; write 'mesh'",
    "32: solid 1: unknown key 'colour' in [solid]; write 'albedo'",
    "33: unknown key 'lights'; write 'light'",
]


def test_other_programs_words_are_known(lines):
    found = lines(WORDS)
    assert starts(found, SAID), found


FILES = """
[[volume]]
file = "cloud.npy"
[[volume]]
shape = "box"
[[light]]
from = [1, 2, 3]
to = [0, 0, 0]
texture = "slide.png"
[[solid]]
mesh = "cup.glb"
albedo = "wood.png"
[[solid]]
shape = "plane"
albedo = "sand.png"
"""


def test_files_that_are_not_there_have_their_line(lines, folder):
    found = lines(FILES, "-q")
    assert found == [
        f"9: light.texture: {folder}/slide.png: no such file",
        f"11: solid.mesh: {folder}/cup.glb: no such file",
        f"12: solid.albedo: {folder}/wood.png: no such file",
        f"15: solid.albedo: {folder}/sand.png: no such file",
    ]
    assert lines('[volume]\nfile = "smoke.vdb"\n') == ["2: volume.file: smoke.vdb: no such file"]
    assert lines('[[volume]]\nfile = "cloud.npy"\n[[volume]]\npoints = "dots.ply"\n') == [
        "4: volume.points: dots.ply: no such file"
    ]
    assert lines(VOLUME, "--set", "volume.file=b.npy") == [" volume.file: b.npy: no such file"]


def test_very_many_faults_are_not_all_told(cli, cloud):
    keys = "".join(f"fob{i} = 30\n" for i in range(MOST_TOLD + 1980))
    cloud.with_name("scene.toml").write_text(VOLUME + "[camera]\n" + keys)
    told = cli("render", "scene.toml", "-o", "a.png").err.splitlines()
    assert len(told) == MOST_TOLD + 1
    assert told[-1] == "tfm: and 1,980 more"
    with pytest.raises(SceneError) as raised:
        Scene.load(cloud.with_name("scene.toml"))
    assert len(raised.value.args) == MOST_TOLD + 1980
    assert str(raised.value).splitlines()[-1] == "and 1,980 more"


SPOT = VOLUME + "[[light]]\nfrom = [1, 2, 3]\nto = [0, 0, 0]\ncone = 20\nblend = 0.1\n"


@pytest.mark.parametrize("change", [("--light-type", "sun"), ("--set", "light.0.type=sun")])
def test_a_light_that_becomes_another_loses_what_that_lacks(cli, cloud, change):
    cloud.with_name("scene.toml").write_text(SPOT)
    done = cli("render", "scene.toml", "--print-config", *change)
    assert done.code == 0, done.err
    assert 'type = "sun"' in done.out
    assert "cone" not in done.out
    # What the command line itself says is not dropped.
    done = cli("render", "scene.toml", "--print-config", *change, "--cone", "30")
    assert "unknown key 'cone' in [light]: 'sun' has none, only spot\n" in done.err


def test_albedo_of_a_volume_is_a_matter_of_its_medium(lines):
    (found,) = lines(VOLUME + "albedo = 0.9\n")
    assert found.startswith(
        "3: unknown key 'albedo' in [volume]; write sigma_s and sigma_a in [medium], or in "
    )
