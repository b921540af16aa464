"""Whatever is wrong: exit code 2 or 3, one line on stderr that says what and where, and nothing written."""

import io
import json
import os
import pickle
import re
import resource
import shutil
import struct
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from scenes import blobs

import tfm_cl.device.device

VDB = Path(__file__).resolve().parents[1] / "files" / "volume_io" / "data" / "negative.vdb"
HUGE = 1 << 40

SCENE = """[volume]
file = "cloud.npy"
[camera]
from = [0, 0, 40]
to = [8, 6, 7]
[[light]]
from = [20, 20, 20]
to = [8, 6, 7]
"""


@pytest.fixture
def bad(refused, tiny):
    """``bad(INPUT, …)`` must be refused by ``tfm render``; returns the line."""

    def run(source, *arguments, code=2, out="a.png"):
        return refused("render", source, "-o", out, *tiny, *arguments, code=code)

    return run


@pytest.fixture
def scene(cloud):
    """Write ``scene.toml`` with some text replaced."""

    def write(old="", new=""):
        assert old in SCENE
        path = cloud.with_name("scene.toml")
        path.write_text(SCENE.replace(old, new) if old else SCENE + new)
        return path

    return write


# --------------------------------------------------------------------------- options


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--res 0x0", "camera.res = [0, 0]: should be at least 1×1"),
        ("--res 16", "--res: '16' is not WIDTHxHEIGHT, as 1280x720"),
        ("--res 16x-9", "--res: '16x-9' is not WIDTHxHEIGHT"),
        ("--res 99999x99999", "at most 268,435,456 pixels"),
        ("--res 99999999999999999999x1", "at most 268,435,456 pixels"),
        ("--crop 0,0,17,9", "image.crop = [0, 0, 17, 9]: does not lie in the image of 16×9 pixels"),
        ("--crop 5,5,1,1", "image.crop = [5, 5, 1, 1]: should be x0,y0,x1,y1 with 0 ≤ x0 < x1"),
        ("--crop=-1,0,4,4", "image.crop = [-1, 0, 4, 4]: "),
        ("--crop 1,2", "image.crop = [1, 2]: should be four whole numbers"),
        ("--crop 0,0,1.5,2", "--crop: '0,0,1.5,2' is not whole numbers"),
        ("--exposure 101", "image.exposure = 101.0: should be a number from -100 to 100, or 'auto'"),
        ("--exposure nan", "image.exposure = nan"),
        ("--exposure bright", "--exposure: 'bright' is not a number"),
        ("--exposure 1,2", "image.exposure = [1.0, 2.0]: should be a number"),
        ("--view filmc", "'filmc' is not one of 'standard', 'filmic'"),
        ("--set image.view=filmc", "unknown view 'filmc'; did you mean 'filmic'?"),
        ("--png-bits 12", "image.png_bits = 12: should be 8 or 16"),
        ("--set image.dither=1", "image.dither = 1: should be a valid boolean"),
        ("--aov depht", "unknown aov 'depht'; did you mean 'depth'?"),
        ("--method fast", "'fast' is not one of 'tfm', 'dual'"),
        ("--basis chebyshev", "'--basis': 'chebyshev'"),
        ("--coeffs 0", "map.coeffs = 0: should be a whole number from 1 to 512, or 'auto'"),
        ("--coeffs 33", "coeffs = 33: basis 'klt' has 1 to 32 coefficients"),
        ("--coeffs 2.5", "--coeffs: '2.5' is not a whole number"),
        ("--density-weighting 0.5", "map.density_weighting = 0.5: should be a number from 1"),
        ("--density-weighting nan", "map.density_weighting = nan: should be"),
        ("--density-weighting inf", "map.density_weighting = inf: should be"),
        ("--density-weighting much", "--density-weighting: 'much' is not a number"),
        ("--map-res 0", "map.res = 0"),
        ("--map-res 8193", "map.res = 8193"),
        ("--light-steps 0", "map.steps = 0"),
        ("--steps -1", "march.steps = -1"),
        ("--steps 100001", "march.steps = 100001"),
        ("--grid smoke", "no grid named 'smoke'; it has 'density'"),
        ("--density-scale -1", "volume.density_scale = -1.0: should be a number from 0"),
        ("--density-scale 1e300", "volume.density_scale = 1e+300: should be a number from 0"),
        ("--sigma-s 1,2", "medium.sigma_s = [1.0, 2.0]: should be one number (grey) or three"),
        ("--sigma-a=-1", "medium.sigma_a = -1.0: should be ≥ 0"),
        ("--sigma-a nan", "medium.sigma_a = nan: "),
        ("--sigma-s 1e300", "medium.sigma_s = 1e+300: "),
        ("--phase snow", "unknown phase function 'snow'"),
        ("--phase hg:1", "g = 1.0: should be less than 1"),
        ("--phase hg:much", "mean cosine"),
        ("--phase table:none.txt", "none.txt: no such file"),
        ("--camera-from 1,2", "camera.from = [1.0, 2.0]: should be three numbers"),
        ("--camera-from 1,2,x", "--camera-from: '1,2,x' is not a number"),
        ("--camera-from 1,2,inf", "camera.from = [1.0, 2.0, inf]: should be three finite numbers"),
        ("--camera-from 1,2,1e300", "camera.from = [1.0, 2.0, 1e+300]: should be three finite"),
        ("--camera-from 1,2,3 --camera-to 1,2,3", "camera: from and to are the same point [1.0, 2.0, 3.0]"),
        ("--camera-from 1,2,3 --camera-to 1,9,3", "up [0.0, 1.0, 0.0] is zero or along the view direction"),
        ("--up 0,0,0", "up [0.0, 0.0, 0.0] is zero or along the view direction"),
        ("--fov 0", "camera.fov = 0.0"),
        ("--fov 180", "camera.fov = 180.0: should be less than 180"),
        (
            "--fov 30 --focal-length 35",
            "camera.fov and camera.focal_length both say how wide the view is; keep",
        ),
        ("--set camera.sensor_width=36", "camera.sensor_width"),
        (
            "--up 0,0,1 --set camera.matrix=[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]",
            "camera.up and camera.matrix both",
        ),
        ("--samples 3", "image.samples = 3: should be 1, 4, 16, 64 or 256"),
        ("--filter triangle", "'triangle' is not one of"),
        ("--background=-1", "image.background = -1.0: should be ≥ 0"),
        ("--background blue", "--background: 'blue' is not a number"),
        ("--background environment", "image.background = 'environment': no light of the scene has the type"),
        ("--set image.background=blue", "three [r, g, b], at most 1e+25, or 'environment'"),
        (
            "--light-type sky --set light.elevation=-1",
            "light.elevation = -1: should be greater than or equal",
        ),
        ("--light-type sky --set light.turbidity=11", "light.turbidity = 11: should be less than or equal"),
        (
            "--light-type sky --set light.ground_albedo=2",
            "ground_albedo = [2.0, 2.0, 2.0]: should be at most 1",
        ),
        ("--light-type sky --set light.up=0,0,0", "up = [0.0, 0.0, 0.0]: no direction"),
        ("--light-type sky --intensity 1e20", "intensity = [1e+20, 1e+20, 1e+20]: should be at most 1e+19"),
        ("--light-type disco", "'disco'"),
        ("--light-from 1,2,3 --light-to 1,2,3", "from and to are the same point"),
        ("--cone 90", "cone = 90.0: should be less than 90"),
        ("--cone 0", "cone = 0.0"),
        ("--intensity -1,0,0", "intensity = [-1.0, 0.0, 0.0]: should be ≥ 0"),
        ("--falloff linear", "'linear' is not one of"),
        ("--set fov=30", "--set fov=30: should be SECTION.KEY=VALUE, as camera.fov=30"),
        ("--set camera.fov", "--set camera.fov: should be SECTION.KEY=VALUE"),
        ("--set camera.fob=30", "unknown key 'fob' in [camera]; did you mean 'fov'?"),
        ("--set camra.fov=30", "unknown key 'camra'; did you mean 'camera'?"),
        ("--set march.max_strech=2", "did you mean 'max_stretch'?"),
        ("--set map.coeffs=many", "map.coeffs = 'many': should be a whole number from 1 to 512"),
        ("--set map.coeffs=true", "map.coeffs = True: should be a whole number from 1 to 512"),
        ("--set map.basis=[1]", "map.basis = [1]: unknown basis"),
        ("--set light.type=[1]", "light should be a table with a name as its type"),
        ("--set light.type=disco", "unknown light 'disco'"),
        ("--set light.from_=1,2,3", "unknown key 'from_' in [light]; did you mean 'from'?"),
        ("--set light.volume=3", "unknown key 'volume' in [light]"),
        ("--set light.1.cone=30", "light.1.cone: the scene has no [[light]] tables"),
        ("--set volume.file.x=1", "volume.file.x: 'file' is not a table"),
        ("--set volume.voxel_size=0", "voxel_size is > 0"),
        ("--set volume.voxel_size=1,2", "volume.voxel_size = [1, 2]: should be one number or three"),
        ("--set volume.origin=1e308,0,0", "volume.origin = [1e+308, 0, 0]: should be three finite"),
        ("--set volume.sanitize=yes", "volume.sanitize = 'yes': should be a valid boolean"),
        ("--set medium.self=1", "unknown key 'self' in [medium]"),
        ("--set image.aov=[1]", "image.aov = [1]: should be a list of names"),
        ("--set image.pixel_type=double", "image.pixel_type = 'double': should be 'float' or 'half'"),
        ("--set image.compression=lzw", "image.compression = 'lzw': should be 'none', 'rle', 'zips'"),
    ],
)
def test_impossible_options(bad, cloud, arguments, message):
    assert message in bad(cloud.name, *arguments.split())


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("no/a.png", "no/a.png: there is no directory"),
        ("a.jpg", "a.jpg: not a known image format '.jpg'; known: .deep.exr .exr .npy .png"),
        ("a", "a: not a known image format"),
        ("folder.png", "folder.png: is a directory"),
        ("cloud.npy", "cloud.npy: is the input itself"),
        ("./folder.png/../cloud.npy", "is the input itself"),
    ],
)
def test_outputs_that_cannot_be(bad, cloud, out, message):
    cloud.with_name("folder.png").mkdir()
    assert message in bad(cloud, out=out)


