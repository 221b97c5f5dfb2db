"""The command line in this process, without the seconds that a process of its own takes to start.

Workers are not started either: cells are played here. That they are as they should be is tested
elsewhere.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from causal_openlock.cli import main
from causal_openlock.contract.registry import _learner_class
from causal_openlock.experiment import runner
from causal_openlock.experiment.workers import Given


class AtOnce(Executor):
    """Plays cells where it is asked to, which is faster than to start processes for a few."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Do it now."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


@contextlib.contextmanager
def _at_once(executor: Executor | None, workers: int) -> Iterator[Given]:
    yield Given(executor or AtOnce())


def play_here(patches: pytest.MonkeyPatch) -> None:
    """Have cells played in this process."""
    patches.setattr(runner, "crew", _at_once)


@contextlib.contextmanager
def modules_of(folder: Path) -> Iterator[None]:
    """Forget the modules that were imported from a folder when its test is over."""
    before = {*sys.modules}
    _learner_class.cache_clear()  # another test may have a learner of the same name
    try:
        yield
    finally:
        for name in {*sys.modules} - before:
            where = getattr(sys.modules[name], "__file__", None)
            if where and Path(where).is_relative_to(folder):
                del sys.modules[name]
        _learner_class.cache_clear()


@dataclass(frozen=True)
class Done:
    """A command that has ended."""

    status: int
    stdout: str
    stderr: str


def at_once(*words: object, cwd: Path | None = None, workers: bool = False) -> Done:
    """Run the command line.

    Args:
        words: What follows ``causal-openlock``.
        cwd: Where; by default here.
        workers: Whether processes are started to play in.
    """
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patches:
        patches.setattr(sys, "argv", ["causal-openlock", *map(str, words)])
        if cwd is not None:
            patches.chdir(cwd)
        if not workers:
            play_here(patches)
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                main()
            status = 0
        except SystemExit as end:
            status = int(end.code or 0)
    return Done(status, out.getvalue(), err.getvalue())
