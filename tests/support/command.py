"""The command line in this process, without the seconds that a process of its own takes to start.

Workers are not started either: cells are played here. Reports are short unless a test asks for
whole ones. That both are as they should be is tested elsewhere.
"""

import contextlib
import io
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import pytest

from causal_openlock.analysis.report import writing
from causal_openlock.analysis.topic import Section
from causal_openlock.cli import main
from causal_openlock.comparison import progress_bar
from causal_openlock.running import workers


def play_here(patches):
    """Have cells played in this process, and subjects scored and fitted."""
    patches.setattr(workers, "Processes", lambda *_, **__: workers.ThisProcess())
    patches.setattr(workers, "available_cores", lambda: 1)


Reports = Literal["short", "whole"]
"""What reports have: see :func:`report_shortly`."""


def report_shortly(patches, reports="short"):
    """Have reports without figures and sections, unless they are to be whole.

    A whole report takes half a second and more, hundreds of commands write one that no test looks
    at, and ``compare`` has no option to leave it out. Nor does a busy machine say what takes long.
    """
    if progress_bar.FIRST_AFTER >= 1:  # a test about progress makes it shorter
        patches.setattr(progress_bar, "FIRST_AFTER", 3600.0)
    if reports != "whole":
        for part in ("figures_of", "sections_of"):
            patches.setattr(writing, part, lambda *_: [])
        patches.setattr(writing, "learner_pages", lambda *_: Section("learners", "Learners"))


@contextlib.contextmanager
def modules_of(folder):
    """Forget a folder, and the modules that were imported from it, when its test is over."""
    before, path = {*sys.modules}, [*sys.path]
    try:
        yield
    finally:
        sys.path[:] = path
        for name in {*sys.modules} - before:
            where = getattr(sys.modules[name], "__file__", None)
            if where and Path(where).is_relative_to(folder):
                del sys.modules[name]


@dataclass(frozen=True)
class Done:
    """A command that has ended."""

    status: int
    stdout: str
    stderr: str


def at_once(*words, cwd=None, workers=False, reports="short"):
    """Run what follows ``causal-openlock``, perhaps elsewhere, with workers or whole reports."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patches:
        patches.setattr(sys, "argv", ["causal-openlock", *map(str, words)])
        if cwd is not None:
            patches.chdir(cwd)
        if not workers:
            play_here(patches)
        report_shortly(patches, reports)
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                main()
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
    return Done(status, out.getvalue(), err.getvalue())
