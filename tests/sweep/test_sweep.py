"""The sweep's bookkeeping with a renderer that only pretends, and once with the real one."""

import contextlib
import csv
import dataclasses
import json
import multiprocessing
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from itertools import product
from types import SimpleNamespace

import numpy as np
import processes
import pytest

from tfm_cl import metrics
from tfm_cl.cli import main
from tfm_cl.errors import DeviceError, InputError, NoDeviceError, SceneError
from tfm_cl.files.volume_io.leaves import Leaves
from tfm_cl.maps.resolved import resolve
from tfm_cl.metrics import compare
from tfm_cl.render.renderer import Renderer
from tfm_cl.scene.bodies.box import BoxVolume
from tfm_cl.scene.bodies.volume import Volume
from tfm_cl.scene.medium import Medium
from tfm_cl.scene.settings import MapSettings
from tfm_cl.sweep import keys as sweep_keys
from tfm_cl.sweep import run as sweep
from tfm_cl.sweep import work as sweep_work
from tfm_cl.sweep import written as sweep_report
from tfm_cl.sweep.run import content_hash, read_rows

RES = (24, 16)
"""Of pictures that nobody looks at: FLIP takes most of the time."""


class FakeMap:
    """Errs by a tenth of T over n; density everywhere but in the first row of texels."""

    def __init__(self, scene):
        self.settings = resolve(scene.map)
        self.error = 1 / self.settings.coeffs
        self.bytes_per_texel = (
            self.settings.coeffs * {"f32": 4.0, "f16": 2.0, "u8": 1.0}[self.settings.storage]
        )
        self.buffers = SimpleNamespace(seconds=0.25)
        self.occupied = np.zeros((*2 * (self.settings.res,), 2), np.float32)
        self.occupied[1:, :, 1] = 1

    def curve(self, u, v, count=256):
        if not (0.01 < u < 0.99 and 0.01 < v < 0.99):
            raise SceneError("the light ray misses the medium")
        distance = np.linspace(1, 3, count)
        exact = np.exp(-10 * u * (distance - 1))
        return distance, exact, exact * (1 - 0.1 / self.settings.coeffs)


