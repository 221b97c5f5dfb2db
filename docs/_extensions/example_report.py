"""The report that the page ``example_report`` links to, made while the site is built.

The experiment that ``example_report`` in ``conf.py`` names is played, and its report becomes
``example_report/report.html`` of the site. Where the site has it already, nothing is played: after
a change of the program, ``make clean`` first.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.errors import ExtensionError

NAME = "example_report"
LINK = f'\n<p><a href="{NAME}/report.html"><strong>Read the whole report</strong></a></p>\n'


def add_link(app: Sphinx, page: str, source: list[str]) -> None:
    """Link to the report, which only the site has."""
    if page == NAME:
        source[0] += LINK


def write_report(app: Sphinx, error: Exception | None) -> None:
    """Play the experiment and write its report into the site."""
    path = Path(app.outdir, NAME, "report.html")
    if error or app.builder.format != "html" or path.exists():
        return
    experiment = str(Path(app.confdir, app.config[NAME]))
    with tempfile.TemporaryDirectory() as folder:
        # In a process of its own: what is logged here would be taken for warnings of the site.
        command = [sys.executable, "-m", "causal_openlock", "compare", experiment, "--out", folder]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ExtensionError(f"{experiment} was not played: {done.stderr.strip()}")
        path.parent.mkdir(exist_ok=True)
        shutil.copy(Path(folder, "report.html"), path)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect both with the steps of Sphinx."""
    app.add_config_value(NAME, f"{NAME}.yaml", "html", str)
    app.connect("source-read", add_link)
    app.connect("build-finished", write_report)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
