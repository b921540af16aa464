"""Photograph the viewer for README and docs, in Chromium: ``python scripts/viewer_picture.py``."""

import shutil
import subprocess
import sys
import time
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
SCENE, PICTURE = ROOT / "volumes" / "cumulus.toml", ROOT / "docs" / "figures" / "viewer.png"
SECONDS = 120


def wait(page: Page, text: str) -> None:
    """Wait until the page says something."""
    deadline = time.monotonic() + SECONDS
    while text not in page.inner_text("body"):
        if time.monotonic() > deadline:
            sys.exit(f"{page.url}: it does not say '{text}'")
        page.wait_for_timeout(20)


def photograph() -> None:
    """Show a scene, wait for its full picture, and keep what the browser shows."""
    command: list[str | Path] = [Path(sys.executable).with_name("tfm"), "view", SCENE, "--no-browser"]
    command += ["--port", "0", "--res", "960x540"]
    with (
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as viewer,  # noqa: S603 - ours
        sync_playwright() as api,
    ):
        address = viewer.stdout.readline().strip() if viewer.stdout else ""
        browser = api.chromium.launch(executable_path=shutil.which("chromium"))
        page = browser.new_page(viewport={"width": 1280, "height": 720})
        page.goto(address)
        wait(page, "full 960")
        page.mouse.move(400, 400)
        page.mouse.down()
        page.mouse.move(420, 400, steps=4)  # what is compiled by now shows what a picture takes
        page.mouse.up()
        wait(page, "moving")
        wait(page, "full 960")
        page.wait_for_timeout(500)
        page.screenshot(path=PICTURE)
        browser.close()
        viewer.terminate()
    print(PICTURE)


if __name__ == "__main__":
    photograph()
