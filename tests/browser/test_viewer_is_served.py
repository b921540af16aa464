"""The viewer as a whole: ``tfm view`` in a process of its own, and browsers that look at it."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import OpenEXR
import pytest
from browser_pages import SECONDS, fetched, until, watched

REPOSITORY = Path(__file__).resolve().parents[2]
PLUME = REPOSITORY / "volumes" / "plume.npz"

SCENE = f"""
[volume]
file = {json.dumps(str(PLUME))}
density_scale = 30.0

[camera]
from = [0.0, 0.2, 4.5]
to = [0.0, 0.0, 0.0]
res = [240, 160]

[[light]]
from = [-1.5, 1.4, 1.0]
to = [0.0, 0.0, 0.0]
cone = 25.0
intensity = [6.0, 6.0, 6.0]

[map]
res = 96

[[solid]]
shape = "plane"
point = [0.0, -1.0, 0.0]
"""

FULL = "document.querySelector('.layer.shown[data-quality=full]') !== null"


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """A viewer's address and folder; interrupted at the end, as by Ctrl-C."""
    folder = tmp_path_factory.mktemp("served")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    command = [sys.executable, "-m", "tfm_cl", "view", "scene.toml", "--no-browser", "--port", "0"]
    with subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            address = process.stdout.readline().strip()
            assert address.startswith("http://127.0.0.1:"), process.stderr.read()
            yield SimpleNamespace(address=address, folder=folder)
            process.send_signal(signal.SIGINT)
            errors = process.communicate(timeout=SECONDS)[1]
            assert "Traceback" not in errors
            assert process.returncode == 128 + signal.SIGINT
        finally:
            process.kill()


@pytest.fixture
def look(browser, served):
    """``look()`` opens the page; at the end, only the server was asked, and nothing complained."""
    opened = []

    def look():
        seen = watched(browser)
        page = seen.page
        opened.append(seen)
        page.goto(served.address)
        until(page, FULL)
        page.evaluate(
            """() => {
              window.costs = [];
              const costs = document.querySelector(".costs");
              const watch = new MutationObserver(() => window.costs.push(costs.textContent));
              watch.observe(costs, { childList: true });
            }"""
        )
        return page

    yield look
    for seen in opened:
        seen.context.close()
        assert set(fetched(seen)) == {served.address}
        assert seen.complaints == []


def settled(page, *, after):
    """Return what pictures cost since the costs were ``after``, when a full one has come."""
    until(page, "(after) => costs.length > after && costs.at(-1).startsWith('full')", after)
    return page.evaluate("(after) => costs.slice(after)", after)


def made_maps(costs):
    """Tell whether any picture had maps made; a full one may find those of the low one before it."""
    return any("no new map" not in cost for cost in costs)


def count(page):
    return page.evaluate("costs.length")


def drag(page, start, by):
    page.mouse.move(*start)
    page.mouse.down()
    for part in np.linspace(0.1, 1, 10):
        page.mouse.move(start[0] + part * by[0], start[1] + part * by[1])
        page.wait_for_timeout(30)
    page.mouse.up()


def field(page, section, key, inside=".number"):
    return page.locator(f'[data-section="{section}"] [data-key="{key}"] {inside}').first


