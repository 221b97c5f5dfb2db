"""The progress of a comparison: a bar on a terminal or in a notebook, or lines in a file."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

from causal_openlock.files.escaping import printable

if TYPE_CHECKING:
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.running.progress import Playing, RunProgress

Show = Callable[["RunProgress"], None]
"""Called repeatedly with the progress of all cells."""

LINE_EVERY = 25.0
"""Seconds between two lines."""
FIRST_AFTER = 3.0
"""Seconds after which a long task first names its step."""
STILL = 60.0
"""Seconds without a step after which a cell is reported."""
MOST_NAMED = 3
"""Cells that a line names."""


@contextmanager
def shown(name: str, console: Terminal) -> Iterator[Show]:
    """Show the progress of a comparison of this name on a terminal, or as lines in a file."""
    if not console.is_terminal:
        yield Lines(name, console.print_line)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[more]}", markup=False),
        TimeElapsedColumn(),
        console=console,
    )
    hanging = Hanging()
    with bar:
        task = bar.add_task(printable(name), total=1.0, more="")

        def show(standing: RunProgress) -> None:
            bar.update(task, completed=standing.share, more=f"{_cells(standing)}{_left(standing)}")
            for line in hanging.news(standing):
                console.print_line(line, "yellow")

        yield show


@contextmanager
def shown_steps(name: str) -> Iterator[Callable[[str], None]]:
    """Show on standard error which step of a long task is running.

    On a terminal it is a line that disappears at the end. In a file, it is a line after three
    seconds, and then from time to time.

    Args:
        name: The task's name.

    Yields:
        A function to call with the name of each step when it begins.
    """
    from causal_openlock.comparison.console import Terminal

    console = Terminal(stderr=True)
    if console.is_terminal:
        with console.status(console.render_str(name)) as status:
            yield lambda step: status.update(console.render_str(f"{name}: {step}"))
        return
    steps, over = [""], Event()

    def lines() -> None:
        wait = FIRST_AFTER
        while not over.wait(wait):
            console.print_line(f"{name}: {steps[-1]}")
            wait = LINE_EVERY

    thread = Thread(target=lines, daemon=True)
    thread.start()
    try:
        yield steps.append
    finally:
        over.set()
        thread.join()


@contextmanager
def shown_here(name: str) -> Iterator[Show | None]:
    """Show progress where Python runs: in a notebook, on a terminal, or not at all in a file."""
    if in_notebook():
        yield NotebookBar(name)
        return
    if not sys.stderr.isatty():
        yield None
        return
    from causal_openlock.comparison.console import Terminal

    with shown(name, Terminal(stderr=True)) as show:
        yield show


def in_notebook() -> bool:
    """Whether a notebook's kernel runs this program."""
    if "IPython" not in sys.modules:
        return False
    from IPython.core.getipython import get_ipython

    return hasattr(get_ipython(), "kernel")


class NotebookBar:
    """A bar below the cell that runs a comparison; when all is done, one line."""

    def __init__(self, name: str) -> None:
        from IPython.display import HTML, display

        self._html: Any = HTML
        self._name = name
        self._begun = time.monotonic()
        self._hanging = Hanging()
        self._lines: list[str] = []
        self._shown: Any = display(HTML(self._bar("", 0.0)), display_id=True)  # type: ignore[no-untyped-call]

    def __call__(self, standing: RunProgress) -> None:
        """Show the progress."""
        if standing.over:
            passed = duration(time.monotonic() - self._begun)
            self._shown.update(self._html(escape(f"{_cells(standing)}, in {passed}")))
            return
        self._lines += self._hanging.news(standing)
        more = f"{_cells(standing)}{_left(standing)}"
        self._shown.update(self._html(self._bar(more, standing.share)))

    def _bar(self, more: str, share: float) -> str:
        lines = "".join(f"<div>{escape(line)}</div>" for line in self._lines)
        bar = f'<progress value="{share:.4f}" max="1"></progress>'
        return f"<div>{escape(self._name)} {bar} {escape(more)}</div>{lines}"


class Hanging:
    """Reports cells that take no step: each after a minute, then after two, four, ..."""

    def __init__(self) -> None:
        self._next: dict[str, float] = {}

    def news(self, standing: RunProgress) -> list[str]:
        """A line for each cell that is due."""
        lines = []
        for one in standing.playing:
            due = self._next.get(one.cell.file_name, STILL)
            if one.still < STILL:
                self._next.pop(one.cell.file_name, None)
            elif one.still >= due:
                self._next[one.cell.file_name] = 2 * one.still
                lines.append(f"no step for {duration(one.still)}: learner {one.cell.in_words}")
        return lines


class Lines:
    """Progress of a comparison in lines of text."""

    def __init__(
        self, name: str, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._name, self._say, self._clock = name, say, clock
        self._due: float | None = None
        self._over = False
        self._hanging = Hanging()
        self._begun = clock()

    def __call__(self, standing: RunProgress) -> None:
        """Write a line if it is time to."""
        now = self._clock()
        if self._due is None or (standing.over and not self._over) or now >= self._due:
            self._due, self._over = now + LINE_EVERY, standing.over
            text = f"{self._name}: {_cells(standing)}"
            if standing.over:
                text += f", in {duration(now - self._begun)}"
            else:
                text += f", {100 * standing.share:.0f}% of the work{_left(standing)}"
                text += _playing(standing.playing)
            self._say(text)
        for line in self._hanging.news(standing):
            self._say(line)


def _cells(standing: RunProgress) -> str:
    failed = f", {standing.failed} failed" if standing.failed else ""
    return f"{standing.done} of {standing.cells} cells done{failed}"


def _left(standing: RunProgress) -> str:
    return "" if standing.left is None else f", about {duration(standing.left)} left"


def _playing(those: tuple[Playing, ...]) -> str:
    if not those:
        return ""
    named = [f"{one.cell.in_words} ({100 * one.share:.0f}%)" for one in those[:MOST_NAMED]]
    more = len(those) - MOST_NAMED
    return "; playing " + "; ".join(named) + (f"; and {more} more" if more > 0 else "")


def duration(seconds: float) -> str:
    """Seconds in words, such as ``45 s``, ``3 min`` or ``2 h 10 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