class FakeRenderer:
    """A lit square; maps darken it by 1 / (n α). Fails, if told to, at one rendering."""

    device_name = "pretended"

    def __init__(self, fail_at=None, alpha=0.9, exact=False):
        self.calls = []
        self.built = []
        self._fail_at, self._alpha, self._exact = fail_at, alpha, exact

    def build_maps(self, scene, progress):
        progress("light pass", 1.0)
        self.built.append(scene.map)
        return [FakeMap(scene) for _ in scene.lights]

    def render(self, scene, *, maps=None, method=None, progress=None):
        if len(self.calls) == self._fail_at:
            raise KeyboardInterrupt
        if method == "tfm":
            assert maps[0].settings.request() == scene.map
            self.calls.append((scene.map.basis, scene.map.coeffs, scene.map.density_weighting))
        else:
            self.calls.append(("dual", scene.map.steps, scene.march.steps))
        progress("view pass", 0.5)
        progress("view pass", 1.0)
        return SimpleNamespace(
            image=self.image(scene, method),
            stats=SimpleNamespace(
                seconds={"light_pass": 0.0, "view_pass": 1.5},
                map_bytes=4 * (scene.map.coeffs if maps else 0) * scene.map.res**2,
            ),
        )

    def image(self, scene, method):
        width, height = scene.camera.res
        image = np.zeros((height, width, 4), np.float32)
        square = image[height // 4 : -height // 4, width // 4 : -width // 4]
        square[:] = np.linspace(0.2, 1.0, square.shape[1])[:, None]
        square[..., 3] = self._alpha
        if method == "tfm" and not self._exact:
            alpha = scene.map.density_weighting
            image[..., :3] *= 1 - 1 / (scene.map.coeffs * (100 if alpha == "auto" else alpha))
        elif method == "dual" and scene.march.steps > 20:  # the converged one
            image[..., :3] *= 0.8
        return image


def blob(path, size=6, seed=0):
    np.save(path, np.random.default_rng(seed).uniform(0.1, 1, (size, size, size)).astype(np.float32))
    return path


def small(scene):
    return scene.replace(
        camera=scene.camera.replace(res=RES),
        map=scene.map.replace(res=16, steps=20),
        march=scene.march.replace(steps=20),
    )


@pytest.fixture
def volume(tmp_path):
    return blob(tmp_path / "blob.npy")


@pytest.fixture
def out(tmp_path):
    return tmp_path / "results" / "sweep"


WRITE_REPORT = sweep_report.write


def leave_out_report(patch):
    """The report takes most of a small sweep's time; what looks at it asks for it."""
    patch.setattr(sweep_report, "write", lambda *_, **__: None)


@pytest.fixture(autouse=True)
def _without_report(monkeypatch):
    leave_out_report(monkeypatch)


@pytest.fixture
def with_report(_without_report, monkeypatch):
    monkeypatch.setattr(sweep_report, "write", WRITE_REPORT)


PAIRS = {"bases": ("dct",), "coeffs": (2, 4), "converged": False, "overrides": small}
"""2 × 2 settings of one basis, and no more references than one."""


def run(inputs, out, **options):
    """Sweep `PAIRS` with a fresh renderer, unless told otherwise."""
    return sweep.run(inputs, out, **PAIRS | {"renderer": FakeRenderer()} | options)


@pytest.fixture(scope="module")
def swept_once(tmp_path_factory):
    """A complete sweep of `PAIRS`: its folder, and what `swept` returns."""
    folder, renderer = tmp_path_factory.mktemp("swept"), FakeRenderer()
    with pytest.MonkeyPatch.context() as patch:
        leave_out_report(patch)
        rows = run([blob(folder / "blob.npy")], folder / "sweep", renderer=renderer)
    return folder / "sweep", SimpleNamespace(rows=rows, renderer=renderer)


@pytest.fixture
def swept(swept_once, out):
    """A complete sweep of `PAIRS`, in a folder that may be changed."""
    folder, done = swept_once
    shutil.copytree(folder, out)
    return done


def again(volume, out, **options):
    """Sweep with a fresh renderer; returns what it was asked for."""
    renderer = FakeRenderer()
    run([volume], out, renderer=renderer, **options)
    return renderer.calls


def test_every_pair_is_rendered_and_the_reference_once(swept):
    assert swept.renderer.calls == [
        ("dual", 20, 20),
        ("dct", 2, 1.0),
        ("dct", 4, 1.0),
        ("dct", 2, 10.0),
        ("dct", 4, 10.0),
    ]
    assert [(made.coeffs, made.density_weighting) for made in swept.renderer.built] == [
        call[1:] for call in swept.renderer.calls[1:]
    ]


def test_a_row_holds_metrics_settings_and_costs(swept):
    row = swept.rows[1]
    truth = FakeRenderer().image(
        SimpleNamespace(camera=SimpleNamespace(res=RES), march=SimpleNamespace(steps=20)), "dual"
    )
    expected = compare(truth * np.array([0.75, 0.75, 0.75, 1], np.float32), truth)

    assert (row.volume, row.coeffs, row.density_weighting) == ("blob", 4, 1.0)
    assert (row.basis, row.storage, row.map_res, row.map_steps, row.view_steps) == ("dct", "f32", 16, 20, 20)
    assert (row.width, row.height) == RES
    assert (row.ssim, row.psnr) == pytest.approx((expected.ssim, expected.psnr))
    assert (row.lit_ssim, row.lit_psnr) == pytest.approx((expected.lit.ssim, expected.lit.psnr))
    assert row.lit_rmse < row.rmse == pytest.approx(expected.rmse)
    assert (row.seconds_light_pass, row.seconds_view_pass, row.seconds_reference) == (0.25, 1.5, 1.5)
    assert (row.map_bytes, row.bytes_per_texel, row.t_error) == (4 * 4 * 16**2, 16, 0.25)
    assert (row.target, row.range, row.fit, row.lookup) == ("transmittance", "box", "l2", "interpolate")
    assert (row.device, row.converged, row.converged_lit_psnr) == ("pretended", None, None)


def test_jsonl_and_csv_hold_the_rows(swept, out):
    lines = [json.loads(line) for line in (out / "sweep.jsonl").read_text().splitlines()]
    with (out / "sweep.csv").open() as file:
        table = list(csv.DictReader(file))

    assert [line["lit_psnr"] for line in lines] == [row.lit_psnr for row in swept.rows]
    assert [float(line["lit_psnr"]) for line in table] == [row.lit_psnr for row in swept.rows]
    assert [line["coeffs"] for line in table] == ["2", "4", "2", "4"]
    assert list(table[0]) == list(lines[0])
    assert read_rows(out) == swept.rows


def test_infinite_psnr_survives_json(volume, out):
    rows = run([volume], out, coeffs=[2], renderer=FakeRenderer(exact=True))

    assert rows[0].psnr == np.inf
    assert json.loads((out / "sweep.jsonl").read_text().splitlines()[0])["psnr"] is None
    assert ",inf," in (out / "sweep.csv").read_text()
    assert read_rows(out) == rows


def test_a_complete_sweep_is_not_rendered_again(swept, volume, out):
    images = sorted((out / "images").glob("*.npy"))

    assert again(volume, out) == []
    assert read_rows(out) == swept.rows
    assert sorted((out / "images").glob("*.npy")) == images
    assert len(images) == 5


def test_more_coefficients_add_rows(swept, volume, out):
    renderer = FakeRenderer()
    rows = run([volume], out, coeffs=(4, 8), renderer=renderer)

    assert renderer.calls == [("dct", 8, 1.0), ("dct", 8, 10.0)]
    assert [(row.coeffs, row.density_weighting) for row in rows] == [(4, 1), (8, 1), (4, 10), (8, 10)]
    assert rows[0] == swept.rows[1]
    assert len(read_rows(out)) == 6


@pytest.mark.parametrize(
    ("fail_at", "remaining"),
    [
        (0, [("dual", 20, 20), ("dct", 2, 1.0), ("dct", 4, 1.0), ("dct", 2, 10.0), ("dct", 4, 10.0)]),
        (1, [("dct", 2, 1.0), ("dct", 4, 1.0), ("dct", 2, 10.0), ("dct", 4, 10.0)]),
        (3, [("dct", 2, 10.0), ("dct", 4, 10.0)]),
    ],
)
def test_an_interrupted_sweep_goes_on(volume, out, fail_at, remaining):
    with pytest.raises(KeyboardInterrupt):
        run([volume], out, renderer=FakeRenderer(fail_at))

    assert len(read_rows(out)) == max(0, fail_at - 1)
    assert again(volume, out) == remaining
    assert len(read_rows(out)) == 4


@pytest.mark.parametrize("torn", [b'{"volume": "bl', b"\0\0\0\0", b"{}\n"])
def test_a_torn_last_line_is_dropped_and_made_again(swept, volume, out, torn):
    whole = (out / "sweep.jsonl").read_bytes().splitlines(keepends=True)
    (out / "sweep.jsonl").write_bytes(b"".join(whole[:-1]) + torn)
    table = (out / "sweep.csv").read_bytes()
    (out / "sweep.csv").write_bytes(table[:-20])

    assert again(volume, out) == [("dct", 4, 10.0)]
    assert (out / "sweep.jsonl").read_bytes() == b"".join(whole)
    assert (out / "sweep.csv").read_bytes() == table
    assert swept.rows == read_rows(out)


@pytest.mark.usefixtures("swept")
def test_a_missing_line_end_loses_nothing(volume, out):
    whole = (out / "sweep.jsonl").read_bytes()
    (out / "sweep.jsonl").write_bytes(whole.rstrip(b"\n"))

    assert again(volume, out) == []
    assert (out / "sweep.jsonl").read_bytes() == whole


@pytest.mark.usefixtures("swept")
def test_another_damaged_line_is_named(volume, out):
    lines = (out / "sweep.jsonl").read_bytes().splitlines(keepends=True)
    (out / "sweep.jsonl").write_bytes(b"nonsense\n".join(lines))

    with pytest.raises(InputError, match=r"sweep\.jsonl, line 2: not a row"):
        again(volume, out)


CHANGES = {
    "image": (lambda scene: scene.replace(camera=scene.camera.replace(res=(23, 16))), 5),
    "camera": (lambda scene: scene.replace(camera=scene.camera.replace(fov=30.0)), 5),
    "medium": (lambda scene: scene.replace(medium=Medium(sigma_a=0.1)), 5),
    "phase": (lambda scene: scene.replace(medium=Medium(phase="hg:0.5")), 5),
    "light": (lambda scene: scene.replace(lights=[scene.lights[0].replace(cone=12.0)]), 5),
    "lights": (lambda scene: scene.replace(lights=[scene.lights[0], scene.lights[0]]), 5),
    "density": (lambda scene: scene.replace(volume=scene.volume.with_density_scale(7.5)), 5),
    "view steps": (lambda scene: scene.replace(march=scene.march.replace(steps=21)), 5),
    "light steps": (lambda scene: scene.replace(map=scene.map.replace(steps=21)), 5),
    # The dual march uses no map: its image still serves.
    "map size": (lambda scene: scene.replace(map=scene.map.replace(res=17)), 4),
    "storage": (lambda scene: scene.replace(map=scene.map.replace(storage="f16")), 4),
}


@pytest.mark.usefixtures("swept")
@pytest.mark.parametrize("change", CHANGES)
def test_a_changed_setting_is_another_row(volume, out, change):
    changed, renderings = CHANGES[change]

    calls = again(volume, out, overrides=lambda scene: changed(small(scene)))

    assert len(calls) == renderings
    assert len(read_rows(out)) == 8
    assert len({row.key for row in read_rows(out)}) == 8


@pytest.mark.usefixtures("swept")
def test_what_does_not_matter_changes_nothing(volume, out, tmp_path):
    renamed = volume.rename(tmp_path / "renamed.npy")

    assert (
        again(renamed, out, overrides=lambda s: small(s).replace(march=small(s).march.replace(method="dual")))
        == []
    )


@pytest.mark.usefixtures("swept")
def test_changed_voxels_are_another_row(volume, out):
    blob(volume, seed=1)

    assert len(again(volume, out)) == 5


@pytest.mark.parametrize("change", ["device", "version"])
def test_another_device_or_version_is_another_row(swept, volume, out, change, monkeypatch):
    if change == "device":
        monkeypatch.setattr(FakeRenderer, "device_name", "another")
    else:
        for module in (sweep_keys, sweep_work):
            monkeypatch.setattr(module, "__version__", "999")

    assert len(again(volume, out)) == 5
    assert getattr(read_rows(out)[-1], change) != getattr(swept.rows[0], change)


@pytest.mark.parametrize("damage", ["missing", "cut short", "another size", "NaN", "no time"])
def test_a_damaged_reference_is_rendered_again(swept, volume, out, damage):
    path = out / "images" / f"{swept.rows[0].reference}.npy"
    image = np.load(path)
    if damage == "missing":
        path.unlink()
    elif damage == "cut short":
        path.write_bytes(path.read_bytes()[:-100])
    elif damage == "another size":
        np.save(path, image[1:])
    elif damage == "NaN":
        np.save(path, image * np.float32(np.nan))
    else:
        path.with_suffix(".json").write_text("{")

    renderer = FakeRenderer()
    run([volume], out, coeffs=[16], renderer=renderer)

    assert [method for method, *_ in renderer.calls] == ["dual", "dct", "dct"]
    np.testing.assert_array_equal(np.load(path), image)


def test_auto_is_swept_as_its_numbers(volume, out):
    def auto(scene):
        scene = small(scene)
        return scene.replace(
            map=scene.map.replace(res="auto", steps="auto"), march=scene.march.replace(steps="auto")
        )

    rows = run([volume], out, overrides=auto)
    assert len(rows) == 4
    assert all(type(count) is int for row in rows for count in (row.map_res, row.map_steps, row.view_steps))

    def numbers(scene):
        scene = small(scene)
        return scene.replace(
            map=scene.map.replace(res=rows[0].map_res, steps=rows[0].map_steps),
            march=scene.march.replace(steps=rows[0].view_steps),
        )

    assert again(volume, out, overrides=numbers) == []


def test_leaves_are_hashed_as_they_are(monkeypatch):
    density = np.random.default_rng(0).uniform(size=(9, 20, 11)).astype(np.float32)
    other = density.copy()
    other[8, 19, 10] += 1

    def key(array, **settings):
        return content_hash(Volume(Leaves.from_dense(array), **settings))

    dense = content_hash(Volume(density))
    monkeypatch.setattr(Leaves, "to_dense", lambda _self: pytest.fail("a dense array was made"))
    same, *different = key(density), key(other), key(density, density_scale=2), key(density, voxel_size=2)
    assert key(density) == same
    assert len({same, *different}) == 4
    assert content_hash(Volume(density)) == dense  # dense ones stay hashable


def test_what_a_body_is_made_of_counts():
    media = [None, Medium(), Medium(sigma_s=2.0)]
    for body in (Volume(np.ones((2, 2, 2))), BoxVolume()):
        assert len({content_hash(body.with_medium(medium)) for medium in media}) == len(media)


def test_several_inputs_and_equal_names(tmp_path, out):
    inputs = [tmp_path / "a" / "blob.npy", tmp_path / "b" / "blob.npy", tmp_path / "other.npy"]
    for seed, path in enumerate(inputs):
        path.parent.mkdir(exist_ok=True)
        blob(path, seed=seed)

    rows = run(inputs, out, coeffs=[2], density_weightings=[1])

    assert [row.volume for row in rows] == [inputs[0].as_posix(), inputs[1].as_posix(), "other"]
    assert len({row.reference for row in rows}) == 3


def test_progress_never_goes_back_and_ends_at_one(volume, out):
    seen = []
    again(volume, out, progress=lambda stage, fraction: seen.append((stage, fraction)))

    fractions = [fraction for _, fraction in seen]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0, 1)
    march = [fraction for stage, fraction in seen if stage == "blob: reference: view pass"]
    assert 0 < march[0] < march[1] < 1
    assert "blob: dct n=4 α=10: light pass" in dict(seen)


