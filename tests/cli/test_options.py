"""Every option, key and default, without rendering anything."""

import json
import subprocess
import sys
import tomllib

import click
import numpy as np
import pytest

import tfm_cl
from tfm_cl.cli import COMMANDS, tfm
from tfm_cl.cli.options import SCENE_OPTIONS, as_flags, toml_value
from tfm_cl.plan import octaves
from tfm_cl.scene.frame_numbers import KEYS as OF_FRAMES
from tfm_cl.scene.lights import SpotLight
from tfm_cl.scene.presets import PRESETS
from tfm_cl.scene.scene_file import SECTIONS

PROMISED = {
    *("--res", "--crop", "--exposure", "--view", "--transparent", "--png-bits", "--dither"),
    *("--aov", "--method"),
    *("--basis", "--coeffs", "--density-weighting", "--map-res", "--light-steps", "--storage"),
    *("--cutoff", "--voxels", "--map-bytes", "--max-error", "--target", "--fit", "--range", "--lookup"),
    *("--steps", "--sampling", "--grid", "--density-scale", "--sigma-s", "--sigma-a", "--octaves"),
    *("--phase", "--orders"),
    *("--camera-from", "--camera-to", "--up", "--fov", "--focal-length", "--background"),
    *("--samples", "--filter", "--shutter", "--motion-samples"),
    *("--light-type", "--light-from", "--light-to", "--cone", "--intensity", "--falloff"),
    *("-o", "--device", "--set", "--print-config", "--all", "--stats", "--json", "-q", "-v"),
}

FLAGS = [
    ("--res", "31x17", "camera.res", [31, 17]),
    ("--res", "31×17", "camera.res", [31, 17]),
    ("--crop", "1,2,3,4", "image.crop", [1, 2, 3, 4]),
    ("--exposure", "-1.5", "image.exposure", -1.5),
    ("--exposure", "auto", "image.exposure", "auto"),
    ("--view", "agx", "image.view", "agx"),
    ("--samples", "16", "image.samples", 16),
    ("--filter", "gaussian", "image.filter", "gaussian"),
    ("--background", "0.5,1,2", "image.background", [0.5, 1, 2]),
    ("--transparent", "", "image.transparent", True),
    ("--png-bits", "16", "image.png_bits", 16),
    ("--dither", "", "image.dither", True),
    ("--deep-tolerance", "0.05", "image.deep_tolerance", 0.05),
    ("--deep-colour", "", "image.deep_colour", True),
    ("--shutter", "-0.25,0.5", "image.shutter", [-0.25, 0.5]),
    ("--motion-samples", "5", "image.motion_samples", 5),
    ("--aov", "depth, samples", "image.aov", ["depth", "samples"]),
    ("--method", "dual", "march.method", "dual"),
    ("--basis", "dct", "map.basis", "dct"),
    ("--coeffs", "32", "map.coeffs", 32),
    ("--coeffs", "auto", "map.coeffs", "auto"),
    ("--map-bytes", "17", "map.bytes", 17),
    ("--max-error", "0.01", "map.max_error", 0.01),
    ("--target", "optical-depth", "map.target", "optical-depth"),
    ("--fit", "visibility", "map.fit", "visibility"),
    ("--range", "trimmed", "map.range", "trimmed"),
    ("--lookup", "reconstruct", "map.lookup", "reconstruct"),
    ("--density-weighting", "1", "map.density_weighting", 1),
    ("--density-weighting", "auto", "map.density_weighting", "auto"),
    ("--map-res", "33", "map.res", 33),
    ("--map-res", "auto", "map.res", 96),  # the box of 10 voxels, whose depth asks for narrower texels
    ("--light-steps", "7", "map.steps", 7),
    ("--light-steps", "auto", "map.steps", 21),
    ("--storage", "u8", "map.storage", "u8"),
    ("--steps", "9", "march.steps", 9),
    ("--steps", "auto", "march.steps", 63),
    ("--cutoff", "0.25", "march.cutoff", 0.25),
    ("--voxels", "f16", "march.voxels", "f16"),
    ("--sampling", "world", "march.sampling", "world"),
    ("--grid", "smoke", "volume.grid", "smoke"),
    ("--density-scale", "2.5", "volume.density_scale", 2.5),
    ("--sigma-s", "1,0.5,0", "medium.sigma_s", [1, 0.5, 0]),
    ("--sigma-a", "0.5", "medium.sigma_a", [0.5, 0.5, 0.5]),
    ("--preset", "dust", "medium.preset", "dust"),
    ("--octaves", "4", "medium.octaves", 4),
    ("--phase", "hg:-0.3", "medium.phase", {"type": "hg", "g": -0.3}),
    ("--phase", "mie", "medium.phase", {"type": "mie", "diameter": 20}),
    ("--orders", "8", "medium.orders", 8),
    ("--camera-from", "-1,2,3e1", "camera.from", [-1, 2, 30]),
    ("--camera-to", "0,0,-9", "camera.to", [0, 0, -9]),
    ("--up", "0,0,1", "camera.up", [0, 0, 1]),
    ("--fov", "12.5", "camera.fov", 12.5),
    ("--focal-length", "35", "camera.focal_length", 35),
    ("--light-type", "spot", "light.type", "spot"),
    ("--light-from", "-1,-2,-3", "light.from", [-1, -2, -3]),
    ("--light-to", "7,8,9", "light.to", [7, 8, 9]),
    ("--cone", "33", "light.cone", 33),
    ("--intensity", "1,2,3", "light.intensity", [1, 2, 3]),
    ("--falloff", "inverse-square", "light.falloff", "inverse-square"),
]

