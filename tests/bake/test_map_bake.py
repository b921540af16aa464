"""Baked maps: what is in the files, and what every decoder makes of them."""

import json
import re
import shutil
import struct
import subprocess
from itertools import cycle
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from scenes import make_scene
from tolerances import BAKED, BAKED_ON_GPU

import tfm_cl as tfm
from tfm_cl.bake.decoders.decode import optical_depth
from tfm_cl.bake.map import DECODERS, MapBake
from tfm_cl.errors import SceneError
from tfm_cl.files import texture_io
from tfm_cl.maps.bases import BASES

DECODER_FOLDER = Path(__file__).parents[2] / "tfm_cl" / "bake" / "decoders"
TEXTURES = ("coefficients", "ranges", "functions")
SIGMA_T = 4.0
SETTINGS = {"res": 16, "steps": 24}
SPOT = tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24, intensity=3, name="key")
PROJECTED = (
    SPOT,
    tfm.SpotLight(from_=(0.5, 0.5, 0.5), to=(0, 0, 0), cone=70),
    tfm.PointLight(from_=(0.2, 0.1, 0.3)),
    tfm.SunLight(from_=(1, 1, 0.2), to=(0, 0, 0)),
    tfm.PointLight(from_=(1.0, 0.1, 2), reach=2.3),
)
"""Of each projection one, and one that ends."""
SERIES = [name for name, basis in BASES.items() if basis.functions is not None]
CASES = [(basis, "auto") for basis in SERIES] + [("klt", "box")]


def scene_of(basis="klt", range_="auto", lights=(SPOT,), **changes):
    return make_scene(lights=lights, map=tfm.MapSettings(basis=basis, range=range_, **SETTINGS), **changes)


def silent(stage, fraction):
    del stage, fraction


