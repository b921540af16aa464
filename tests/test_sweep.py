"""The sweep's bookkeeping with a renderer that only pretends, and once with the real one."""

import csv
import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from tfm_cl import sweep, sweep_report
from tfm_cl.errors import InputError, SceneError
from tfm_cl.leaves import Leaves
from tfm_cl.medium import Medium
from tfm_cl.metrics import compare
from tfm_cl.renderer import Renderer
from tfm_cl.sweep import content_hash, read_rows
from tfm_cl.sweep_report import write as write_report
from tfm_cl.volume import Volume

RES = (48, 32)


class FakeRenderer:
    """A lit square; maps darken it by 1 / (n α). Fails, if told to, at one rendering."""

    device_name = "pretended"

    def __init__(self, fail_at=None, alpha=0.9, exact=False):
        self.calls = []
        self._fail_at, self._alpha, self._exact = fail_at, alpha, exact

    def render(self, scene, *, method=None, progress=None):
        if len(self.calls) == self._fail_at:
            raise KeyboardInterrupt
        self.calls.append((method, scene.map.coeffs, scene.map.density_weighting))
        if method == "tfm":
            progress("light pass", 1.0)
        progress("view pass", 0.5)
        progress("view pass", 1.0)
        return SimpleNamespace(
            image=self.image(scene, method),
            stats=SimpleNamespace(
                seconds={"light_pass": 0.0 if method == "dual" else 0.25, "view_pass": 1.5},
                map_bytes=4 * scene.map.coeffs * scene.map.res**2,
            ),
        )

    def image(self, scene, method):
        width, height = scene.camera.res
        image = np.zeros((height, width, 4), np.float32)
        square = image[height // 4 : -height // 4, width // 4 : -width // 4]
        square[:] = np.linspace(0.2, 1.0, square.shape[1])[:, None]
        square[..., 3] = self._alpha
        if method == "tfm" and not self._exact:
            image[..., :3] *= 1 - 1 / (scene.map.coeffs * scene.map.density_weighting)
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


@pytest.fixture(autouse=True)
def _without_report(monkeypatch):
    """Drawing takes most of a small sweep's time; what looks at the report writes it, or uses `report`."""
    monkeypatch.setattr(sweep_report, "write", lambda _out: None)


@pytest.fixture
def swept(volume, out):
    """A complete sweep of 2 × 2 settings."""
    renderer = FakeRenderer()
    rows = sweep.run([volume], out, coeffs=(2, 4), overrides=small, renderer=renderer)
    return SimpleNamespace(rows=rows, renderer=renderer)


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    """A complete sweep with its report, not to be changed."""
    folder = tmp_path_factory.mktemp("report")
    out = folder / "out"
    rows = sweep.run(
        [blob(folder / "blob.npy")], out, coeffs=(2, 4), overrides=small, renderer=FakeRenderer()
    )
    return SimpleNamespace(rows=rows, out=out)


def again(volume, out, overrides=small, **options):
    """Sweep with a fresh renderer; returns what it was asked for."""
    renderer = FakeRenderer()
    sweep.run([volume], out, coeffs=(2, 4), overrides=overrides, renderer=renderer, **options)
    return renderer.calls


def test_every_pair_is_rendered_and_the_reference_once(swept):
    assert swept.renderer.calls == [
        ("dual", 8, 10.0),
        ("tfm", 2, 1.0),
        ("tfm", 4, 1.0),
        ("tfm", 2, 10.0),
        ("tfm", 4, 10.0),
    ]


def test_a_row_holds_metrics_settings_and_costs(swept):
    row = swept.rows[1]
    truth = FakeRenderer().image(SimpleNamespace(camera=SimpleNamespace(res=RES)), "dual")
    expected = compare(truth * np.array([0.75, 0.75, 0.75, 1], np.float32), truth)

    assert (row.volume, row.coeffs, row.density_weighting) == ("blob", 4, 1.0)
    assert (row.basis, row.storage, row.map_res, row.map_steps, row.view_steps) == ("dct", "f32", 16, 20, 20)
    assert (row.width, row.height) == RES
    assert (row.ssim, row.psnr) == pytest.approx((expected.ssim, expected.psnr))
    assert (row.lit_ssim, row.lit_psnr) == pytest.approx((expected.lit.ssim, expected.lit.psnr))
    assert row.lit_rmse < row.rmse == pytest.approx(expected.rmse)
    assert (row.seconds_light_pass, row.seconds_view_pass, row.seconds_reference) == (0.25, 1.5, 1.5)
    assert (row.map_bytes, row.device) == (4 * 4 * 16**2, "pretended")


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
    rows = sweep.run([volume], out, coeffs=[2], overrides=small, renderer=FakeRenderer(exact=True))

    assert rows[0].psnr == np.inf
    assert json.loads((out / "sweep.jsonl").read_text().splitlines()[0])["psnr"] is None
    assert ",inf," in (out / "sweep.csv").read_text()
    assert read_rows(out) == rows
    write_report(out)
    assert "| ∞ |" in (out / "sweep.md").read_text()


def test_a_complete_sweep_is_not_rendered_again(swept, volume, out):
    images = sorted((out / "images").glob("*.npy"))

    assert again(volume, out) == []
    assert read_rows(out) == swept.rows
    assert sorted((out / "images").glob("*.npy")) == images
    assert len(images) == 5


def test_more_coefficients_add_rows(swept, volume, out):
    renderer = FakeRenderer()
    rows = sweep.run([volume], out, coeffs=(4, 8), overrides=small, renderer=renderer)

    assert renderer.calls == [("tfm", 8, 1.0), ("tfm", 8, 10.0)]
    assert [(row.coeffs, row.density_weighting) for row in rows] == [(4, 1), (8, 1), (4, 10), (8, 10)]
    assert rows[0] == swept.rows[1]
    assert len(read_rows(out)) == 6


@pytest.mark.parametrize(
    ("fail_at", "remaining"),
    [
        (0, [("dual", 8, 10.0), ("tfm", 2, 1.0), ("tfm", 4, 1.0), ("tfm", 2, 10.0), ("tfm", 4, 10.0)]),
        (1, [("tfm", 2, 1.0), ("tfm", 4, 1.0), ("tfm", 2, 10.0), ("tfm", 4, 10.0)]),
        (3, [("tfm", 2, 10.0), ("tfm", 4, 10.0)]),
    ],
)
def test_an_interrupted_sweep_goes_on(volume, out, fail_at, remaining):
    with pytest.raises(KeyboardInterrupt):
        sweep.run([volume], out, coeffs=(2, 4), overrides=small, renderer=FakeRenderer(fail_at))

    assert len(read_rows(out)) == max(0, fail_at - 1)
    assert again(volume, out) == remaining
    assert len(read_rows(out)) == 4


@pytest.mark.parametrize("torn", [b'{"volume": "bl', b"\0\0\0\0", b"{}\n"])
def test_a_torn_last_line_is_dropped_and_made_again(swept, volume, out, torn):
    whole = (out / "sweep.jsonl").read_bytes().splitlines(keepends=True)
    (out / "sweep.jsonl").write_bytes(b"".join(whole[:-1]) + torn)
    table = (out / "sweep.csv").read_bytes()
    (out / "sweep.csv").write_bytes(table[:-20])

    assert again(volume, out) == [("tfm", 4, 10.0)]
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
    "image": (lambda scene: scene.replace(camera=scene.camera.replace(res=(47, 32))), 5),
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
        monkeypatch.setattr(sweep, "__version__", "999")

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
    sweep.run([volume], out, coeffs=[16], overrides=small, renderer=renderer)

    assert [method for method, *_ in renderer.calls] == ["dual", "tfm", "tfm"]
    np.testing.assert_array_equal(np.load(path), image)


def test_auto_is_swept_as_its_numbers(volume, out):
    def auto(scene):
        scene = small(scene)
        return scene.replace(
            map=scene.map.replace(res="auto", steps="auto"), march=scene.march.replace(steps="auto")
        )

    rows = sweep.run([volume], out, coeffs=(2, 4), overrides=auto, renderer=FakeRenderer())
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


def test_several_inputs_and_equal_names(tmp_path, out):
    inputs = [tmp_path / "a" / "blob.npy", tmp_path / "b" / "blob.npy", tmp_path / "other.npy"]
    for seed, path in enumerate(inputs):
        path.parent.mkdir(exist_ok=True)
        blob(path, seed=seed)

    rows = sweep.run(
        inputs, out, coeffs=[2], density_weightings=[1], overrides=small, renderer=FakeRenderer()
    )

    assert [row.volume for row in rows] == [inputs[0].as_posix(), inputs[1].as_posix(), "other"]
    assert len({row.reference for row in rows}) == 3


def test_progress_never_goes_back_and_ends_at_one(volume, out):
    seen = []
    again(volume, out, progress=lambda stage, fraction: seen.append((stage, fraction)))

    fractions = [fraction for _, fraction in seen]
    assert fractions == sorted(fractions)
    assert (fractions[0], fractions[-1]) == (0, 1)
    assert seen[0][0] == "blob: reference"
    assert ("blob: reference: view pass", 0.1) in seen


def test_overrides_by_key_are_known_before_the_camera_is_placed(volume, out):
    overrides = [("camera.res", [20, 60]), ("map.res", 8)]
    rows = sweep.run([volume], out, coeffs=[2], overrides=iter(overrides), renderer=FakeRenderer())
    again(volume, out, overrides=lambda scene: scene.replace(camera=scene.camera.replace(res=(20, 60))))

    assert (rows[0].width, rows[0].height, rows[0].map_res) == (20, 60, 8)
    # A camera placed for a landscape frame cuts a portrait one off: it is another camera.
    assert read_rows(out)[-1].reference != rows[0].reference


def test_a_dark_reference_is_an_error(volume, out):
    with pytest.raises(SceneError, match="blob: the reference shows nothing"):
        sweep.run([volume], out, overrides=small, renderer=FakeRenderer(alpha=0.0))


def test_impossible_settings_fail_before_rendering(volume, out):
    renderer = FakeRenderer()

    with pytest.raises(SceneError, match="coeffs"):
        sweep.run([volume], out, coeffs=(2, 1000), overrides=small, renderer=renderer)

    assert renderer.calls == []


@pytest.mark.parametrize("empty", ["inputs", "coeffs", "density_weightings"])
def test_nothing_to_sweep(volume, out, empty):
    arguments = {"inputs": [volume], "coeffs": [2], "density_weightings": [1.0], empty: []}

    with pytest.raises(InputError, match="at least one"):
        sweep.run(out=out, renderer=FakeRenderer(), **arguments)


def test_a_file_in_the_folders_place(volume, tmp_path):
    (tmp_path / "taken").write_text("")

    with pytest.raises(InputError, match="taken/images: cannot be made") as caught:
        again(volume, tmp_path / "taken")

    assert "\n" not in str(caught.value)


def test_no_temporary_files_stay(report):
    names = {path.name for path in report.out.iterdir()}

    assert names == {"images", "sweep.jsonl", "sweep.csv", "sweep.md", "sweep.png", "contact_sheet.png"}
    assert not list((report.out / "images").glob(".*"))


def test_content_hash_is_the_same_in_every_process():
    code = "from tfm_cl.sweep import content_hash; print(content_hash({'a': (1, 2.5, 'x', None)}))"
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


def test_report_pictures_are_of_sane_size(report):
    with Image.open(report.out / "sweep.png") as plot, Image.open(report.out / "contact_sheet.png") as sheet:
        plot.load()
        sheet.load()

        assert (plot.format, sheet.format) == ("PNG", "PNG")
        assert 800 < plot.width < 1600
        assert 300 < plot.height < 800
        assert 900 < sheet.width < 1300
        assert 900 < sheet.height < 1600
        colours = {colour for _, colour in plot.convert("RGB").getcolors(1 << 20)}
    assert {(0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00)} <= colours


def test_contact_sheet_shows_darkening_as_blue(report):
    with Image.open(report.out / "contact_sheet.png") as sheet:
        pixels = np.asarray(sheet.convert("RGB")).astype(int)
    blue = pixels[..., 2] - pixels[..., 0]

    # n α = 2 and 4 lie beyond the scale, whose ends (in the colour bar) are about as many each.
    assert np.count_nonzero(blue > 60) > 20 * np.count_nonzero(blue < -60)


def test_table_of_the_report(report):
    lines = (report.out / "sweep.md").read_text().splitlines()
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    rows = [dict(zip(table[0], cells, strict=True)) for cells in table[2:]]

    assert [(row["α"], row["n"]) for row in rows] == [("1", "2"), ("1", "4"), ("10", "2"), ("10", "4")]
    assert [row["SSIM lit"] for row in rows] == [f"{row.lit_ssim:.4f}" for row in report.rows]
    assert rows[0]["light pass / ms"] == "250.0"
    assert rows[0]["speed-up"] == "0.9×"


def test_report_without_some_images(swept, out):
    for key in (swept.rows[0].reference, swept.rows[1].key):
        (out / "images" / f"{key}.npy").unlink()

    write_report(out)

    with Image.open(out / "contact_sheet.png") as sheet:
        sheet.load()


def test_report_of_hostile_names_and_odd_shapes(tmp_path, out):
    path = blob(tmp_path / "$a_{b|*c*$.npy")

    def wide(scene):
        return small(scene).replace(camera=scene.camera.replace(res=(300, 9)))

    sweep.run(
        [path],
        out,
        coeffs=[1],
        density_weightings=["auto"],
        overrides=wide,
        renderer=FakeRenderer(exact=True),
    )

    write_report(out)

    assert r"## $a\_{b\|\*c\*$" in (out / "sweep.md").read_text()
    with Image.open(out / "contact_sheet.png") as sheet:
        assert sheet.width < 1100


def test_report_of_two_sweeps_tells_them_apart(swept, volume, out):
    again(volume, out, overrides=lambda scene: small(scene).replace(medium=Medium(sigma_a=0.5)))
    write_report(out)
    titles = [line for line in (out / "sweep.md").read_text().splitlines() if line.startswith("## ")]

    assert len(set(titles)) == 2
    assert swept.rows[0].reference[:6] in titles[0]


def test_report_of_nothing(tmp_path):
    (tmp_path / "sweep.jsonl").write_text("")

    with pytest.raises(InputError, match="no rows"):
        write_report(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        write_report(tmp_path / "missing")


def test_real_renderer(volume, out):
    with Renderer() as renderer:
        rows = sweep.run(
            [volume], out, coeffs=(2, 12), density_weightings=[10], overrides=small, renderer=renderer
        )
        device = renderer.device_name

    assert rows[0].lit_psnr + 6 < rows[1].lit_psnr < 200
    assert rows[0].lit_ssim < rows[1].lit_ssim <= 1
    assert [row.map_bytes for row in rows] == [4 * 2 * 16**2, 4 * 12 * 16**2]
    assert min(rows[0].seconds_light_pass, rows[0].seconds_view_pass, rows[0].seconds_reference) > 0
    assert rows[0].device == device
