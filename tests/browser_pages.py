"""What tests of pages in a browser share."""

import time

SECONDS = 120
"""Until something that should happen counts as missing; other tests may keep the machine busy."""


def until(page, expression, argument=None):
    """Wait until an expression holds. Playwright's own way evaluates strings, which the page forbids."""
    deadline = time.monotonic() + SECONDS
    while not page.evaluate(expression, argument):
        assert time.monotonic() < deadline, f"after {SECONDS} seconds still not: {expression}"
        page.wait_for_timeout(20)