MOVED = [1, 0, 0, 2, 0, 1, 0, 3, 0, 0, 1, 4, 0, 0, 0, 1]
KEYS = [
    *(
        (key, text, expected)
        for _, text, key, expected in FLAGS
        if text and key not in {"camera.res", "image.aov", "image.crop"}
    ),
    ("volume.file", "smoke.npz", None),
    ("volume.voxel_size", "0.5", [0.5, 0.5, 0.5]),
    ("volume.origin", "-1,2,3", [-1, 2, 3]),
    ("volume.transform", str(MOVED), [MOVED[row : row + 4] for row in (0, 4, 8, 12)]),
    ("volume.translate", "1,2,3", [1, 2, 3]),
    ("volume.rotate", "0,0,90", [0, 0, 90]),
    ("volume.scale", "2", [2, 2, 2]),
    ("volume.sanitize", "true", True),
    ("volume.offset", "-0.5", -0.5),
    ("volume.window", "[0.25, 3]", [0.25, 3.0]),
    ("volume.colour", "false", False),
    ("volume.velocity", "['vx', 'vy', 'vz']", ["vx", "vy", "vz"]),
    ("volume.velocity_scale", "2.5", 2.5),
    ("volume.velocity_fps", "25", 25),
    ("volume.velocity_outlier_threshold", "0.5", 0.5),
    (
        "volume.medium",
        "{preset = 'dust', sigma_a = 0, sigma_s = 2, phase = 'hg:0.5'}",
        tfm_cl.Medium(sigma_s=2, phase="hg:0.5", temperature="smoke").to_dict() | {"preset": "dust"},
    ),
    ("medium.sigma_s", "[1, 2, 3]", [1, 2, 3]),
    ("medium.attenuation", "0.25", 0.25),
    ("medium.contribution", "0.25", 0.25),
    ("medium.eccentricity", "0.25", 0.25),
    ("camera.res", "[5, 6]", [5, 6]),
    ("camera.from", "-1, 2, 3", [-1, 2, 3]),
    ("camera.to", "[1, 2, -3.5]", [1, 2, -3.5]),
    ("camera.up", "1,0,0", [1, 0, 0]),
    ("camera.matrix", str(MOVED), [MOVED[row : row + 4] for row in (0, 4, 8, 12)]),
    ("camera.sensor_width", "24", 24),
    ("camera.haze", "30", 30),
    ("march.max_stretch", "8", 8),
    ("march.skip_empty", "false", False),
    ("march.attenuation", "paper", "paper"),
    ("shadow.res", "77", 77),
    ("shadow.filter", "nearest", "nearest"),
    ("ambient.radiance", "0.5", [0.5, 0.5, 0.5]),
    ("image.crop", "1,2,3,4", [1, 2, 3, 4]),
    ("image.aov", "['depth']", ["depth"]),
    ("image.deep_colour", "true", True),
    ("image.transparent", "true", True),
    ("image.dither", "false", False),
    ("image.pixel_type", "half", "half"),
    ("image.compression", "htj2k", "htj2k"),
    ("light.from", "9,9,9", [9, 9, 9]),
    ("light.to", "9,9,9", [9, 9, 9]),
    ("light.intensity", "4", [4, 4, 4]),
    ("map.slicing", "gamma", "gamma"),
    ("map.blur_kernel", "box", "box"),
    ("map.blur", "0", 0),
    ("map.deposits", "steps", "steps"),
    ("map.functions", "", ""),
    ("light.blend", "0.5", 0.5),
    ("light.radius", "0.5", 0.5),
    ("light.samples", "9", 9),
    ("light.reach", "7", 7),
    ("light.texture", "/nowhere/slide.png", "/nowhere/slide.png"),
    ("light.name", "key", "key"),
    ("medium.temperature", "density", "density"),
    ("medium.temperature_offset", "0.5", 0.5),
    ("medium.temperature_scale", "0.25", 0.25),
    ("medium.Le_scale", "3", 3),
    ("medium.emission_lights", "64", 64),
    ("medium.emission", "[1, 0.5, 0.2]", [1, 0.5, 0.2]),
    ("medium.phase", '{type = "hg", g = 0.2}', {"type": "hg", "g": 0.2}),
    ("medium.orders", "3", 3),
    ("camera.res", "[5, 6]", [5, 6]),
]

