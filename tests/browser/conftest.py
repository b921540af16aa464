import os
import shutil

import pytest


@pytest.fixture(scope="module")
def browser():
    chosen = os.environ.get("TFM_CHROMIUM")
    program = shutil.which(chosen or "chromium")
    if program is None:
        lacking = f"there is no {chosen or 'chromium'}"
        if chosen:
            pytest.fail(f"TFM_CHROMIUM: {lacking}")
        pytest.skip(f"{lacking}; install chromium, or set TFM_CHROMIUM")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as api:
        browser = api.chromium.launch(executable_path=program)
        yield browser
        browser.close()
