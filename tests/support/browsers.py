"""The browser that the tests of the page are run in: Debian's Chromium, or playwright's own.

``python tests/support/browsers.py`` starts it once and says which it is, or fails and says what is
missing.
"""

import os
import shutil
import sys

from playwright.sync_api import Error, sync_playwright

MISSING = (
    "no browser: install Debian's chromium, or run playwright install chromium, to run the tests "
    "of the page"
)


def chromium():
    """Path of Debian's Chromium, if there is one."""
    return next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)


def installed():
    """Whether there is a browser to start."""
    if chromium() is not None:
        return True
    try:
        with sync_playwright() as playwright:
            launch(playwright).close()
    except Error:
        return False
    return True


def launch(playwright):
    """Start the browser, without a display.

    Raises:
        playwright.sync_api.Error: If there is none, or it cannot be started.
    """
    root = os.name == "posix" and os.geteuid() == 0  # for whom Chromium's sandbox does not start
    return playwright.chromium.launch(
        executable_path=chromium(), args=["--no-sandbox"] if root else []
    )


def main():
    """Start it and say which it is."""
    try:
        with sync_playwright() as playwright:
            browser = launch(playwright)
            said = f"{chromium() or 'playwright'}: Chromium {browser.version}"
            browser.close()
    except Error as error:
        sys.exit(f"{MISSING} ({str(error).strip().splitlines()[0]})")
    print(said)


if __name__ == "__main__":
    main()