def test_overrides_by_key_are_known_before_the_camera_is_placed(volume, out):
    overrides = [("camera.res", [20, 60]), ("map.res", 8)]
    rows = run([volume], out, coeffs=[2], overrides=iter(overrides))
    again(volume, out, overrides=lambda scene: scene.replace(camera=scene.camera.replace(res=(20, 60))))

    assert (rows[0].width, rows[0].height, rows[0].map_res) == (20, 60, 8)
    # A camera placed for a landscape frame cuts a portrait one off: it is another camera.
    assert read_rows(out)[-1].reference != rows[0].reference


def test_a_frame_of_a_sequence(volume, out):
    pattern = volume.with_name("blob.####.npy")
    for frame in (3, 4):
        np.save(volume.with_name(f"blob.{frame:04d}.npy"), np.load(volume) * (frame - 2))
    rows = [run([pattern], out, frame=frame)[0] for frame in (3, 4)]
    assert [row.volume for row in rows] == ["blob.#### frame 3", "blob.#### frame 4"]
    assert rows[0].reference != rows[1].reference
    with pytest.raises(SceneError, match="needs a frame: --frame 1"):
        run([pattern], out)


def test_a_dark_reference_is_an_error(volume, out):
    with pytest.raises(SceneError, match="blob: the reference shows nothing"):
        run([volume], out, renderer=FakeRenderer(alpha=0.0))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"coeffs": (2, 1000)}, r"map\.coeffs = 1000"),
        ({"bases": ("dct", "wavelet")}, "unknown basis 'wavelet'"),
        ({"density_weightings": (0.5,)}, r"map\.density_weighting = 0\.5"),
        ({"ranges": ("box", "seen")}, r"map\.range = 'seen'"),
        ({"fits": ("l3",)}, r"map\.fit = 'l3'"),
        ({"lookups": ("lattices",)}, r"map\.lookup = 'lattices'"),
        ({"storages": ("f64",)}, r"map\.storage = 'f64'"),
        ({"map_sizes": (0,)}, r"map\.res = 0"),
        ({"converged_steps": 0}, "converged steps = 0"),
        ({"converged": True, "converged_steps": 19}, "blob: 19 converged steps are fewer than the 20"),
        ({"ray": (0.5, 1.5)}, r"ray = 0\.5,1\.5: .* from 0 to 1"),
        ({"ray": (0.5, np.nan)}, "ray = 0.5,nan"),
        ({"ray": (0.0, 0.5)}, "misses the medium"),
        ({"jobs": 0}, "jobs = 0"),
        ({"jobs": 2}, "jobs = 2: every process has its own renderer"),
        ({"jobs": 2, "renderer": Renderer, "overrides": lambda scene: scene}, "other processes can import"),
        ({"bases": ("nodes",), "fits": ("visibility",)}, "fit = 'visibility': basis 'nodes' has"),
    ],
)
def test_wrong_values_fail_before_rendering(volume, out, options, message):
    renderer = FakeRenderer()

    with pytest.raises(InputError, match=message) as caught:
        run([volume], out, **{"renderer": renderer} | options)

    assert "\n" not in str(caught.value)
    assert renderer.calls == []