SCENE = """
[volume]
file = "smoke.npz"
density_scale = 1.5
grid = "density"
[medium]
temperature = "smoke"
[camera]
from = [1, 2, 30]
to = [3, 3, 3]
fov = 77
res = [64, 48]
[[light]]
from = [20, 20, 20]
to = [3, 3, 3]
cone = 44
[[light]]
from = [-20, 20, 20]
to = [3, 3, 3]
intensity = 0.25
[map]
coeffs = 5
density_weighting = 7
res = 99
steps = 98
[march]
steps = 97
[image]
exposure = 3
"""


@pytest.fixture
def scene(folder):
    ones = np.ones((5, 5, 5), np.float32)
    np.savez(folder / "smoke.npz", density=ones, smoke=ones)
    (folder / "scene.toml").write_text(SCENE)
    return folder / "scene.toml"


@pytest.fixture
def resolved(cli, scene):
    """``resolved(…)`` is the configuration printed for ``scene.toml`` and some options."""

    def run(*arguments):
        done = cli("render", scene, "--print-config", "--all", *arguments)
        assert done.code == 0, done.err
        # What "auto" chose is told.
        assert done.err == "" or ("auto" in " ".join(arguments) and done.err.startswith("chosen for "))
        return tomllib.loads(done.out)

    return run


def value_of(config, key):
    section, _, name = key.partition(".")
    table = config[section]
    if section == "light":
        index, dot, after = name.partition(".")
        table, name = (table[int(index)], after) if dot else (table[0], name)
    return table[name]


def scene_options(command):
    return [option for option in command.params if isinstance(option, click.Option)]


def test_every_promised_flag_exists():
    render = tfm.get_command(None, "render")
    flags = {name for option in scene_options(render) for name in option.opts}
    assert flags >= PROMISED


def test_the_tables_of_this_file_miss_nothing():
    assert {flag for flag, *_ in FLAGS} == {option.flag for option in SCENE_OPTIONS}
    keys = {f"{name}.{key}" for name, model in SECTIONS.items() for key in model.keys()}  # noqa: SIM118 - no dict
    keys |= {f"light.{key}" for key in SpotLight.keys()}  # noqa: SIM118 - no dict
    keys -= {
        f"{section}.{key}" for section in ("volume", "light") for key in OF_FRAMES
    }  # refused of one file
    assert {key for key, *_ in KEYS} == keys


def test_the_scene_stands_without_flags(resolved):
    config = resolved()
    assert config["camera"]["fov"] == 77
    assert config["map"]["coeffs"] == 5
    assert [light["cone"] for light in config["light"]] == [44, 25]


@pytest.mark.parametrize(("flag", "text", "key", "expected"), FLAGS)
def test_a_flag_wins_over_the_scene(resolved, flag, text, key, expected):
    before, after = resolved(), resolved(*filter(None, [flag, text]))
    assert value_of(after, key) == expected
    # Nothing else changes.
    section, _, name = key.partition(".")
    for config in (before, after):
        table = config[section]
        (table[0] if section == "light" else table).pop(name, None)
        if key in {"map.bytes", "map.max_error"}:  # which say what coeffs said
            table.pop("coeffs", None)
        for said in PRESETS["dust"].medium if key == "medium.preset" else ():
            table.pop(said)
        for said in octaves.KEYS if key == "medium.octaves" else ():  # which are decided for them
            table.pop(said)
        if key == "camera.focal_length":  # which says what fov said, of a sensor of some width
            table.pop("fov", None)
            assert table.pop("sensor_width", 36) == 36
    assert after == before


