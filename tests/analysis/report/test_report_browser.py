"""The report in a real browser: accessible to everybody, and a dozen pages in print.

Chromium, without a display. Where there is none these tests are skipped, except where
``OPENLOCK_BROWSER=required`` says that there must be one, as ``.ci/run`` does.
"""

import os
import re

import pytest
from playwright.sync_api import sync_playwright

from causal_openlock.analysis.report.writing import make_report
from support import browsers
from support.accessibility import violations
from support.paper_play import material, play, same, scattered

pytestmark = pytest.mark.browser

if os.environ.get("OPENLOCK_BROWSER") != "required" and not browsers.installed():
    pytest.skip(browsers.MISSING, allow_module_level=True)

MOST_PAGES = 12


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The report of learners of every kind, with all sections that people's results give it."""
    names = ("perfect", "quick", "slow", "never")
    made = (same(3), scattered(1), scattered(2, 9.0), same(30))
    rows = [row for name, way in zip(names, made, strict=True) for row in play(name, way, 6)]
    path = make_report(material(rows, names), tmp_path_factory.mktemp("browser")).path
    with sync_playwright() as playwright:
        browser = browsers.launch(playwright)
        opened = browser.new_page(viewport={"width": 1200, "height": 850})
        opened.goto(path.as_uri())
        yield opened
        browser.close()


def test_it_prints_on_a_few_pages(page):
    printed = page.pdf(prefer_css_page_size=True)
    assert 1 < len(re.findall(rb"/Type\s*/Page\b", printed)) <= MOST_PAGES


def test_the_first_screen_has_the_answer_and_the_figure(page):
    page.set_viewport_size({"width": 1200, "height": 850})
    figure = page.locator("#results figure .sheet").first.bounding_box()
    assert figure is not None
    assert figure["y"] + figure["height"] < 850
    table = page.locator("#results table").first.bounding_box()
    assert table is not None
    assert table["y"] < 1000


def test_axe_finds_nothing_with_every_fold_open(page):
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert violations(page) == []
