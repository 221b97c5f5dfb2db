"""Photograph the first screen of a report: ``python docs/figures/report_first_screen.py [FOLDER]``.

``docs/example_report.yaml`` is played, in some two minutes of one core; with the folder of its
results nothing is played, and only the report is written anew. Needs Chromium, as tests do.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

import causal_openlock as ol

HERE = Path(__file__).parent
WIDTH, HEIGHT = 1200, 1000


def main() -> None:
    """Play or read, write the report and open it."""
    sys.path.append(str(HERE.parents[1] / "tests"))
    from support.browsers import launch

    experiment = HERE.parent / "example_report.yaml"
    results = ol.open_results(sys.argv[1]) if sys.argv[1:] else ol.compare(experiment)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        results.report(folder)
        browser = launch(playwright)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.goto(Path(folder, "report.html").as_uri())
        page.screenshot(path=HERE / "report_first_screen.png")
        browser.close()


if __name__ == "__main__":
    main()