def test_every_output_is_tried_before_the_first_is_made(bad, cloud):
    assert "no/b.png: there is no directory" in bad(cloud, "-o", "no/b.png")
    assert "no/x.json: there is no directory" in bad(cloud, "--json", "no/x.json")


def test_an_output_that_is_read_only(bad, cloud):
    kept = cloud.with_name("a.png")
    kept.write_text("kept")
    kept.chmod(0o400)
    if os.access(kept, os.W_OK):
        pytest.skip("this user may write everything")
    assert "a.png: exists and is read-only" in bad(cloud)


def test_the_volume_of_a_scene_is_not_overwritten(bad, scene):
    assert "is the input itself" in bad(scene(), out="cloud.npy")


# --------------------------------------------------------------------------- scenes


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("to = [8, 6, 7]\n[[", "to = [8, 6, 7\n[[", "not TOML: "),
        ("file = ", "file ", "scene.toml:2: not TOML: "),
        ("from = [0, 0, 40]", "from = [0, 0, 40]\nfrom = [0, 0, 41]", "scene.toml:5: not TOML: "),
        ("[[light]]", "[light]\ncone = 3\n[[light]]", "each begins with [[light]], not [light]"),
        ("[camera]", "[camrea]", "unknown key 'camrea'; did you mean 'camera'?"),
        ("[camera]\nfrom", "[camera]\nform", "unknown key 'form' in [camera]; did you mean 'from'?"),
        (
            "[[light]]\nfrom",
            "[[light]]\nform",
            "light 0: unknown key 'form' in [light]; did you mean 'from'?",
        ),
        ("[[light]]", "[light]", "light should be [[light]] tables"),
        ("[camera]", "[[camera]]", "camera should be a table [camera]"),
        ("[0, 0, 40]", '"front"', "camera.from = 'front': should be three numbers"),
        ("[0, 0, 40]", "[0, 0, true]", "camera.from = [0, 0, True]: should be three numbers"),
        ("[20, 20, 20]", "[8, 6, 7]", "light 0: light: from and to are the same point"),
        ('file = "cloud.npy"', "file = 3", "volume.file = 3: should be the name of a volume file"),
        ('file = "cloud.npy"', "", "volume.file is missing"),
        ('file = "cloud.npy"', 'file = "mist.npy"', "mist.npy: no such file"),
        ('file = "cloud.npy"', 'file = "scene.toml"', "not a known volume format '.toml'"),
        ('file = "cloud.npy"', 'file = ""', "volume.file = '': should be the name of a volume file"),
        (
            'file = "cloud.npy"',
            'file = "a\\u0000.npy"',
            r"volume.file = 'a\x00.npy': should be the name of a volume file",
        ),
        ('"cloud.npy"', '"cloud.npy"\n"a\\nb" = 1', r"unknown key 'a\nb' in [volume]"),
        ("", "cone = 90", "light 0: light.cone = 90"),
        (
            "",
            'name = "a.b"',
            "light 0: light.name = 'a.b': should be text of 1 to 23 letters",
        ),
        (
            "",
            'name = "2"\n[[light]]\nfrom = [9, 9, 9]\nto = [0, 0, 0]',
            'light 1: light.name = "2": light 0 is',
        ),
        ("", "[map]\nself = 1", "unknown key 'self' in [map]"),
        ("", "[map]\ncoeffs = 1" + "0" * 400, "should be a whole number from 1 to 512"),
        ("", "[march]\nmax_stretch = 1" + "0" * 400, "march.max_stretch"),
        ("", "[volume.x]\ny = 1", "unknown key 'x' in [volume]"),
        ("", "x = " + "[" * 5000, "not TOML"),
        ("", "x = " + "9" * 5000, "not TOML"),
        ("", '["placed light"]\ncone = 3', "unknown key 'placed light'"),
    ],
)
def test_impossible_scenes(bad, scene, old, new, message):
    line = bad(scene(old, new))
    assert message in line
    assert re.search(r"scene\.toml(:\d+)?: |npy: ", line) or "not a known volume format" in line