def layers_of_exr(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
    prefixes = sorted({name.rpartition(".")[0] for name in channels})
    names = ([f"{prefix}.{c}".lstrip(".") for c in "RGBA"] for prefix in prefixes)
    return np.stack([np.stack([channels[name] for name in four], axis=-1) for four in names])


def layers_of_ktx2(path):
    """By the specification's offsets, and nothing of what wrote it."""
    data = Path(path).read_bytes()
    assert data[:12] == bytes.fromhex("AB4B5458203230BB0D0A1A0A")
    vk, size, width, height, depth, layers, faces, levels, packed = struct.unpack_from("<9I", data, 12)
    assert (size, depth, faces, levels, packed) == ({109: 4, 97: 2}[vk], 0, 1, 1, 0)
    begin, length, unpacked = struct.unpack_from("<3Q", data, 80)
    assert length == unpacked == layers * height * width * 4 * size == len(data) - begin
    assert begin % (4 * size) == 0
    return np.frombuffer(data[begin:], f"<f{size}").reshape(layers, height, width, 4)


READERS = {"exr": layers_of_exr, "ktx2": layers_of_ktx2}


def textures_of(folder, entry, ending):
    names = (entry["files"][what] for what in TEXTURES)
    return [
        READERS[ending](folder / next(file for file in files if file.endswith(ending))) for files in names
    ]


def entries_of(folder):
    return json.loads((folder / "maps.json").read_text())["maps"]


@pytest.fixture
def points(rng):
    return rng.uniform(-1.5, 1.5, (2000, 3))


def check(found, light_map, points, tolerance):
    expected = light_map.evaluate(points, SIGMA_T)
    assert expected.min() < 0.5  # something is in the way
    np.testing.assert_allclose(np.exp(-SIGMA_T * found), expected, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("case", "lights"),
    [
        (("klt", "auto"), (SPOT,)),
        # What a projection is and what a basis is have nothing to do with each other: all of each are met.
        pytest.param(("klt", "auto"), PROJECTED, marks=pytest.mark.slow),
        *(
            pytest.param(case, lights, marks=pytest.mark.slow)
            for case, lights in zip(CASES, cycle((light,) for light in PROJECTED), strict=False)
        ),
    ],
)
def test_numpy_decodes_what_the_map_evaluates(case, lights, renderer, tmp_path, points):
    scene = scene_of(*case, lights=lights)
    written = MapBake().bake(renderer, scene, tmp_path / "maps", silent)

    assert all(path.is_file() for path in written)
    maps = renderer.build_maps(scene)
    for entry, light_map in zip(entries_of(tmp_path / "maps"), maps, strict=True):
        for ending in texture_io.FORMATS:
            textures = textures_of(tmp_path / "maps", entry, ending)
            check(optical_depth(entry, *textures, points), light_map, points, BAKED)


def test_halves_and_one_format_are_what_was_asked_for(renderer, tmp_path):
    scene = scene_of(lights=(SPOT.replace(radius=0.1, samples=2),))
    written = MapBake(formats=["ktx2"], pixel_type="half").bake(renderer, scene, tmp_path / "maps", silent)

    names = {path.name for path in written}
    assert {"key.0001.coefficients.ktx2", "key.0002.ranges.ktx2", *DECODERS} < names
    assert not [name for name in names if name.endswith(".exr")]
    assert layers_of_ktx2(tmp_path / "maps" / "key.0001.coefficients.ktx2").dtype == np.float16
    assert layers_of_ktx2(tmp_path / "maps" / "key.0001.ranges.ktx2").dtype == np.float32


def test_what_no_decoder_reads_is_refused(renderer, tmp_path):
    for scene, why in (
        (make_scene(map=tfm.MapSettings(basis="moments", coeffs=5)), "is no series"),
        (make_scene(volume=tfm.SphereVolume(radius=1.0)), "nothing to bake"),
        (make_scene(lights=[]), "nothing to bake"),
    ):
        with pytest.raises(SceneError, match=why):
            MapBake().bake(renderer, scene, tmp_path / "maps", silent)
    assert not list(tmp_path.iterdir())


def test_a_folder_is_not_called_as_a_file(tmp_path):
    with pytest.raises(tfm.InputError, match=r"light.vdb: is to be a folder of maps"):
        MapBake().check(tmp_path / "light.vdb")
    MapBake().check(tmp_path / "maps.v2")
    assert not list(tmp_path.iterdir())


def test_decoders_are_short():
    for name in DECODERS:
        code = re.sub(r'""".*?"""', "", (DECODER_FOLDER / name).read_text(), flags=re.DOTALL)
        text = re.sub(r"^((from|import) |//).*$", "", code, flags=re.MULTILINE)
        assert len([line for line in text.splitlines() if line.strip()]) <= 40, name


def test_a_texture_beyond_its_type_is_refused(tmp_path):
    with pytest.raises(tfm.InputError, match="holds 70000, which is beyond half"):
        texture_io.write(tmp_path / "a.exr", np.full((1, 2, 2, 4), 7e4, np.float32), "half")
    assert not list(tmp_path.iterdir())


KTX_PARSE = """
import {{read}} from "ktx-parse"; import fs from "fs";
const file = read(new Uint8Array(fs.readFileSync({path})));
const data = file.levels[0].levelData, numbers = new DataView(data.buffer, data.byteOffset);
console.log(JSON.stringify({{...file, levels: [], globalData: null,
  first: numbers.getFloat32(0, true), last: numbers.getFloat32(data.byteLength - 4, true)}}));
"""


def test_another_reader_takes_the_ktx2(tmp_path):
    """Khronos's format as three.js reads it: npm's ktx-parse, where `make oracles` has installed it."""
    packages = Path(__file__).parents[2] / ".venv-ktx" / "node_modules"
    if shutil.which("node") is None or not packages.is_dir():
        pytest.skip("no ktx-parse; `make oracles` installs it where there is npm")
    layers = np.arange(3 * 5 * 7 * 4, dtype=np.float32).reshape(3, 5, 7, 4)
    texture_io.write(tmp_path / "a.ktx2", layers)
    (tmp_path / "node_modules").symlink_to(packages)
    script = tmp_path / "read.mjs"
    script.write_text(KTX_PARSE.format(path=json.dumps(str(tmp_path / "a.ktx2"))))

    found = json.loads(subprocess.run(["node", script], capture_output=True, check=True).stdout)

    assert [found[key] for key in ("pixelWidth", "pixelHeight", "pixelDepth", "layerCount")] == [7, 5, 0, 3]
    assert (found["vkFormat"], found["first"], found["last"]) == (109, 0, layers.size - 1)
    (block,) = found["dataFormatDescriptor"]
    assert [sample["channelType"] & 15 for sample in block["samples"]] == [0, 1, 2, 15]


COMPUTE = """
layout(local_size_x = 64) in;
layout(std430, binding = 3) readonly buffer Points {{ vec4 points[]; }};
layout(std430, binding = 0) writeonly buffer Depths {{ float depths[]; }};
uniform TfmMap entry;
{textures}
void main() {{
  uint i = gl_GlobalInvocationID.x;
  if (i < uint(points.length())) depths[i] = tfm_optical_depth(entry, {names}, points[i].xyz);
}}
"""
HLSL_MAIN = """
cbuffer Entry : register(b0) { TfmMap entry; };
Texture2DArray<float4> coefficients : register(t0); Texture2DArray<float4> ranges : register(t1);
Texture2DArray<float4> functions : register(t2); SamplerState bilinear : register(s0);
StructuredBuffer<float4> points : register(t3); RWStructuredBuffer<float> depths : register(u0);
[numthreads(64, 1, 1)] void main(uint3 id : SV_DispatchThreadID) {
  uint count, stride;
  points.GetDimensions(count, stride);
  if (id.x < count)
    depths[id.x] = tfm_optical_depth(entry, coefficients, ranges, functions, bilinear, points[id.x].xyz);
}
"""


@pytest.fixture(scope="module")
def opengl():
    """Mesa's software OpenGL, or whatever there is."""
    moderngl = pytest.importorskip("moderngl", reason="no moderngl: pip install moderngl")
    try:
        context = moderngl.create_context(standalone=True, backend="egl", require=430)
    except Exception as error:  # noqa: BLE001 - of any library between here and the driver
        pytest.skip(f"no OpenGL 4.3 without a screen ({error}); Debian: apt install libegl1 libgl1-mesa-dri")
    yield context
    context.release()


def run_opengl(context, program, textures, points):
    """Give a shader textures and points, in the buffer 3, and return the depths, in the buffer 0."""
    for unit, (what, array) in enumerate(zip(TEXTURES, textures, strict=True)):
        size = (*array.shape[2:0:-1], len(array))
        texture = context.texture_array(size, 4, array.astype("f4").tobytes(), dtype="f4")
        texture.repeat_x = texture.repeat_y = False
        texture.use(unit)
        for name in program:
            if f"Combined{what}" in name or name == what:
                program[name].value = unit
    given = context.buffer(np.pad(points, ((0, 0), (0, 1))).astype("f4").tobytes())
    found = context.buffer(reserve=4 * len(points))
    given.bind_to_storage_buffer(3)
    found.bind_to_storage_buffer(0)
    program.run(group_x=-(-len(points) // 64))
    return np.frombuffer(found.read(), "f4")


@pytest.fixture
def baked(request, renderer, tmp_path):
    """Folder of the maps of one basis, and the maps."""
    scene = scene_of(*request.param, lights=PROJECTED)
    MapBake().bake(renderer, scene, tmp_path / "maps", silent)
    return tmp_path / "maps", renderer.build_maps(scene)


every_case = pytest.mark.parametrize(
    "baked", [("klt", "auto"), ("dct", "auto")], ids=["ranges", "box"], indirect=True
)


@pytest.mark.slow
@every_case
def test_glsl_decodes_what_the_map_evaluates(baked, opengl, points):
    folder, maps = baked
    declared = "\n".join(f"uniform sampler2DArray {name};" for name in TEXTURES)
    text = (folder / "decode.glsl").read_text()
    main = COMPUTE.format(textures=declared, names=", ".join(TEXTURES))
    program = opengl.compute_shader("#version 430\n" + text + main)

    for entry, light_map in zip(entries_of(folder), maps, strict=True):
        for name in ("light_from_world", "unit_from_light"):
            program[f"entry.{name}"].write(np.transpose(entry[name]).astype("f4").tobytes())
        for name in ("chart", "cone", "series", "reach", "projection", "box"):
            value = entry[name]
            program[f"entry.{name}"].value = tuple(value) if isinstance(value, list) else value
        found = run_opengl(opengl, program, textures_of(folder, entry, "ktx2"), points)
        check(found, light_map, points, BAKED_ON_GPU)


@pytest.mark.slow
@every_case
def test_hlsl_decodes_what_the_map_evaluates(baked, opengl, points, tmp_path):
    """Compiled to SPIR-V by glslang's front end for HLSL, and from there to GLSL by SPIRV-Cross."""
    lacking = [name for name in ("glslangValidator", "spirv-cross") if shutil.which(name) is None]
    if lacking:
        pytest.skip(f"no {' '.join(lacking)}; Debian: apt install glslang-tools spirv-cross")
    folder, maps = baked
    shader, code = tmp_path / "main.hlsl", tmp_path / "main.spv"
    shader.write_text((folder / "decode.hlsl").read_text() + HLSL_MAIN)
    compiling = ["glslangValidator", "-D", "-V", "-S", "comp", "-e", "main", "-o", code, shader]
    run = subprocess.run(compiling, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout
    crossing = ["spirv-cross", code, "--version", "430", "--no-es"]
    program = opengl.compute_shader(
        subprocess.run(crossing, capture_output=True, text=True, check=True).stdout
    )

    for entry, light_map in zip(entries_of(folder), maps, strict=True):
        keys = ("light_from_world", "unit_from_light", "chart", "cone", "series", "reach")
        numbers = np.concatenate([np.ravel(entry[key]) for key in keys]).astype("f4").tobytes()
        block = opengl.buffer(numbers + struct.pack("<2i", entry["projection"], entry["box"]) + bytes(4))
        block.bind_to_uniform_block(0)
        found = run_opengl(opengl, program, textures_of(folder, entry, "exr"), points)
        check(found, light_map, points, BAKED_ON_GPU)