@pytest.mark.slow
def test_a_scene_is_turned_lit_and_saved(look, served):
    page = look()
    stage = page.locator(".layers").bounding_box()
    corner = (stage["x"] + 0.85 * stage["width"], stage["y"] + 0.8 * stage["height"])

    before = count(page)
    drag(page, corner, (-80, 30))
    costs = settled(page, after=before)
    assert any(cost.startswith("moving") for cost in costs)
    assert not made_maps(costs)

    before = count(page)
    red = field(page, "light", "intensity", '[data-axis="r"]')
    red.fill("9")
    red.press("Enter")
    assert not made_maps(settled(page, after=before))

    before = count(page)
    light = page.locator('[data-handle="light.0:from"] .hit').bounding_box()
    drag(page, (light["x"] + light["width"] / 2, light["y"] + light["height"] / 2), (60, 0))
    assert made_maps(settled(page, after=before))

    before = count(page)
    field(page, "map", "basis", "select").select_option("dct")
    assert made_maps(settled(page, after=before))

    for what, name in (("Scene", "seen.toml"), ("EXR", "seen.exr")):
        page.locator(".view .stage").focus()
        page.keyboard.press("Control+s")
        page.get_by_role("button", name=what, exact=True).click()
        page.locator("dialog[open] .text").fill("seen")
        page.keyboard.press("Enter")
        until(page, "(name) => document.querySelector('.message').textContent.includes(name)", name)
    render = [sys.executable, "-m", "tfm_cl", "render", "seen.toml", "-o", "again.exr"]
    subprocess.run(render, cwd=served.folder, check=True)
    again, seen = (
        OpenEXR.File(os.fspath(served.folder / name)).channels()["RGBA"].pixels
        for name in ("again.exr", "seen.exr")
    )
    np.testing.assert_array_equal(again, seen)


@pytest.mark.slow
def test_a_mistake_is_told_and_mended(look):
    page = look()
    cone = field(page, "light", "cone")
    cone.fill("95")
    cone.press("Enter")
    until(page, "!document.querySelector('.alert').hidden")
    assert "cone" in page.locator(".alert").text_content()
    before = count(page)
    cone.fill("30")
    cone.press("Enter")
    settled(page, after=before)
    assert page.locator(".alert").is_hidden()


@pytest.mark.slow
def test_a_phase_function_is_read_from_a_table_in_the_folder(look, served):
    (served.folder / "tables").mkdir()
    (served.folder / "tables" / "cloud.txt").write_text("-1 1\n1 4\n", encoding="utf-8")
    (served.folder / "tables" / "other.txt").write_text("no numbers", encoding="utf-8")
    page = look()
    field(page, "medium", "phase", "select").select_option("table")
    path = page.get_by_label("phase file", exact=True)
    for name in ("cloud.txt", "other.txt"):
        before = count(page)
        page.get_by_role("button", name="phase file: choose a file").click()
        page.get_by_role("button", name="tables").click()
        page.get_by_role("button", name=name).click()
        if name == "cloud.txt":
            settled(page, after=before)
            assert page.locator(".alert").is_hidden()
            assert path.input_value() == "tables/cloud.txt"
    until(page, "!document.querySelector('.alert').hidden")
    assert "line 1 should be a cosine and a value" in page.locator(".alert").text_content()
    until(page, "document.querySelector('[aria-label=\"phase file\"]').value === 'tables/cloud.txt'")


@pytest.mark.slow
def test_the_map_is_compared_and_looked_into(look):
    page = look()
    page.locator(".view .stage").focus()
    page.keyboard.press("d")
    until(page, "document.querySelector('.figures').textContent.includes('PSNR')")
    assert not page.locator(".divider").is_hidden()
    page.keyboard.press("d")
    stage = page.locator(".layers").bounding_box()
    page.keyboard.press("c")
    page.mouse.click(stage["x"] + 0.5 * stage["width"], stage["y"] + 0.45 * stage["height"])
    until(page, "document.querySelectorAll('.plot path.map').length > 0")
    assert page.locator(".plot path.marched").count() > 0
    page.locator(".view .stage").focus()
    page.keyboard.press("m")
    until(
        page, "document.querySelector('.layer.shown')?.getAttribute('aria-label').startsWith('coefficient 0')"
    )


@pytest.mark.slow
def test_each_page_has_its_own_session_and_finds_it_again(look):
    one, other = look(), look()
    cone = field(one, "light", "cone")
    before = count(one)
    cone.fill("18")
    cone.press("Enter")
    settled(one, after=before)
    assert field(other, "light", "cone").input_value() == "25"
    other.close()  # as a tab that is killed: the first goes on
    one.reload()
    until(one, FULL)
    assert field(one, "light", "cone").input_value() == "18"
    one.keyboard.press("Control+z")
    until(one, "document.querySelector('[data-section=light] [data-key=cone] .number').value === '25'")