def test_an_input_that_cannot_be_read_fails_before_rendering(volume, tmp_path, out):
    renderer = FakeRenderer()

    with pytest.raises(InputError, match="missing"):
        run([volume, tmp_path / "missing.npy"], out, renderer=renderer)

    assert renderer.calls == []
    assert not out.exists()


@pytest.mark.parametrize("empty", ["inputs", "bases", "coeffs", "density_weightings"])
def test_nothing_to_sweep(volume, out, empty):
    arguments = {"inputs": [volume], empty: []}

    with pytest.raises(InputError, match="at least one"):
        run(arguments.pop("inputs"), out, **arguments)


def test_a_file_in_the_folders_place(volume, tmp_path):
    (tmp_path / "taken").write_text("")

    with pytest.raises(InputError, match="taken/images: cannot be made") as caught:
        again(volume, tmp_path / "taken")

    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("with_report")
def test_what_a_sweep_leaves(volume, out):
    rows = run([volume], out)
    names = {path.name for path in out.iterdir()}

    assert {"curves", "images", "sweep.jsonl", "sweep.csv", "sweep.md"} <= names
    assert [path.name for path in out.rglob("*") if path.name.startswith(".")] == [".lock"]
    assert "blob" in (out / "sweep.md").read_text()
    assert len(rows) == 4


@pytest.mark.usefixtures("swept")
def test_halves_of_images_are_removed(volume, out):
    half = out / "images" / f".{'0' * 24}.npy.12345678.tmp"
    half.write_bytes(b"half of it")

    assert again(volume, out) == []
    assert not half.exists()


def test_content_hash_is_the_same_in_every_process():
    code = "from tfm_cl.sweep.run import content_hash; print(content_hash({'a': (1, 2.5, 'x', None)}))"
    other = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout

    assert other.strip() == content_hash({"a": (1, 2.5, "x", None)})


def test_content_hash_tells_apart_what_differs(tmp_path):
    zeros = np.zeros((2, 3), np.float32)
    texture = tmp_path / "texture"
    texture.write_bytes(b"one")
    first = content_hash(texture)
    texture.write_bytes(b"two")
    values = [zeros, zeros.T, zeros.astype(int), zeros + 1, [1, [2]], [[1], 2], [1, 2], ["1", 2], ["12"]]

    assert len({content_hash(value) for value in values}) == len(values)
    assert content_hash(zeros[:, ::-1]) == content_hash(zeros)
    assert content_hash(texture) != first
    with pytest.raises(SceneError, match="whether a object"):
        content_hash(object())


# -------------------------------------------------------------------------------------------- the axes


def settings_of(rows, *names):
    return [tuple(getattr(row, name) for name in names) for row in rows]


def test_default_axes(volume, out):
    rows = sweep.run([volume], out, overrides=small, renderer=FakeRenderer())

    assert settings_of(rows, "basis", "density_weighting", "coeffs") == [
        *(("dct", alpha, n) for alpha in (1.0, 10.0) for n in (2, 4, 8, 16)),
        *(("klt", "auto", n) for n in (2, 4, 8, 16)),
    ]
    assert {row.target for row in rows if row.basis == "klt"} == {"optical-depth"}


def test_every_combination(volume, out):
    rows = run(
        [volume],
        out,
        bases=("dct", "klt"),
        coeffs=(2,),
        density_weightings=(1.0,),
        ranges=("box", "visible"),
        fits=("l2", "visibility"),
        lookups=("stochastic", "lattice"),
        storages=("f16", "u8"),
        map_sizes=(8, 16),
    )

    assert settings_of(rows, "basis", "range", "fit", "lookup", "storage", "map_res") == list(
        product(
            ("dct", "klt"),
            ("box", "visible"),
            ("l2", "visibility"),
            ("stochastic", "lattice"),
            ("f16", "u8"),
            (8, 16),
        )
    )
    assert len({row.key for row in rows}) == 64
    assert {row.reference for row in rows} == {rows[0].reference}
    assert settings_of(rows[:3], "bytes_per_texel") == [(4.0,), (4.0,), (2.0,)]


def test_what_comes_to_the_same_is_one_row(volume, out):
    rows = run([volume], out, bases=("auto", "klt", "klt"), coeffs=(2, 2), fits=("visibility",))

    assert settings_of(rows, "basis", "coeffs", "fit") == [("klt", 2, "visibility")]
    assert again(volume, out, bases=["klt"], coeffs=[2]) == []


