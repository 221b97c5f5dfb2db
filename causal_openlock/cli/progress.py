"""How far a comparison is: a bar on a terminal, and lines where the output is kept in a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from causal_openlock.files.escaping import printable

if TYPE_CHECKING:
    from causal_openlock.cli.terminal import Console
    from causal_openlock.experiment.standing import Playing, Standing

Show = Callable[["Standing"], None]
"""Called again and again with how far everything is."""

LINE_EVERY = 25.0
"""Seconds between two lines, give or take one: at least a line every 30 seconds."""
STILL = 60.0
"""Seconds without a step after which a cell is named."""
MOST_NAMED = 3
"""Cells that are named in a line."""


@contextmanager
def shown(name: str, console: Console) -> Iterator[Show]:
    """Shows how far a comparison is, as suits what is written to.

    Args:
        name: What it is called.
        console: Where to write.
    """
    if not console.is_terminal:
        yield Lines(name, partial(console.print, soft_wrap=True, highlight=False, markup=False))
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

        def show(standing: Standing) -> None:
            bar.update(task, completed=standing.share, more=f"{_cells(standing)}{_left(standing)}")
            for line in hanging.news(standing):
                console.print(line, soft_wrap=True, highlight=False, style="yellow", markup=False)

        yield show


class Hanging:
    """Names cells of which nothing is heard: each after a minute, then after two, four, ..."""

    def __init__(self) -> None:
        self._next: dict[str, float] = {}

    def news(self, standing: Standing) -> list[str]:
        """A line for each cell that is to be named now."""
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
    """Says how far a comparison is in lines of text.

    Args:
        name: What it is called.
        say: Writes a line.
        clock: Tells the seconds.
    """

    def __init__(
        self, name: str, say: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._name, self._say, self._clock = name, say, clock
        self._due: float | None = None
        self._over = False
        self._hanging = Hanging()
        self._begun = clock()

    def __call__(self, standing: Standing) -> None:
        """Say it if it is time to."""
        now = self._clock()
        over = standing.done + standing.failed == standing.cells
        if self._due is None or (over and not self._over) or now >= self._due:
            self._due, self._over = now + LINE_EVERY, over
            text = f"{self._name}: {_cells(standing)}"
            if over:
                text += f", in {duration(now - self._begun)}"
            else:
                text += f", {100 * standing.share:.0f}% of the work{_left(standing)}"
                text += _playing(standing.playing)
            self._say(text)
        for line in self._hanging.news(standing):
            self._say(line)


def _cells(standing: Standing) -> str:
    failed = f", {standing.failed} failed" if standing.failed else ""
    return f"{standing.done} of {standing.cells} cells done{failed}"


def _left(standing: Standing) -> str:
    return "" if standing.left is None else f", about {duration(standing.left)} left"


def _playing(those: tuple[Playing, ...]) -> str:
    if not those:
        return ""
    told = [f"{one.cell.in_words} ({100 * one.share:.0f}%)" for one in those[:MOST_NAMED]]
    more = len(those) - MOST_NAMED
    return "; playing " + "; ".join(told) + (f"; and {more} more" if more > 0 else "")


def duration(seconds: float) -> str:
    """So many seconds in words, such as ``45 s``, ``3 min`` or ``2 h 10 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