@pytest.mark.parametrize(("key", "text", "expected"), KEYS)
def test_set_reaches_every_key(resolved, folder, key, text, expected):
    needed = ["--focal-length", "35"] if key == "camera.sensor_width" else []
    config = resolved(*needed, "--set", f"{key}={text}")
    if key == "volume.file":
        expected = str(folder / text)
    assert value_of(config, key) == expected


def test_up_is_told_by_an_axis_and_followed_by_the_look(cli, cloud):
    z, numbers = (cli("render", cloud, "--print-config", "--up", up) for up in ("z", "0,0,1"))
    assert (z.code, z.out) == (0, numbers.out)
    config = tomllib.loads(z.out)
    assert config["camera"]["up"] == config["light"][0]["up"] == [0, 0, 1]
    assert cli("render", cloud, "--print-config", "--up", "-z").code == 0
    wrong = cli("render", cloud, "--print-config", "--up", "w")
    assert wrong.code == 2
    assert wrong.err.startswith("tfm: --up: 'w' should be three numbers [x, y, z], or an axis: y, z, x")


def test_what_is_on_or_off_has_a_flag_for_each(resolved):
    off = resolved("--no-dither", "--set", "image.transparent=true", "--no-transparent")["image"]
    assert (off["dither"], off["transparent"]) == (False, True)  # --set wins over flags
    assert as_flags({"image.dither": False, "image.transparent": True}) == "--no-dither --transparent"


def test_a_sky_behind_the_picture_is_printed_for_the_next_run(cli, scene, folder):
    sky = ("--light-type", "sky", "--set", "light.elevation=5", "--background", "environment")
    done = cli("render", scene.parent / "smoke.npz", "--print-config", *sky)
    config = tomllib.loads(done.out)
    assert config["image"]["background"] == "environment"
    assert (config["light"][0]["type"], config["light"][0]["elevation"]) == ("sky", 5)
    (folder / "again.toml").write_text(done.out)
    assert cli("render", "again.toml", "--print-config").out == done.out


def test_set_reaches_every_light(resolved):
    config = resolved("--set", "light.0.cone=30", "--set", "light.1.cone=31", "--set", "light.1.blend=1")
    assert [light["cone"] for light in config["light"]] == [30, 31]
    assert [light["blend"] for light in config["light"]] == [0, 1]


def test_set_wins_over_flags_and_the_last_over_the_first(resolved):
    assert resolved("--set", "camera.fov=20", "--fov", "30")["camera"]["fov"] == 20
    assert resolved("--set", "camera.fov=20", "--set", "camera.fov=21")["camera"]["fov"] == 21
    assert resolved("--fov", "20", "--fov", "21")["camera"]["fov"] == 21


def test_a_camera_of_another_program_wins_over_the_scene_and_is_printed_for_the_next_run(
    cli, resolved, scene, folder
):
    matrix = f"camera.matrix={MOVED}"
    config = resolved("--set", matrix, "--focal-length", "35")
    assert set(config["camera"]) == {"matrix", "focal_length", "sensor_width", "res"}
    done = cli("render", scene, "--print-config", "--set", matrix, "--focal-length", "35")
    (folder / "again.toml").write_text(done.out)
    assert cli("render", "again.toml", "--print-config").out == done.out
    # And the other way round.
    back = cli("render", "again.toml", "--print-config", "--all", "--fov", "30", "--camera-from", "9,9,9")
    assert set(tomllib.loads(back.out)["camera"]) == {"from", "to", "up", "fov", "res"}


def test_a_placed_camera_may_have_a_lens(cli, scene):
    done = cli("render", scene.parent / "smoke.npz", "--print-config", "--focal-length", "35")
    assert "--camera-from" in done.err
    assert tomllib.loads(done.out)["camera"]["focal_length"] == 35


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1", 1),
        ("-1.5e3", -1500.0),
        ("true", True),
        ("auto", "auto"),
        ("a b", "a b"),
        ('"1"', "1"),
        ("1,2", [1, 2]),
        ("[1,2]", [1, 2]),
        ("", ""),
        ("a,b", "a,b"),
        ("1\nx = 2", "1\nx = 2"),
    ],
)
def test_values_of_set(text, value):
    read = toml_value(text)
    assert read == value
    assert type(read) is type(value)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_has_help(name):
    command = tfm.get_command(None, name)
    assert command.help
    for option in scene_options(command):
        assert option.help, option.opts
        assert "None" not in option.help, option.opts