def test_weightings_count_where_the_target_is_the_transmittance(volume, out):
    def of_transmittance(scene):
        scene = small(scene)
        return scene.replace(map=scene.map.replace(target="transmittance"))

    rows = run([volume], out, bases=["klt"], coeffs=[2], overrides=of_transmittance)

    assert settings_of(rows, "target", "density_weighting") == [("transmittance", 1), ("transmittance", 10)]


def test_refused_combinations_are_left_out(volume, out):
    lines = []
    rows = run([volume], out, bases=("klt", "nodes"), coeffs=(4,), fits=("visibility",), notice=lines.append)

    assert settings_of(rows, "basis", "fit") == [("klt", "visibility")]
    assert len(lines) == 1
    assert lines[0].startswith("left out 2 combinations: map: fit = 'visibility': basis 'nodes'")


@pytest.mark.parametrize(
    ("basis", "asked", "taken"),
    [
        ("fourier", (2, 4, 8, 16), {3: (2,), 5: (4,), 9: (8,), 17: (16,)}),
        ("moments", (2, 4, 8, 16), {5: (2, 4), 7: (8, 16)}),
        ("trig-moments", (2, 4, 8, 16), {5: (2, 4), 9: (8, 16)}),
        ("legendre", (4, 32), {4: (), 16: (32,)}),
        ("nodes", (1, 5, 6), {4: (1,), 6: (5,)}),
        ("fourier", (4, 5), {5: (4,)}),
    ],
)
def test_the_nearest_count_stands_for_one_that_a_basis_has_not(volume, out, basis, asked, taken):
    lines = []
    rows = run([volume], out, bases=[basis], coeffs=asked, density_weightings=["auto"], notice=lines.append)

    assert {row.coeffs: row.stands_for for row in rows} == taken
    assert read_rows(out) == rows
    places = [f"{own} in place of {n}" for own, numbers in taken.items() for n in numbers]
    (line,) = lines
    assert line.startswith(f"basis '{basis}' has ")
    assert sorted(line.partition("coefficients: ")[2].split(", ")) == sorted(places)


def test_a_row_that_is_there_stands_for_more(volume, out):
    options = {"bases": ["fourier"], "density_weightings": ["auto"]}
    run([volume], out, coeffs=[5], **options)
    assert again(volume, out, coeffs=[4], **options) == []
    assert again(volume, out, coeffs=[2], **options) == [("fourier", 3, "auto")]

    assert [(row.coeffs, row.stands_for) for row in read_rows(out)] == [(5, (4,)), (3, (2,))]
    with (out / "sweep.csv").open() as file:
        assert [line["stands_for"] for line in csv.DictReader(file)] == ["4", "2"]


@pytest.mark.usefixtures("with_report")
def test_the_report_says_what_stands_for_what(volume, out):
    run([volume], out, bases=["dct", "fourier"], coeffs=[4, 8], density_weightings=["auto"])

    said = "; fourier with 5 in place of 4, 9 in place of 8 coefficients"
    assert said in (out / "sweep.md").read_text()
    assert said in (out / "report.html").read_text()


def test_a_count_that_no_basis_has_is_refused(volume, out):
    for count in (0, 33):
        with pytest.raises(SceneError, match=f"coeffs = {count}"):
            run([volume], out, bases=["fourier", "dct"], coeffs=[4, count])


def test_one_sweep_at_a_time(volume, out):
    held = sweep.SweepFolder(out)
    message = f"{out}: another sweep is writing there; wait for it to end, or choose another folder"
    with pytest.raises(InputError, match=f"^{re.escape(message)}$"):
        run([volume], out)
    assert read_rows(out) == []
    held.close()
    assert len(run([volume], out)) == 4
    assert len(run([volume], out)) == 4  # each ends its own


def test_a_failed_sweep_leaves_the_folder_to_others(volume, out):
    with pytest.raises(KeyboardInterrupt):
        run([volume], out, renderer=FakeRenderer(fail_at=1))
    assert len(run([volume], out)) == 4


def test_a_folder_that_cannot_be_opened_is_left_to_others(volume, out):
    out.mkdir(parents=True)
    (out / "sweep.jsonl").write_text("no row\nnor this\n")
    for _ in range(2):
        with pytest.raises(InputError, match=r"line 1: not a row"):
            run([volume], out)


def test_two_processes_cannot_sweep_into_one_folder(volume, out):
    """The lock is the system's: it ends with the process, however that ends."""
    code = (
        f"import sys, pathlib, tfm_cl.sweep.run as s; f = s.SweepFolder(pathlib.Path({str(out)!r})); print(1)"
    )
    code += "; sys.stdout.flush(); sys.stdin.read()"
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        assert other.stdout.readline() == b"1\n"
        with pytest.raises(InputError, match="another sweep is writing there"):
            run([volume], out)
        other.kill()
    assert len(run([volume], out)) == 4


def test_nothing_remains(volume, out):
    def of_extinction(scene):
        scene = small(scene)
        return scene.replace(map=scene.map.replace(basis="dct", target="extinction"))

    with pytest.raises(
        SceneError, match=r"no combination .* is possible: map: target = 'extinction': basis 'klt'"
    ):
        run([volume], out, bases=["klt"], overrides=of_extinction)


def test_settings_that_choose_coefficients_play_no_part(volume, out):
    def affordable(scene):
        scene = small(scene)
        return scene.replace(map=scene.map.replace(bytes_=24, coeffs="auto"))

    assert [row.coeffs for row in run([volume], out, density_weightings=[1], overrides=affordable)] == [2, 4]
    assert again(volume, out, density_weightings=[1]) == []


# ------------------------------------------------------------------------------------- converged march


def test_the_converged_march_has_four_times_the_steps(volume, out):
    renderer = FakeRenderer()
    rows = run([volume], out, converged=True, renderer=renderer)
    image = FakeRenderer().image
    scene = SimpleNamespace(
        camera=SimpleNamespace(res=RES),
        march=SimpleNamespace(steps=80),
        map=SimpleNamespace(coeffs=2, density_weighting=1),
    )
    expected = compare(image(scene, "tfm"), image(scene, "dual"))

    assert renderer.calls[:2] == [("dual", 20, 20), ("dual", 80, 80)]
    assert len(renderer.calls) == 6
    row = rows[0]
    assert row.converged not in {None, row.reference}
    assert (row.converged_ssim, row.converged_lit_ssim) == pytest.approx((expected.ssim, expected.lit.ssim))
    assert (row.converged_psnr, row.converged_lit_psnr) == pytest.approx((expected.psnr, expected.lit.psnr))
    assert (row.converged_rmse, row.converged_lit_rmse) == pytest.approx((expected.rmse, expected.lit.rmse))
    assert (out / "images" / f"{row.converged}.npy").is_file()
    assert read_rows(out) == rows


