"""What axe-core, the checker of accessibility that browsers' own tools use, finds on a page."""

from axe_playwright_python.sync_playwright import Axe

WIDTHS = (390, 1200)
"""Of a telephone and of a desk, in pixels."""


def violations(page):
    """The rules that a page breaks at either width, each with the first place that does."""
    found = []
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 850})
        for rule in Axe().run(page).response["violations"]:
            found.append(f"{rule['id']} at {width} pixels: {rule['nodes'][0]['html'][:200]}")
    return found
