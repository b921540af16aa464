"""Maps that leave the process: saved, loaded, rendered with, refused."""

import io
import json
import pickle
import zipfile

import numpy as np
import pytest
from scenes import blobs, make_scene

import tfm_cl as tfm
from tfm_cl.errors import InputError, SceneError

LIGHTS = (
    tfm.SpotLight(from_=(2.2, 3.0, 1.2), to=(0, 0, 0), cone=24, intensity=3),
    tfm.SunLight(from_=(1, 1, 0.2), to=(0, 0, 0)),
)
LEARNT = {
    "klt": {},
    "slices by density": {"basis": "slices", "slicing": "density", "storage": "f16"},
    "moments between bounds": {"basis": "moments", "coeffs": 5, "storage": "u8", "range": "box"},
}


def learnt(case):
    return tfm.MapSettings(**{"res": 16, "steps": 24} | LEARNT[case])


SCENE = make_scene(lights=LIGHTS[:1], map=learnt("klt"))


@pytest.fixture(scope="module")
def built(renderer):
    return renderer.build_maps(SCENE)[0]


@pytest.fixture
def file(built, tmp_path):
    built.save(tmp_path / "map.npz")
    return tmp_path / "map.npz"


@pytest.mark.quick("klt")
@pytest.mark.parametrize("case", LEARNT)
def test_a_loaded_map_is_the_same_bit_by_bit(case, renderer, new_renderer, tmp_path, rng):
    lights = LIGHTS[:1] if case == "klt" else (*LIGHTS, tfm.PointLight(from_=(0.2, 0.1, 0.3)))
    solids = [] if case == "klt" else [tfm.SphereSolid(centre=(0.2, -0.1, 0.3), radius=0.3)]
    scene = make_scene(lights=lights, map=learnt(case), solids=solids)
    maps = renderer.build_maps(scene)
    expected = renderer.render(scene, maps=maps).image
    points = rng.uniform(-1, 1, (200, 3))
    for i, light_map in enumerate(maps):
        light_map.save(tmp_path / f"{i}.npz")
    loaded = [tfm.TransmittanceMap.load(tmp_path / f"{i}.npz") for i in range(len(maps))]

    np.testing.assert_array_equal(renderer.render(scene, maps=loaded).image, expected)
    for one, other in zip(maps, loaded, strict=True):
        if other is loaded[0] and case != "klt":  # compiled once more, for a device of the loaded map's own
            np.testing.assert_array_equal(one.evaluate(points), other.evaluate(points))
        np.testing.assert_array_equal(one.coefficients, other.coefficients)
        other.save(tmp_path / "again.npz")
        other.save(tmp_path / "twice.npz")
        assert (tmp_path / "again.npz").read_bytes() == (tmp_path / "twice.npz").read_bytes()
    if case != "klt":
        with new_renderer() as another:  # which has a context of its own
            np.testing.assert_array_equal(another.render(scene, maps=maps).image, expected)


def test_a_loaded_map_knows_no_density(file):
    loaded = tfm.TransmittanceMap.load(file)
    for ask in (lambda: loaded.curve(0.5, 0.5), lambda: loaded.residual):
        with pytest.raises(SceneError, match="knows no density"):
            ask()


CHANGED = {
    "volume": lambda scene: scene.replace(volume=scene.bodies[0].with_density_scale(3)),
    "volume ": lambda scene: scene.replace(
        volume=tfm.Volume(blobs(seed=8), world_from_index=scene.bodies[0].world_from_index, density_scale=4)
    ),
    "light": lambda scene: scene.replace(lights=[scene.lights[0].replace(cone=25.0)]),
    "set of solids": lambda scene: scene.replace(solids=[tfm.SphereSolid(centre=(0, 0.1, 0), radius=0.3)]),
    "map settings": lambda scene: scene.replace(map=scene.map.replace(coeffs=7)),
}


@pytest.mark.quick("volume", "light", "map settings")
@pytest.mark.parametrize("what", CHANGED)
def test_a_map_of_something_else_is_refused(what, file, renderer):
    with pytest.raises(SceneError, match=rf"^map 1 was built for another {what.strip()};"):
        renderer.render(CHANGED[what](SCENE), maps=[tfm.TransmittanceMap.load(file)])


def test_what_is_no_file_of_a_map_is_refused(built, file, tmp_path):
    with pytest.raises(InputError, match=r"map\.exr: a map is saved as \.npz"):
        built.save(tmp_path / "map.exr")
    with pytest.raises(InputError, match="no such file"):
        tfm.TransmittanceMap.load(tmp_path / "nothing.npz")
    np.savez(tmp_path / "other.npz", density=blobs())
    with pytest.raises(InputError, match="of no map: TransmittanceMap"):
        tfm.TransmittanceMap.load(tmp_path / "other.npz")
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(InputError, match=r"text\.npz: not a readable \.npz"):
        tfm.TransmittanceMap.load(tmp_path / "text.npz")
    assert not list(tmp_path.glob("*.tmp"))
    assert file.exists()