@pytest.mark.parametrize(
    ("own", "asked", "steps"), [(300, None, 1000), (1200, None, 1200), (20, 33, 33), (20, 20, 20)]
)
def test_steps_of_the_converged_march(volume, out, own, asked, steps):
    def stepped(scene):
        scene = small(scene)
        return scene.replace(map=scene.map.replace(steps=own), march=scene.march.replace(steps=own))

    calls = again(volume, out, coeffs=[2], overrides=stepped, converged=True, converged_steps=asked)

    # Where the reference has these steps, it serves as both.
    assert [call for call in calls if call[0] == "dual"] == [
        ("dual", n, n) for n in dict.fromkeys((own, steps))
    ]
    row = read_rows(out)[0]
    assert (row.converged == row.reference) == (own == steps)


def test_infinite_converged_psnr_survives_json(volume, out):
    rows = run([volume], out, converged=True, converged_steps=20, renderer=FakeRenderer(exact=True))

    assert rows[0].converged_psnr == np.inf
    assert json.loads((out / "sweep.jsonl").read_text().splitlines()[0])["converged_psnr"] is None
    assert read_rows(out) == rows


def test_rows_are_compared_with_the_converged_march_later(swept, volume, out):
    calls = again(volume, out, converged=True)
    rows = read_rows(out)

    assert calls == [("dual", 80, 80)]
    assert [row.key for row in rows] == [row.key for row in swept.rows]
    assert all(row.converged_lit_psnr < np.inf for row in rows)
    with (out / "sweep.csv").open() as file:
        assert [line["converged"] for line in csv.DictReader(file)] == [row.converged for row in rows]
    # And stay so, whether it is asked for or not.
    assert again(volume, out, converged=True) == again(volume, out) == []
    assert read_rows(out) == rows


def test_a_row_without_its_image_is_made_again_for_the_converged_march(swept, volume, out):
    (out / "images" / f"{swept.rows[1].key}.npy").unlink()

    assert again(volume, out, converged=True) == [("dual", 80, 80), ("dct", 4, 1.0)]
    assert len(read_rows(out)) == 4


def test_flip_where_it_is_installed(volume, out, monkeypatch):
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    assert [row.flip for row in run([volume], out)] == [None] * 4

    monkeypatch.setattr(sweep_work, "missing", lambda _: None)
    monkeypatch.setattr(metrics, "flip", lambda test, truth: float((truth - test).max()))
    assert run([volume], out, coeffs=[5])[0].flip == pytest.approx(0.2)


# ---------------------------------------------------------------------------------------- equal bytes


def test_equal_bytes(swept):
    def row(volume, basis, size, psnr):
        return dataclasses.replace(
            swept.rows[0], volume=volume, basis=basis, bytes_per_texel=size, lit_psnr=psnr
        )

    rows = [
        row("a", "dct", 16, 20),
        row("a", "dct", 24, 30),
        row("a", "dct", 20, 30),
        row("a", "dct", 41, 50),
        row("a", "klt", 17, np.inf),
        row("b", "klt", 16, 10),
    ]

    assert sweep.equal_bytes(rows) == {
        "a": {
            16: {"dct": rows[0]},
            24: {"dct": rows[2], "klt": rows[4]},
            40: {"dct": rows[2], "klt": rows[4]},
        },
        "b": {16: {"klt": rows[5]}, 24: {"klt": rows[5]}, 40: {"klt": rows[5]}},
    }
    assert sweep.equal_bytes(iter(rows), budgets=[8]) == {"a": {8: {}}, "b": {8: {}}}
    assert sweep.equal_bytes([]) == {}


# --------------------------------------------------------------------------------------------- curves


def curves_of(out, row):
    return json.loads((out / "curves" / f"{row.reference}.json").read_text())


def test_curves(swept, out):
    found = curves_of(out, swept.rows[0])
    distance, exact, _ = FakeMap(SimpleNamespace(map=MapSettings(res=16))).curve(found["u"], found["v"])

    assert (found["volume"], found["light"]) == ("blob", 0)
    assert len(found["distance"]) == 256
    np.testing.assert_allclose(found["distance"], distance, rtol=1e-6)
    np.testing.assert_allclose(found["exact"], exact, rtol=1e-6)
    assert {curve["key"]: curve["label"] for curve in found["curves"]} == {
        row.key: f"dct n={row.coeffs} α={row.density_weighting:g}" for row in swept.rows
    }
    assert [curve["label"][:7] for curve in found["curves"]] == ["dct n=2", "dct n=2", "dct n=4", "dct n=4"]
    np.testing.assert_allclose(found["curves"][2]["values"], exact * 0.975, rtol=1e-6)


def test_labels_tell_what_differs(volume, out):
    run([volume], out, bases=["klt"], coeffs=[8])
    rows = run([volume], out, bases=["klt"], coeffs=[8], ranges=("box", "visible"), map_sizes=(16, 32))

    labels = [curve["label"] for curve in curves_of(out, rows[0])["curves"]]
    assert sorted(labels) == [
        "klt n=8 box 16²",
        "klt n=8 box 32²",
        "klt n=8 visible 16²",
        "klt n=8 visible 32²",
    ]


def test_the_chosen_ray_is_dark_but_not_the_darkest(swept, out):
    found = curves_of(out, swept.rows[0])

    # Depth grows with u; of 16 columns the 90th percentile lies in the 15th. The first row has no density.
    assert found["u"] == 14.5 / 16
    assert found["v"] > 1 / 16


def test_a_ray_of_ones_own(volume, out):
    rows = run([volume], out, ray=(0.25, 0.75))
    first = curves_of(out, rows[0])
    again(volume, out, coeffs=[8])
    kept = curves_of(out, rows[0])
    assert again(volume, out, ray=(0.5, 0.5)) == []
    other = curves_of(out, rows[0])

    assert (first["u"], first["v"]) == (kept["u"], kept["v"]) == (0.25, 0.75)
    assert (len(first["curves"]), len(kept["curves"])) == (4, 6)
    assert (other["u"], len(other["curves"])) == (0.5, 4)


@pytest.mark.parametrize("damage", ["missing", "no JSON", "a key too many digits", "too short"])
def test_damaged_curves_are_made_again(swept, volume, out, damage):
    path = out / "curves" / f"{swept.rows[0].reference}.json"
    whole = path.read_text()
    content = json.loads(whole)
    content["curves"][0]["values"].pop()
    damaged = {
        "no JSON": whole[:-1],
        "a key too many digits": whole.replace(swept.rows[0].key, swept.rows[0].key + "0"),
        "too short": json.dumps(content),
    }
    path.unlink() if damage == "missing" else path.write_text(damaged[damage])

    renderer = FakeRenderer()
    run([volume], out, renderer=renderer)

    assert path.read_text() == whole
    assert renderer.calls == []
    assert len(renderer.built) == 4