def test_lights_that_are_no_tables(bad, scene):
    text = SCENE[: SCENE.index("[[light]]")]
    dark = scene(SCENE, "light = []\n" + text)  # is one without lights, but none to set the cone of
    assert "light.cone: the scene has 0 [[light]] tables" in bad(dark, "--cone", "30")
    numbers = scene(SCENE, "light = [1]\n" + text)
    assert "light 0: light should be a table" in bad(numbers)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"\xff\xfe[volume]", "not TOML"),
        (b"", "volume.file is missing"),
        (b"#" * (1 << 21), "not a scene file"),
    ],
)
def test_files_that_are_no_scene(bad, folder, content, message):
    (folder / "scene.toml").write_bytes(content)
    assert message in bad("scene.toml")


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("missing.toml", "missing.toml: no such file"),
        ("folder.toml", "folder.toml: is not a file but a directory"),
        ("missing.vdb", "missing.vdb: no such file"),
        ("folder.vdb", "folder.vdb: is not a file"),
        ("picture.jpg", "picture.jpg: neither a scene nor a volume; known extensions: .bgeo .hair .nhdr"),
        ("", "'': should be the name of a file"),
    ],
)
def test_inputs_that_are_not_there(bad, folder, source, message):
    (folder / "folder.toml").mkdir()
    (folder / "folder.vdb").mkdir()
    assert message in bad(source)