def rewritten(file, arrays=None, about=None, drop=()):
    """The file with other arrays, and another text."""
    with np.load(file) as archive:
        held = dict(archive)
    text = json.loads(held.pop("about").tobytes()) | (about or {})
    for name in drop:
        del held[name]
    held |= arrays or {}
    np.savez(file, about=np.frombuffer(json.dumps(text).encode(), np.uint8), **held)


DAMAGE = {
    "a newer version": ({"about": {"version": 2}}, "version 2, of which this program knows 1 only"),
    "numbers of another shape": ({"arrays": {"numbers": np.zeros((4, 4, 8), np.float32)}}, "'numbers' is"),
    "numbers of another type": ({"arrays": {"numbers": np.zeros((16, 16, 8))}}, "not float32"),
    "no number": ({"arrays": {"ranges": np.full((16, 16, 4), np.nan, np.float32)}}, "not finite"),
    "a range of one row": ({"arrays": {"ranges": np.zeros((1, 1, 4), np.float32)}}, "one row"),
    "functions cut off": ({"arrays": {"modes": np.zeros((3, 8), np.float32)}}, "'modes' should be"),
    "no functions": ({"drop": ["modes"]}, "'modes' is missing"),
    "an impossible size": ({"about": {"settings": {"basis": "klt", "res": 10**9}}}, "map.res = 1000000000"),
    "another basis's count": ({"about": {"settings": {"basis": "moments", "coeffs": 8}}}, "coeffs"),
    "no settings": ({"about": {"settings": 3}}, "nothing valid of 'settings'"),
    "a light that is none": ({"about": {"light": {"type": "laser"}}}, "laser"),
    "a light looking nowhere": ({"arrays": {"light_axes": np.zeros((3, 3))}}, "across each other"),
    "a chart that is none": ({"arrays": {"light_chart": np.array(9.0)}}, "one of the 3 charts"),
    "no grids": ({"arrays": {"of_grids_size": np.zeros((0, 3), np.int32)}}, "has 0 rows"),
    "a field too many": ({"about": {"field_index": 1}}, "field_index = 1 of 1"),
    "a chart of no number": ({"arrays": {"light_chart": np.array(np.nan)}}, "'light_chart' holds numbers"),
    "a pickle": ({"arrays": {"numbers": np.array([print], object)}}, "'numbers' is object"),
}


@pytest.mark.parametrize("case", DAMAGE)
def test_a_damaged_file_is_refused_in_one_line(case, file):
    change, why = DAMAGE[case]
    rewritten(file, **change)
    with pytest.raises(InputError) as caught:
        tfm.TransmittanceMap.load(file)
    (line,) = caught.value.args
    assert str(line).startswith(f"{file}: ")
    assert why in line
    assert line.count("damaged map") < 2  # the place once


def test_a_small_archive_that_declares_much_takes_no_memory(file):
    """A deflated text of zeros, beyond what any text may be."""
    with zipfile.ZipFile(file, "a", zipfile.ZIP_DEFLATED) as archive:
        whole = {name: archive.read(name) for name in archive.namelist()}
    stream = io.BytesIO()
    np.save(stream, np.zeros(1 << 24, np.uint8))
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in whole.items():
            archive.writestr(name, stream.getvalue() if name == "about.npy" else data)
    with pytest.raises(InputError, match="at most 1,048,576 are expected"):
        tfm.TransmittanceMap.load(file)


def test_a_compressed_map_takes_no_more_memory_than_its_file(file):
    with np.load(file) as archive:
        held = dict(archive)
    about = json.loads(held["about"].tobytes())
    about["settings"]["res"] = 1024
    held["about"] = np.frombuffer(json.dumps(about).encode(), np.uint8)
    np.savez_compressed(file, **held | {"numbers": np.zeros((1024, 1024, 8), np.float32)})
    with pytest.raises(InputError, match="'numbers' is compressed"):
        tfm.TransmittanceMap.load(file)


def test_any_cut_of_a_file_is_refused(file):
    data = file.read_bytes()
    for part in (0, 1, len(data) // 2, len(data) - 30):
        file.write_bytes(data[:part])
        with pytest.raises(InputError):
            tfm.TransmittanceMap.load(file)
    file.write_bytes(pickle.dumps({"numbers": 3}))
    with pytest.raises(InputError):
        tfm.TransmittanceMap.load(file)