def test_an_interrupted_sweep_keeps_its_curves(volume, out):
    with pytest.raises(KeyboardInterrupt):
        run([volume], out, renderer=FakeRenderer(3))

    assert len(curves_of(out, read_rows(out)[0])["curves"]) == 2
    renderer = FakeRenderer()
    rows = run([volume], out, renderer=renderer)
    assert len(renderer.built) == 2
    assert len(curves_of(out, rows[0])["curves"]) == 4


def test_no_ray_no_curves(volume, out, monkeypatch):
    monkeypatch.setattr(sweep_work.sweep_curves, "choose_ray", lambda _map: None)

    assert len(run([volume], out)) == 4
    assert not (out / "curves").exists()
    assert again(volume, out) == []


# ------------------------------------------------------------------------------------- the command line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--coeffs", "2,x"], "--coeffs 2,x: should be values with commas between, as 2,4,8"),
        (["--bases", "dct,,klt"], "--bases dct,,klt: should be values with commas between, as a,b"),
        (["--map-sizes", "auto"], "--map-sizes auto: should be"),
        (["--density-weighting", "ten"], "--density-weighting ten: should be"),
        (["--fits", "l3"], "map.fit = 'l3': should be"),
        (["--ray", "0.5"], "--ray 0.5: should be u,v"),
        (["--ray", "2,0"], "ray = 2,0: should be u,v on the light's map, each from 0 to 1"),
        (["--jobs", "-1"], "jobs = -1: should be from 1 to"),
        (["--converged-steps", "0"], "converged steps = 0: should be from 1 to"),
        (["--converged-steps", "50", "--no-converged"], "--converged-steps: there is nothing converged"),
        (
            ["--map-sizes", "64", "--map-res", "32"],
            "map.res is what the sweep goes through: give its values to",
        ),
        (["--set", "map.basis=klt"], "map.basis is what the sweep goes through: give its values to --bases"),
        (["--set", "map.max_error=0.1"], "map.max_error chooses coeffs, which the sweep goes through"),
        (["--set", "map.colour=1"], "unknown key 'colour' in [map]"),
        (["--set", "image.samples=4"], "image.samples: a sweep compares what passes make of whole frames"),
    ],
)
def test_wrong_options(volume, out, capsys, options, message):
    assert main(["sweep", str(volume), "-o", str(out), *options]) == 2

    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("tfm: ")
    assert message in said.err
    assert said.err.count("\n") == 1
    assert not out.exists()


def test_command_line_hands_everything_over(out, capsys, monkeypatch):
    calls = []

    def pretended(inputs, folder, renderer, **options):
        calls.append((inputs, folder, renderer, options))
        options["notice"]("left out 2 combinations: why")
        folder.mkdir(parents=True)
        (folder / "sweep.md").write_text("a table\n")

    monkeypatch.setattr(sweep, "run", pretended)
    lists = (
        "--bases",
        "dct, klt",
        "--coeffs",
        "3",
        "--density-weighting",
        "2.5,auto",
        "--ranges",
        "box,visible",
    )
    more = (
        "--fits",
        "l2",
        "--lookups",
        "auto,lattice",
        "--storages",
        "f16,u8",
        "--map-sizes",
        "32,64",
        "--converged-steps",
        "90",
        "--jobs",
        "2",
    )
    arguments = (
        "a.npy",
        "b.npy",
        "-o",
        out,
        *lists,
        *more,
        "--ray",
        "0.25,1",
        "--device",
        "x",
        "--steps",
        "7",
    )

    assert main(["sweep", *map(str, arguments)]) == 0
    inputs, folder, renderer, options = calls[0]
    assert (list(map(str, inputs)), folder) == (["a.npy", "b.npy"], out)
    assert (renderer.func, renderer.args) == (Renderer, ("x",))
    del options["progress"], options["notice"]
    assert options == {
        "bases": ["dct", "klt"],
        "coeffs": [3],
        "density_weightings": [2.5, "auto"],
        "ranges": ["box", "visible"],
        "fits": ["l2"],
        "lookups": ["auto", "lattice"],
        "storages": ["f16", "u8"],
        "map_sizes": [32, 64],
        "converged": True,
        "converged_steps": 90,
        "ray": (0.25, 1.0),
        "jobs": 2,
        "scheduler": None,
        "figures": (),
        "latex": False,
        "frame": None,
        "overrides": [("march.steps", 7)],
    }
    said = capsys.readouterr()
    assert said.out == f"a table\n\n{out}: sweep.md\n"
    assert said.err == "tfm: left out 2 combinations: why\n"


# ------------------------------------------------------------------------------------ the real renderer


def plain(device_name, **options):
    """Arguments of a small sweep whose overrides other processes can have."""
    keys = [("camera.res", [48, 32]), ("map.res", 16), ("map.steps", 20), ("march.steps", 20)]
    return {"bases": ("dct", "klt"), "coeffs": (2, 8), "density_weightings": [10.0]} | {
        "overrides": keys,
        "renderer": partial(Renderer, device_name),
        **options,
    }


@pytest.mark.usefixtures("one_lane")
def test_real_renderer(volume, out, device_name):
    rows = sweep.run([volume], out, **plain(device_name, bases=("dct",)))
    worse, better = rows[0], rows[1]

    assert worse.lit_psnr + 6 < better.lit_psnr < 200
    assert worse.lit_ssim < better.lit_ssim <= 1
    assert worse.t_error > better.t_error > 0
    assert 0 < abs(better.converged_lit_psnr - better.lit_psnr) < 3  # 20 steps err as well, by less
    assert settings_of(rows, "basis", "target") == [("dct", "transmittance")] * 2
    assert [row.map_bytes for row in rows] == [4 * 2 * 16**2, 4 * 8 * 16**2]
    assert settings_of(rows, "bytes_per_texel") == [(8,), (32,)]
    assert min(worse.seconds_light_pass, worse.seconds_view_pass, worse.seconds_reference) > 0
    curves = curves_of(out, worse)
    errors = {
        curve["key"]: np.abs(np.subtract(curve["values"], curves["exact"])).max()
        for curve in curves["curves"]
    }
    assert errors[better.key] < errors[worse.key] < 1
    assert curves["exact"][-1] < curves["exact"][0] <= 1


