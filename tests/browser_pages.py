"""What tests of pages in a browser share."""

import time
from types import SimpleNamespace

SECONDS = 120
"""Until something that should happen counts as missing; other tests may keep the machine busy."""


def watched(browser, **context):
    """Open a page in a context of its own, and list what it asks for and what it complains of."""
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 800}} | context)
    page = context.new_page()
    page.set_default_timeout(1000 * SECONDS)
    seen = SimpleNamespace(context=context, page=page, requests=[], complaints=[])
    page.on("request", lambda request: seen.requests.append(request.url))
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    return seen


def fetched(seen):
    """Return what a page asked for that it did not have."""
    return [url for url in seen.requests if not url.startswith(("data:", "blob:"))]


def until(page, expression, argument=None):
    """Wait until an expression holds. Playwright's own way evaluates strings, which the page forbids."""
    deadline = time.monotonic() + SECONDS
    while not page.evaluate(expression, argument):
        assert time.monotonic() < deadline, f"after {SECONDS} seconds still not: {expression}"
        page.wait_for_timeout(20)