# --------------------------------------------------------------------------- volumes


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, -0.5])
def test_a_density_that_is_none(bad, folder, value):
    density = blobs()
    density[3, 4, 5] = value
    np.save(folder / "cloud.npy", density)
    line = bad("cloud.npy")
    assert f"the first {value:g} at [z=3, y=4, x=5]" in line
    assert "--set volume.sanitize=true" in line


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.ones((3, 3)), "(3, 3)"),
        (np.ones((3, 3, 3, 2)), "(3, 3, 3, 2)"),
        (np.ones((3, 0, 3)), "is empty"),
        (np.ones((3, 3, 3), complex), "complex128"),
        (np.full((3, 3, 3), "a"), "not real numbers"),
    ],
)
def test_arrays_that_are_no_volume(bad, folder, array, message):
    np.save(folder / "cloud.npy", array)
    assert message in bad("cloud.npy")


class Bomb:
    """Leaves a file behind when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, ("unpickled",)


@pytest.mark.parametrize("name", ["cloud.npy", "cloud.npz"])
def test_pickles_are_not_opened(bad, folder, name):
    save = np.save if name.endswith("npy") else np.savez
    save(folder / name, np.full((1, 1, 1), Bomb(), object), allow_pickle=True)
    bad(name)
    (folder / "raw.npy").write_bytes(pickle.dumps(Bomb()))
    bad("raw.npy")
    assert not (folder / "unpickled").exists()


def npy_header(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
    return stream.getvalue() + bytes(64)


def vol_header(shape):
    z, y, x = (min(n, (1 << 31) - 1) for n in shape)
    return b"VOL\x03" + struct.pack("<5i6f", 1, x, y, z, 1, 0, 0, 0, 1, 1, 1) + bytes(64)


def nrrd_header(shape):
    sizes = " ".join(str(n) for n in reversed(shape))
    return (
        f"NRRD0004\ntype: float\ndimension: 3\nsizes: {sizes}\nencoding: raw\nendian: little\n\n".encode()
        + bytes(64)
    )


@pytest.mark.parametrize(
    ("name", "header"),
    [("a.npy", npy_header), ("a.vol", vol_header), ("a.nrrd", nrrd_header), ("a.raw", None)],
)
@pytest.mark.parametrize("shape", [(HUGE, HUGE, HUGE), (1 << 20, 1 << 20, 1), (2000, 2000, 2000), (-4, 4, 4)])
def test_a_header_that_promises_too_much_costs_no_memory(refused, bad, folder, name, header, shape):
    if header:
        (folder / name).write_bytes(header(shape))
    else:
        (folder / name).write_bytes(bytes(64))
        description = {"shape": list(shape), "dtype": "float32", "dims": list(shape), "type": "float32"}
        (folder / "a.json").write_text(json.dumps(description))
    tracemalloc.start()
    try:
        bad(name)
        refused("info", name)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 50e6


@pytest.mark.parametrize("name", ["a.npy", "a.vol", "a.nrrd"])
def test_a_header_that_promises_too_much_within_a_memory_limit(folder, program, name):
    header = {"a.npy": npy_header, "a.vol": vol_header, "a.nrrd": nrrd_header}[name]
    (folder / name).write_bytes(header((1 << 11, 1 << 11, 1 << 8)))  # 4 GiB
    done = subprocess.run(
        program("render", name, "-o", "a.png"),
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (2 << 30, 2 << 30)),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith(f"tfm: {name}: ")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("kept", [0, 7, 100, 1000, 10_000, 20_000, -1])
def test_a_truncated_vdb(bad, cli, folder, kept):
    content = VDB.read_bytes()
    (folder / "a.vdb").write_bytes(content)
    assert cli("render", "a.vdb", "--print-config").code == 0
    (folder / "a.vdb").write_bytes(content[:kept])
    assert "a.vdb: " in bad("a.vdb")


@pytest.mark.parametrize("suffix", ["vdb", "nvdb", "npy", "npz", "vol", "nrrd"])
@pytest.mark.parametrize("content", [b"", b"\0" * 200, b"volume of another kind" * 20])
def test_a_file_of_another_kind(bad, folder, suffix, content):
    (folder / f"a.{suffix}").write_bytes(content)
    assert f"a.{suffix}: " in bad(f"a.{suffix}")


def test_a_truncated_array(bad, cloud):
    cloud.write_bytes(cloud.read_bytes()[:-10])
    assert "cloud.npy: " in bad(cloud)


@pytest.mark.parametrize(
    "name", ["cortex_smoke.vdb", "wdas_cloud_sixteenth.vdb", "openvdb_smoke_blosc.nvdb", "teapot_cloud.nvdb"]
)
@pytest.mark.parametrize("kept", [0.02, 0.5, 0.999])
def test_a_truncated_real_volume(bad, folder, shared_volumes, name, kept):
    content = (shared_volumes / name).read_bytes()
    (folder / name).write_bytes(content[: int(kept * len(content))])
    assert f"{name}: " in bad(name)


@pytest.mark.parametrize("name", ["wdas_cloud_sixteenth.vdb", "openvdb_smoke_blosc.nvdb"])
def test_a_corrupt_blosc_block(bad, folder, shared_volumes, name):
    content = bytearray((shared_volumes / name).read_bytes())
    middle = len(content) // 2
    content[middle : middle + 4000] = b"\xff" * 4000
    (folder / name).write_bytes(content)
    assert f"{name}: " in bad(name)


def test_a_level_set(bad, shared_volumes):
    line = bad(shared_volumes / "cortex_sphere.vdb")
    assert "is a level set (signed distances), not a fog volume" in line


def test_names_of_the_grids_are_listed(bad, folder):
    np.savez(folder / "two.npz", smoke=np.ones((2, 2, 2)), fire=np.ones((2, 2, 2)))
    assert "several grids ('smoke', 'fire'); choose one with --grid NAME" in bad("two.npz")
    assert "no grid named 'ash'; it has 'smoke', 'fire'" in bad("two.npz", "--grid", "ash")


def test_a_volume_that_brings_its_own_transform(bad, folder):
    shutil.copy(VDB, folder / "a.vdb")
    assert "it brings its own transform" in bad("a.vdb", "--set", "volume.voxel_size=1")


# --------------------------------------------------------------------------- devices


def test_no_opencl_device(bad, cloud, monkeypatch):
    monkeypatch.setattr(tfm_cl.device.device, "_all_devices", list)
    line = bad(cloud, "-q", code=3)
    assert "no OpenCL device found; install a CPU's: pip install 'pyopencl[pocl]'" in line


def test_an_unknown_device(bad, cloud, cli):
    names = [row["name"] for row in cli("devices", "--json").json]
    line = bad(cloud, "-q", "--device", "GeForce 9000", code=3)
    assert "no OpenCL device has the name or number 'GeForce 9000'" in line
    assert all(name in line for name in names)


@pytest.mark.parametrize(
    ("limit", "arguments", "message"),
    [
        (2, (), "the volume (148×148×148 voxels) needs "),
        (20, ("--map-res", "1024"), "the map needs a buffer of 32 MiB; "),
        (20, ("--res", "2000x1500"), "the image needs a buffer of 46 MiB; "),
    ],
)
def test_more_than_the_device_allows(bad, folder, monkeypatch, limit, arguments, message):
    from tfm_cl.device.launch import Launcher  # noqa: PLC0415 - next to its use

    np.save(folder / "large.npy", np.full((148, 148, 148), 0.01, np.float32))
    initialise = Launcher.__init__

    def small(self, device, *rest, **named):
        initialise(self, device, *rest, **named | {"largest_buffer": limit << 20})

    monkeypatch.setattr(Launcher, "__init__", small)
    line = bad("large.npy", "-q", *arguments, code=3)
    assert message in line
    # The volume may take several buffers.
    allowed = f"{8 * limit}.0 MiB in 8 buffers; smaller voxels may fit" if not arguments else f"{limit} MiB"
    assert f"allows {allowed}" in line


def test_out_of_memory(bad, cloud, monkeypatch):
    def full(*_, **__):
        raise MemoryError

    monkeypatch.setattr("tfm_cl.render.renderer.Renderer.render", full)
    assert "out of memory" in bad(cloud, "-q", code=3)


def test_without_any_platform_as_a_program(cloud, program, tiny):
    nowhere = cloud.with_name("vendors")
    environment = os.environ | {
        "OCL_ICD_VENDORS": str(nowhere),
        "OCL_ICD_FILENAMES": "",
        "OPENCL_VENDOR_PATH": str(nowhere),
    }
    code = "import pyopencl as cl\ntry: print(len(cl.get_platforms()))\nexcept cl.Error: print(0)"
    found = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    if found.stdout.strip() != "0":
        pytest.skip("this OpenCL loader finds its platforms by itself")
    done = subprocess.run(
        program("render", cloud, "-o", "a.npy", "-q", *tiny),
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout) == (3, "")
    assert "pip install 'pyopencl[pocl]'" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not cloud.with_name("a.npy").exists()
