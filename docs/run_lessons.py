"""Run the lessons and store what they put out: ``make lessons``.

Where a repository is read, HTML with drawings or frames is shown without them, so it is stored as
a picture, as a browser draws it. What differs from run to run, such as times, is left out.
A hash of the code that ran is stored too; a test compares it with the code that is there.
"""

from __future__ import annotations

import argparse
import base64
import hashlib
import io
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image
from playwright.sync_api import Page, ViewportSize, sync_playwright

ROOT = Path(__file__).parent.parent
sys.path.append(str(ROOT / "tests"))

from support.browsers import launch  # noqa: E402

WIDTH = 760
"""Pixels of a picture at most, about the width of a notebook's column."""
CARD, FRAME = ViewportSize(width=WIDTH, height=600), ViewportSize(width=1100, height=900)
"""What the browser has for a drawing, and for a page in a frame, which is then made smaller."""
STYLE = """\
<style>
  main { font: 14px sans-serif; width: fit-content }
  main:has(iframe) { width: 100% }
  iframe { box-sizing: border-box; height: 800px !important }
</style>
"""
COLOURS = 64
A_CELL = 1200
"""Seconds that a cell may take, on a busy machine."""
PROFILE = """\
c = get_config()
c.InlineBackend.print_figure_kwargs = {"bbox_inches": "tight", "dpi": 90}
c.IPKernelApp.exec_lines = [
    "from causal_openlock.comparison import progress_bar",
    "progress_bar.in_notebook = lambda: False  # no bars, no widgets",
    "del progress_bar",
]
"""


def code_hash(notebook: Any) -> str:
    """Return the hash of a notebook's code, which is stored with its outputs."""
    code = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return hashlib.sha256("\0".join(code).encode()).hexdigest()[:16]


def run(path: Path, page: Page) -> None:
    """Run a lesson in a kernel of its own and write it with its outputs."""
    notebook = nbformat.read(path, as_version=4)
    kept = dict(notebook.metadata)
    with tempfile.TemporaryDirectory() as folder:
        profile = Path(folder) / "profile_default"
        profile.mkdir()
        (profile / "ipython_kernel_config.py").write_text(PROFILE, encoding="utf-8")
        os.environ["IPYTHONDIR"] = folder
        resources = {"metadata": {"path": folder}}
        NotebookClient(
            notebook,
            timeout=A_CELL,
            record_timing=False,
            coalesce_streams=True,
            resources=resources,
        ).execute()
    notebook.metadata = {**kept, "code_hash": code_hash(notebook)}
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            tidy(output, page)
    nbformat.write(notebook, path)


def tidy(output: Any, page: Page) -> None:
    """Draw what has drawings or frames, and leave out times and folders."""
    if output.output_type == "stream":
        output.text = same_each_time(output.text)
        return
    data = output.data
    data["text/plain"] = same_each_time(data["text/plain"])
    html = data.get("text/html", "")
    if "<svg" in html or "<iframe" in html:
        del data["text/html"]
        framed = "<iframe" in html
        page.set_viewport_size(FRAME if framed else CARD)
        page.set_content(f"{STYLE}<main>{html}</main>")
        drawn = page.locator("iframe" if framed else "main").screenshot()
        data["image/png"] = base64.b64encode(drawn).decode()
    if "image/png" in data:
        data["image/png"] = smaller(data["image/png"])


def same_each_time(text: str) -> str:
    """Leave the time out of ``Ran 9 tests in 0.412s``, and the folders out of a path."""
    return re.sub(r"(?<![\w.<])/(?:[\w.-]+/)+", "", re.sub(r" in [\d.]+s\b", "", text))


def smaller(picture: str) -> str:
    """Return a PNG with few colours and without metadata, in base64."""
    image = Image.open(io.BytesIO(base64.b64decode(picture))).convert("RGB")
    image.thumbnail((WIDTH, image.height))
    small = io.BytesIO()
    image.quantize(COLOURS, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(
        small, "PNG", optimize=True
    )
    return base64.b64encode(small.getvalue()).decode()


def main() -> None:
    """Run all lessons, or those whose numbers are given."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("number", nargs="*", type=int, help="lessons to run; by default all")
    wanted = parser.parse_args().number
    with sync_playwright() as playwright:
        browser = launch(playwright)
        page = browser.new_page()
        for path in sorted((ROOT / "notebooks").glob("[0-9]*.ipynb")):
            if not wanted or int(path.name[:2]) in wanted:
                run(path, page)
                print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")
        browser.close()


if __name__ == "__main__":
    main()