@pytest.mark.slow
@pytest.mark.usefixtures("with_report")
def test_a_lattice_beside_the_map_looked_up_at_every_sample(volume, out, device_name):
    lines, options = [], plain(device_name, bases=("klt",), coeffs=(8,), density_weightings=["auto"])
    options["overrides"] += [("light.0.type", "sun")]
    rows = sweep.run([volume], out, **options, lookups=("auto", "lattice"), notice=lines.append)
    every_sample, lattice = rows

    assert settings_of(rows, "lookup") == [("interpolate",), ("lattice",)]
    assert lattice.t_error == every_sample.t_error  # it is the map's own
    assert lattice.converged_lit_rmse > every_sample.converged_lit_rmse
    assert lines == []
    table = (out / "sweep.md").read_text(encoding="utf-8").splitlines()
    heading = next(i for i, line in enumerate(table) if line.startswith("| basis | lookup |"))
    assert {line.split(" | ")[1] for line in table[heading + 2 : heading + 4]} == {"interpolate", "lattice"}


def test_a_sweep_tells_of_light_that_no_lattice_holds(tmp_path, out):
    lines, volumes = [], [blob(tmp_path / f"{name}.npy") for name in ("one", "other")]

    def of_a_narrow_cone(scene):
        return small(scene).replace(lights=[scene.lights[0].replace(cone=2.0)])

    run(volumes, out, overrides=of_a_narrow_cone, lookups=("lattice",), notice=lines.append)
    assert lines == [
        f'{name}: map.lookup = "lattice" cannot hold all light; the rest is looked up at every sample: '
        "1 of 1 lights have an edge in the grids or are near them"
        for name in ("one", "other")
    ]


@pytest.mark.slow
def test_several_processes_make_the_same_rows(volume, tmp_path, device_name):
    seconds = dict.fromkeys(("seconds_light_pass", "seconds_view_pass", "seconds_reference"), 0.0)
    other = blob(tmp_path / "other.npy", seed=1)
    seen = []
    alone, together = (
        sweep.run(
            [volume, other], tmp_path / str(jobs), **plain(device_name, jobs=jobs, coeffs=(2, 3), **more)
        )
        for jobs, more in ((1, {}), (2, {"progress": lambda _stage, fraction: seen.append(fraction)}))
    )

    assert [dataclasses.replace(row, **seconds) for row in alone] == [
        dataclasses.replace(row, **seconds) for row in together
    ]
    assert curves_of(tmp_path / "1", alone[0])["exact"] == curves_of(tmp_path / "2", alone[0])["exact"]
    assert seen == sorted(seen)
    assert seen[-1] == 1
    assert len(seen) > len(together)


def test_errors_of_other_processes_are_ours(volume, out):
    with pytest.raises(NoDeviceError, match="no OpenCL device has the name or number 'abacus'") as caught:
        sweep.run([volume], out, partial(Renderer, "abacus"), jobs=2)

    assert "\n" not in str(caught.value)
    assert multiprocessing.active_children() == []
    assert not out.exists()


def test_a_process_that_ends_by_itself(volume, out):
    with pytest.raises(DeviceError, match="blob: a process ended by itself") as caught:
        sweep.run([volume], out, Renderer, jobs=2, overrides=processes.end_at_once)

    assert "\n" not in str(caught.value)
    assert multiprocessing.active_children() == []


def test_a_process_that_cannot_be_started(volume, out, monkeypatch):
    def refuse(_process):
        raise OSError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.SpawnProcess.start", refuse)
    with pytest.raises(DeviceError, match=r"jobs = 2: a process cannot be started \(Resource temporarily"):
        sweep.run([volume], out, Renderer, jobs=2)


def test_an_unforeseen_error_of_another_process_tells_where_it_came_from(volume, out):
    with pytest.raises(ZeroDivisionError) as caught:
        sweep.run([volume], out, Renderer, jobs=2, overrides=processes.divide_by_zero)

    assert "divide_by_zero" in "".join(caught.value.__notes__)
    assert multiprocessing.active_children() == []


def test_an_error_that_cannot_be_sent_is_told_all_the_same(volume, out):
    with pytest.raises(RuntimeError, match="not to be sent"):
        sweep.run([volume], out, Renderer, jobs=2, overrides=processes.raise_what_cannot_be_sent)


def test_devices_of_two_kinds(volume, out):
    class Mixed(FakeRenderer):
        names = iter(["one"])

        @property
        def device_name(self):
            return next(self.names, "other")

    with pytest.raises(
        DeviceError, match=r"^blob: a worker has other, where the sweep began on one; times"
    ) as caught:
        run([volume], out, renderer=Mixed())
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX sends them")
@pytest.mark.parametrize(
    ("number", "code", "line"),
    [
        (signal.SIGINT, 130, "tfm: interrupted\n"),
        pytest.param(signal.SIGTERM, 143, "tfm: terminated\n", marks=pytest.mark.slow),
    ],
)
def test_a_signal_ends_all_processes(volume, out, device_name, number, code, line):
    """The whole group gets the signal, as from a terminal or a farm."""
    device = ("--device", device_name) if device_name else ()
    sizes = (
        "--res",
        "64x48",
        "--steps",
        "20",
        "--light-steps",
        "20",
        "--map-sizes",
        ",".join(map(str, range(64, 464))),
    )
    options = ("-o", out, "--jobs", "2", "--bases", "dct", "--coeffs", "2", "--no-converged", *sizes, *device)
    command = [sys.executable, "-m", "tfm_cl", "sweep", str(volume), *map(str, options)]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        deadline = time.monotonic() + 120
        while process.poll() is None and time.monotonic() < deadline:
            if (out / "sweep.jsonl").exists() and len(read_rows(out)) >= 3:
                break
            time.sleep(0.05)
        os.killpg(process.pid, number)
        _, err = process.communicate(timeout=120)  # ends once every process has closed its stderr
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)

    assert (process.returncode, err) == (code, line)
    rows = read_rows(out)
    assert 3 <= len(rows) < 800
    assert not list((out / "images").glob(".*"))
    sizes = [row.map_res for row in rows]
    more = sweep.run(
        [volume],
        out,
        partial(Renderer, device_name),
        bases=["dct"],
        coeffs=[2],
        map_sizes=sorted(set(sizes)),
        converged=False,
        overrides=[("camera.res", [64, 48]), ("map.steps", 20), ("march.steps", 20)],
    )
    assert {row.key for row in rows} <= {row.key for row in more}