@pytest.mark.parametrize("option", SCENE_OPTIONS, ids=lambda option: option.flag)
def test_help_states_the_models_default(option):
    section, _, key = option.key.partition(".")
    model = SpotLight if section == "light" else SECTIONS[section]
    field = model.model_fields[model.keys()[key]]
    stated = option.help().rpartition("[")[2].removesuffix("]").split(";")[0]
    assert option.help().endswith("]")
    assert stated
    default = None if field.is_required() else field.default
    if default in (None, ()):
        return
    if option.flag == "--phase":
        assert stated == default
    elif option.flag == "--res":
        assert stated == "{}x{}".format(*default)
    elif isinstance(default, bool):
        assert stated == str(default).lower()
    elif isinstance(default, tuple):
        numbers = [float(part) for part in stated.split(",")]
        assert tuple(numbers * (3 if len(numbers) == 1 else 1)) == default
    else:
        assert type(default)(stated) == default


@pytest.mark.parametrize("name", ["", *COMMANDS])
@pytest.mark.parametrize("flag", ["-h", "--help"])
def test_help_is_printed(cli, name, flag):
    done = cli(*name.split(), flag)
    assert done.code == 0
    assert done.err == ""
    assert done.out.startswith(f"Usage: tfm {name}".rstrip())
    assert "\\b" not in done.out
    assert "None" not in done.out


def test_the_help_lists_the_commands(cli):
    out = cli("--help").out
    assert all(f"\n  {name} " in out for name in ("render", "info", "compare", "sweep", "devices"))


def test_help_of_render_comes_in_groups(cli):
    out = cli("render", "--help").out
    groups = ["Output", "Image", "Method", "Map", "March", "Medium", "Camera", "Light", "Run"]
    places = [out.index(f"\n{group}:") for group in groups]
    assert places == sorted(places)
    assert "tfm render cloud.vdb -o cloud.png\n" in out


def test_version(cli):
    done = cli("--version")
    assert (done.code, done.out, done.err) == (0, f"tfm {tfm_cl.__version__}\n", "")


def test_no_command_prints_the_help(cli):
    done = cli()
    assert done.code == 2
    assert done.out == ""
    assert done.err.startswith("Usage: tfm")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rendr"], "'rendr'"),
        (["render"], "Missing argument 'INPUT'"),
        (["render", "a.npy", "--stepz", "3"], "'--steps'"),
        (["render", "a.npy", "b.npy", "-o", "c.png"], "unexpected extra argument"),
        (["render", "a.npy"], "no picture asked for"),
        (["info"], "Missing argument 'FILE'"),
        (["compare", "a.npy"], "Missing argument 'REFERENCE'"),
        (["devices", "x"], "unexpected extra argument"),
        (["--colour"], "--colour"),
    ],
)
def test_wrong_use_is_one_line_that_points_to_the_help(refused, arguments, message):
    line = refused(*arguments)
    assert message in line
    assert "--help" in line


def test_a_configuration_needs_no_opencl(scene):
    code = f"""if True:
        import sys
        from tfm_cl.cli import main
        for arguments in (["render", {str(scene)!r}, "--print-config"], ["render", "--help"], ["--version"]):
            assert main(arguments) == 0
        assert "pyopencl" not in sys.modules
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.slow
def test_print_config_writes_what_json_writes(cli, scene, tiny):
    done = cli("render", scene, "-o", "a.npy", "--print-config", "--all", "--json", "b.json", *tiny)
    options = json.loads((scene.parent / "b.json").read_text())["options"]

    def kept(table):
        return {key: value for key, value in table.items() if value is not None}

    without_null = {
        name: [kept(each) for each in table] if isinstance(table, list) else kept(table)
        for name, table in options.items()
    }
    printed = tomllib.loads(done.out)
    asked, used = printed.pop("map"), without_null.pop("map")
    assert printed == without_null
    # What was left to the renderer is printed as that, and written as what came of it.
    assert {key: value for key, value in asked.items() if value != "auto"}.items() <= used.items()
    assert (used["basis"], used["range"]) == ("klt", "visible")
