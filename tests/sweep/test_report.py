"""The report of a sweep, as a file; `tests/browser` opens it."""

import base64
import dataclasses
import hashlib
import io
import json
import re
import subprocess
import sys
import zipfile
from html.parser import HTMLParser
from importlib.resources import files
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from sweep_folder import CONVERGED, REFERENCE, RES, key, make_folder, picture, row

from tfm_cl.errors import InputError
from tfm_cl.metrics import REC709, compare, display_rgb
from tfm_cl.sweep import written as sweep_report
from tfm_cl.sweep.report import pictures
from tfm_cl.sweep.report.groups import grouped
from tfm_cl.sweep.report.page import LIMIT, page
from tfm_cl.sweep.run import BUDGETS, equal_bytes, read_rows

REPOSITORY = Path(__file__).resolve().parents[2]

HOSTILE = "</script><script>document.title='owned'</script><img src=x onerror=alert(1)>&amp;|*_`\"'\u2028"

EIGHT_BITS = 0.5 / 255
"""Rounding of a display value, 0 to 1."""

COMPANDED = 2 / 127
"""Rounding of √|d| to a 127th, at most halfway, for |d| ≤ 1: (v + ε)² - v² ≤ 2 ε v + ε²."""


class Page(HTMLParser):
    """What a browser would make of the markup: elements in order, and the text of scripts."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.elements, self.scripts, self.attributes, self.title = [], [], [], ""
        self._inside = None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append(tag)
        self.attributes += [(tag, *pair) for pair in attrs]
        self._inside = tag
        if tag == "script":
            self.scripts.append((dict(attrs), ""))

    def handle_endtag(self, _tag):
        self._inside = None

    def handle_data(self, data):
        if self._inside == "script":
            attributes, text = self.scripts[-1]
            self.scripts[-1] = attributes, text + data
        elif self._inside == "title":
            self.title += data

    def json(self, name):
        return next(json.loads(text) for attributes, text in self.scripts if attributes.get("id") == name)


def written(out):
    sweep_report.write(out)
    return Page((out / "report.html").read_text(encoding="utf-8"))


def decode(encoded):
    with PIL.Image.open(io.BytesIO(base64.b64decode(encoded)), formats=["PNG"]) as image:
        return np.asarray(image)


def expand(grey):
    """What the page makes of an error picture."""
    v = (grey.astype(float) - 128) / 127
    return np.sign(v) * v**2


@pytest.fixture
def rows():
    return [
        *(row(n) for n in (1, 2, 4, 8)),
        *(row(n, basis="klt", target="optical-depth", key=key(100 + n)) for n in (2, 4)),
    ]


@pytest.fixture
def out(tmp_path, rows):
    return make_folder(tmp_path / "out", rows)


def test_it_writes_two_files_whole(out):
    before = {path.name for path in out.iterdir()}

    sweep_report.write(out)

    assert {path.name for path in out.iterdir()} - before == {"report.html", "sweep.md"}


def test_the_page_loads_nothing(out):
    parsed = written(out)

    assert not {"iframe", "object", "embed", "base", "form"} & set(parsed.elements)
    for tag, name, value in parsed.attributes:
        if name in {"src", "srcset", "data", "action", "poster"}:
            pytest.fail(f"<{tag} {name}={value}>")
        if name == "href":
            assert value.startswith(("#", "data:"))
    style = (files("tfm_cl.sweep.report") / "assets" / "page.css").read_text(encoding="utf-8")
    assert "url(" not in style
    assert "@import" not in style


def test_only_the_pages_own_scripts_may_run(out):
    parsed = written(out)
    (policy,) = (
        value
        for tag, name, value in parsed.attributes
        if (tag, name) == ("meta", "content") and "default-src" in value
    )
    code = [text for attributes, text in parsed.scripts if not attributes]
    hashes = [base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in code]

    assert len(code) == 2
    assert re.search(r"script-src ([^;]*);", policy)[1].split() == [f"'sha256-{value}'" for value in hashes]
    assert policy.startswith("default-src 'none';")


def test_hostile_names_stay_text(tmp_path, rows):
    plain = written(make_folder(tmp_path / "plain", rows))
    changes = dict.fromkeys(("volume", "device", "version", "range"), HOSTILE)
    hostile = [
        dataclasses.replace(item, **changes, basis=HOSTILE + item.basis, target=HOSTILE + item.target)
        for item in rows
    ]
    parsed = written(make_folder(tmp_path / "hostile", hostile))

    assert parsed.elements == plain.elements
    assert parsed.title == "Sweep: " + HOSTILE
    (group,) = parsed.json("data")["groups"]
    assert group["title"] == HOSTILE
    assert {item["basis"] for item in group["rows"]} == {HOSTILE + "dct", HOSTILE + "klt"}
    table = (tmp_path / "hostile" / "sweep.md").read_text(encoding="utf-8")
    assert "<" not in table.replace(r"\<", "")
    assert {line.replace(r"\|", "").count("|") for line in table.splitlines() if line.startswith("| ")} == {
        5,
        21,
    }


def test_figures_json_cannot_say(tmp_path):
    endless = {
        name: float("inf")
        for name in ("psnr", "lit_psnr", "converged_psnr", "converged_lit_psnr", "lit_rmse")
    }
    rows = [
        row(2, **endless, flip=None),
        row(4, converged=None, **dict.fromkeys(("converged_lit_rmse", "converged_lit_psnr"))),
        row(8, t_error=float("nan")),
    ]
    out = make_folder(tmp_path / "out", rows)
    (group,) = grouped(rows)

    exact, without, unknown = Page(page([group], out)).json("data")["groups"][0]["rows"]
    sweep_report.write(out)
    table = (out / "sweep.md").read_text(encoding="utf-8")

    assert (exact["psnr"], exact["lit_rmse"], exact["flip"]) == ("inf", "inf", None)
    assert (without["converged_lit_rmse"], unknown["t_error"]) == (None, None)
    assert "∞" in table
    assert "| – |" in table


def test_marks_are_the_sweeps_own(out, rows):
    (group,) = written(out).json("data")["groups"]
    best = equal_bytes(rows)["smoke"]
    expected = {item.key: [budget for budget in BUDGETS if item in best[budget].values()] for item in rows}

    assert {item["key"]: item["budgets"] for item in group["rows"]} == expected
    assert any(expected.values())


def test_labels_name_what_varies():
    rows = [
        row(2),
        row(2, density_weighting="auto", key=key(20)),
        row(2, density_weighting=1.0, key=key(21)),
        row(2, basis="klt", range="trimmed", map_res=32, key=key(22)),
    ]
    (group,) = grouped(rows)

    assert [group.variant(item) for item in group.rows] == ["α 1", "α 10", "α auto", ""]
    assert group.varying == ["density_weighting", "range", "map_res"]
    assert group.settings == (
        "60×40 pixels, 30 view and 20 light steps, transmittance, l2 fit, interpolate, f32"
    )


def test_two_scenes_of_one_volume_are_told_apart(tmp_path):
    rows = [
        row(2),
        row(2, reference="b" * 24, key=key(20)),
        row(2, volume="fog", reference="d" * 24, key=key(21)),
    ]
    titles = [group["title"] for group in written(make_folder(tmp_path / "out", rows)).json("data")["groups"]]

    assert titles == ["smoke [aaaaaa]", "smoke [bbbbbb]", "fog"]


def test_pictures_show_the_lit_part_as_it_is(out):
    encoded = written(out).json("pictures")
    reference, image = picture(1.0), picture(1 - 0.5 / 4)
    white = np.percentile(reference[..., :3] @ REC709, 99.9)
    lit = reference[..., 3] > 0

    shown = decode(encoded[key(4)])
    height, width = shown.shape[:2]
    assert (height, width) < RES[::-1]
    top, left = (shown.any(axis=(1, 2)).argmax(), shown.any(axis=(0, 2)).argmax())
    y, x = np.argwhere(lit)[0] - (top, left)
    window = slice(y, y + height), slice(x, x + width)

    expected = display_rgb(image, white)[window]
    np.testing.assert_allclose(shown / 255, expected, rtol=0, atol=EIGHT_BITS * (1 + 1e-3))
    assert lit[window].sum() == lit.sum()
    errors = (display_rgb(image, white) - display_rgb(reference, white))[window] @ REC709
    np.testing.assert_allclose(
        expand(decode(encoded[f"{key(4)}-{REFERENCE}"])), errors, rtol=0, atol=COMPANDED * 0.5
    )
    assert errors.min() < -0.03


def test_errors_against_the_converged_one_add_up(out):
    encoded = written(out).json("pictures")
    shown, converged = (decode(encoded[name]) / 255 @ REC709 for name in (key(2), CONVERGED))

    total = expand(decode(encoded[f"{key(2)}-{REFERENCE}"])) + expand(
        decode(encoded[f"{REFERENCE}-{CONVERGED}"])
    )

    np.testing.assert_allclose(total, shown - converged, rtol=0, atol=COMPANDED + 2 * EIGHT_BITS)
    assert total.min() < -0.05


def test_the_dual_march_is_measured_against_the_converged_one(out):
    (group,) = written(out).json("data")["groups"]
    found = compare(picture(1.0), picture(0.98))

    assert group["dual"]["converged_lit_rmse"] == found.lit.rmse > 0
    assert group["dual"]["converged_psnr"] == found.psnr


def test_pictures_get_smaller_never_larger(tmp_path, monkeypatch):
    small, large = (50, 30), (900, 500)
    rows = [
        row(2, width=small[0], height=small[1]),
        row(
            2, width=large[0], height=large[1], volume="fog", reference="b" * 24, converged=None, key=key(20)
        ),
    ]
    out = make_folder(tmp_path / "out", rows)
    found = pictures.pictures(grouped(rows), out, LIMIT)

    assert max(decode(found.encoded[key(2)]).shape) <= small[0]
    # The lit part is half as wide, and its margin: it needs no reduction.
    assert 450 < max(decode(found.encoded[key(20)]).shape) <= 640
    monkeypatch.setattr(pictures, "SIDES", (200,))
    found = pictures.pictures(grouped(rows), out, LIMIT)
    assert 150 < max(decode(found.encoded[key(20)]).shape) <= 200
    assert max(decode(found.encoded[key(2)]).shape) <= small[0]


@pytest.fixture
def noisy(tmp_path, rng):
    """A folder whose pictures cannot be compressed."""
    rows = [row(n, width=700, height=700) for n in range(1, 13)]
    noise = {
        item.key: np.concatenate(
            [rng.uniform(0, 1, (700, 700, 3)), np.ones((700, 700, 1))], axis=2, dtype=np.float32
        )
        for item in rows
    }
    noise[REFERENCE] = noise[rows[0].key]
    return make_folder(tmp_path / "out", rows, noise)


@pytest.mark.quick("7-True")
@pytest.mark.parametrize(("megabytes", "some_left_out"), [(12, False), (7, True)])
def test_the_file_keeps_to_its_limit(noisy, megabytes, some_left_out):
    text = page(grouped(read_rows(noisy)), noisy, limit=megabytes * 10**6)
    parsed = Page(text)
    shown, (group,) = parsed.json("pictures"), parsed.json("data")["groups"]
    left_out = [item for item in group["rows"] if item["picture"] == "left out"]

    assert len(text.encode()) <= megabytes * 10**6
    assert all((item["key"] in shown) == (item["picture"] is None) for item in group["rows"])
    assert max(decode(shown[REFERENCE]).shape) < 700
    assert bool(left_out) == some_left_out
    # What is best at equal bytes goes first, though smaller maps come before it in the table.
    assert not any(item["budgets"] for item in left_out)
    assert not some_left_out or left_out[0]["coeffs"] < 8


@pytest.mark.parametrize("damage", ["missing", "cut short", "another size"])
def test_images_that_are_not_there(out, damage):
    path = out / "images" / f"{key(2)}.npy"
    if damage == "missing":
        path.unlink()
    elif damage == "cut short":
        path.write_bytes(path.read_bytes()[:-9])
    else:
        np.save(path, picture(1.0)[1:])

    parsed = written(out)

    (group,) = parsed.json("data")["groups"]
    assert {item["key"] for item in group["rows"] if item["picture"] == "missing"} == {key(2)}
    assert key(2) not in parsed.json("pictures")
    assert key(4) in parsed.json("pictures")


def test_no_references(out):
    for name in (REFERENCE, CONVERGED):
        (out / "images" / f"{name}.npy").unlink()

    parsed = written(out)

    assert all("-" not in name for name in parsed.json("pictures"))
    assert parsed.json("data")["groups"][0]["dual"] is None
    assert decode(parsed.json("pictures")[key(2)]).shape == (*RES[::-1], 3)


def test_only_the_converged_reference(out):
    (out / "images" / f"{REFERENCE}.npy").unlink()

    encoded = written(out).json("pictures")

    assert {CONVERGED, f"{key(2)}-{CONVERGED}"} <= set(encoded)


def test_curves_are_those_of_the_rows(out, rows):
    (group,) = written(out).json("data")["groups"]
    curves = group["curves"]

    assert (curves["u"], curves["v"]) == (0.25, 0.75)
    assert set(curves["values"]) == {item.key for item in rows}
    np.testing.assert_allclose(
        np.subtract(curves["values"][key(4)], curves["exact"]), 0.1 / 4, rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("damage", ["missing", "not JSON", "of other rows", "a folder"])
def test_curves_that_are_not_there(out, damage):
    path = out / "curves" / f"{REFERENCE}.json"
    text = path.read_text(encoding="utf-8")
    path.unlink()
    if damage == "not JSON":
        path.write_text(text[:-1], encoding="utf-8")
    elif damage == "of other rows":
        path.write_text(re.sub(r'"key": "[0-9a-f]{3}', '"key": "fff', text), encoding="utf-8")
    elif damage == "a folder":
        path.mkdir()

    assert written(out).json("data")["groups"][0]["curves"] is None


def test_tables_hold_every_row(out, rows):
    sweep_report.write(out)
    lines = (out / "sweep.md").read_text(encoding="utf-8").splitlines()
    tables = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    at = [index for index, cells in enumerate(tables) if cells[0] == "basis"]
    equal = tables[at[0] : at[1]]
    full = [dict(zip(tables[at[1]], cells, strict=True)) for cells in tables[at[1] + 2 :]]

    assert equal[0] == ["basis", "16 bytes", "24 bytes", "40 bytes"]
    assert equal[2:] == [
        ["dct", "**28.0** 2.50 % (n = 2)", "**36.0** 1.25 % (n = 4)", "**52.0** 0.62 % (n = 8)"],
        ["klt", "**28.0** 2.50 % (n = 2)", "**36.0** 1.25 % (n = 4)", "**36.0** 1.25 % (n = 4)"],
    ]
    assert [(line["basis"], line["n"]) for line in full] == [
        *(("dct", n) for n in "1248"),
        *(("klt", n) for n in "24"),
    ]
    assert len(full) == len(rows)
    assert full[1]["target"] == "transmittance"
    assert full[1]["bytes per texel"] == "16"
    assert full[1]["error of T / %"] == "2.50"
    assert full[1]["PSNR lit converged / dB"] == "28.0"
    assert full[1]["RMSE lit converged / %"] == "25.00"
    assert full[1]["FLIP"] == "0.1250"
    assert full[1]["speed-up"] == "9.4×"


def test_no_seconds_no_speed_up(tmp_path):
    out = make_folder(tmp_path / "out", [row(2, seconds_light_pass=0.0, seconds_view_pass=0.0)])
    sweep_report.write(out)

    assert "| – | 0.0 |" in (out / "sweep.md").read_text(encoding="utf-8")


def test_nothing_to_report(tmp_path):
    (tmp_path / "sweep.jsonl").write_text("")

    with pytest.raises(InputError, match=r"sweep\.jsonl: holds no rows to report on"):
        sweep_report.write(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        sweep_report.write(tmp_path / "missing")


@pytest.mark.slow
def test_the_page_travels_in_the_wheel(tmp_path):
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "wheel", "--no-deps", "-w", str(tmp_path), str(REPOSITORY)], check=True)
    (wheel,) = tmp_path.glob("tfm_cl-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    assets = REPOSITORY / "tfm_cl" / "sweep" / "report" / "assets"

    assert {path.relative_to(REPOSITORY).as_posix() for path in assets.iterdir()} <= set(names)
    assert len(list(assets.iterdir())) > 5


def test_tables_for_latex(tmp_path):
    rows = [row(2), row(4), row(8, basis="klt", density_weighting="auto")]
    make_folder(tmp_path, rows)
    sweep_report.write(tmp_path, latex=True)
    text = (tmp_path / "sweep.tex").read_text(encoding="utf-8")

    lines = [line.strip() for line in text.splitlines() if " & " in line]
    assert lines[0].startswith(r"basis & $\alpha$ & n & bytes per texel & error of T / \% & SSIM lit")
    assert lines[1].startswith(r"dct & 10 & 2 & 16 & 2.50 & 0.9375 & 28.0 & 25.00 & 10.0 & 22.0 &")
    assert len(lines) == 1 + len(rows)
    assert len({line.count("&") for line in lines}) == 1
    assert text.count(r"\begin{") == text.count(r"\end{") == 2


def test_names_from_files_are_no_latex(tmp_path):
    make_folder(tmp_path, [row(2, volume="a_b\\input{/etc/passwd}%$&#~^\n")])
    sweep_report.write(tmp_path, latex=True)
    (caption,) = re.findall(r"caption\{(.*)\}", (tmp_path / "sweep.tex").read_text(encoding="utf-8"))

    shown = r"a\_b\textbackslash{}input\{/etc/passwd\}\%\$\&\#\textasciitilde{}\textasciicircum{} :"
    assert caption.startswith(shown)


@pytest.mark.slow
def test_figures_for_papers(tmp_path):
    rows = [row(2), row(4), row(8, basis="klt")]
    make_folder(tmp_path, [*rows, row(3, volume="../fog", reference="b" * 24)])
    sweep_report.write(tmp_path, figures=("svg", "pdf"))
    names = {path.name for path in (tmp_path / "figures").iterdir()}

    kinds = [f"{what}.{form}" for what in ("psnr", "rmse", "ray") for form in ("svg", "pdf")]
    assert names == {f"{name}-{kind}" for name in ("smoke", "fog") for kind in kinds}
    drawn = (tmp_path / "figures" / "smoke-psnr.svg").read_text(encoding="utf-8")
    assert all(words in drawn for words in ("bytes per texel", "PSNR lit / dB", ">dct<", ">klt<"))
    assert (tmp_path / "figures" / "smoke-ray.pdf").read_bytes().startswith(b"%PDF")
    sweep_report.write(tmp_path, figures=("svg",))
    assert (tmp_path / "figures" / "smoke-psnr.svg").read_text(encoding="utf-8") == drawn


def test_figures_without_matplotlib(tmp_path, monkeypatch):
    make_folder(tmp_path, [row(2)])
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(InputError, match="drawing figures needs matplotlib: pip install"):
        sweep_report.write(tmp_path, figures=("svg",))
