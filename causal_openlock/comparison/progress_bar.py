"""The progress of a comparison: a bar on a terminal or in a notebook, or lines in a file."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from threading import Event, Thread
from typing import TYPE_CHECKING

from causal_openlock.files.escaping import printable
from causal_openlock.wording import some

if TYPE_CHECKING:
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.running.progress import RunProgress

Show = Callable[["RunProgress"], None]  #: called repeatedly with the progress of all cells
Say = Callable[[str], None]  #: prints a line
LINE_EVERY = 25.0  #: seconds between two lines
FIRST_AFTER = 3.0  #: seconds after which a long task first names its step
AT_ONCE = 0.02  #: seconds; parts that follow each other faster were stored by an earlier run
STILL = 60.0  #: seconds without a step after which a cell is reported
MOST_NAMED = 3  #: cells that a line names


@contextmanager
def shown(name: str, console: Terminal) -> Iterator[Show]:
    """Show the progress of a comparison of this name, and which of its cells take no steps."""
    if console.is_jupyter:
        yield naming_still_cells(notebook_bar(name), console.print_line)
    elif console.is_terminal:
        with terminal_bar(name, console) as show:
            yield naming_still_cells(show, console.print_line)
    else:
        yield naming_still_cells(lines(name, console.print_line), console.print_line)


@contextmanager
def shown_steps(name: str) -> Iterator[Say]:
    """Show on standard error which step of a long task is running; yield what begins a step.

    On a terminal it is a line that disappears at the end. In a file, it is a line after three
    seconds, and then from time to time.
    """
    from causal_openlock.comparison.console import Terminal

    console = Terminal(stderr=True)
    if console.is_terminal:
        with console.status(console.render_str(name)) as status:
            yield lambda step: status.update(console.render_str(f"{name}: {step}"))
        return
    steps, over = [""], Event()

    def print_lines() -> None:
        wait = FIRST_AFTER
        while not over.wait(wait):
            console.print_line(f"{name}: {steps[-1]}")
            wait = LINE_EVERY

    thread = Thread(target=print_lines, daemon=True)
    thread.start()
    try:
        yield steps.append
    finally:
        over.set()
        thread.join()


def counting(begin: Say, what: str) -> Callable[[int, int], None]:
    """Show how many parts of a task are done, and the time left at the pace so far.

    Parts at the beginning that take no time were done before. ``begin`` is from
    :func:`shown_steps`; ``what`` follows the numbers: ``parts are scored``.
    """
    begun, before = 0.0, 0

    def report(done: int, total: int) -> None:
        nonlocal begun, before
        now = time.monotonic()
        if now - begun < AT_ONCE or not before:
            begun, before = now, done
        left = (now - begun) * (total - done) / max(done - before, 1)
        more = f", about {duration(left)} left" if left >= 1.0 else ""
        begin(f"{done} of {total} {what}{more}")

    return report


@contextmanager
def terminal_bar(name: str, console: Terminal) -> Iterator[Show]:
    """A bar on a terminal, below whatever else is printed."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    bar = Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.fields[more]}", markup=False),
        TimeElapsedColumn(),
        console=console,
    )
    with bar:
        task = bar.add_task(printable(name), total=1.0, more="")
        yield lambda progress: bar.update(
            task, completed=progress.share, more=f"{_cells(progress)}{_left(progress)}"
        )


def notebook_bar(name: str) -> Show:
    """A bar below the cell that runs a comparison; when all is done, one line."""
    from IPython.display import HTML, display

    begun = time.monotonic()
    output = display(HTML(escape(name)), display_id=True)  # type: ignore[no-untyped-call]

    def show(progress: RunProgress) -> None:
        if progress.over:
            text = escape(f"{_cells(progress)}, in {duration(time.monotonic() - begun)}")
        else:
            bar = f'<progress value="{progress.share:.4f}" max="1"></progress>'
            text = f"{escape(name)} {bar} {escape(_cells(progress) + _left(progress))}"
        output.update(HTML(f"<div>{text}</div>"))  # type: ignore[no-untyped-call]

    return show


def lines(name: str, say: Say, clock: Callable[[], float] = time.monotonic) -> Show:
    """A line of text from time to time, and one at the end."""
    begun = due = clock()
    ended = False

    def show(progress: RunProgress) -> None:
        nonlocal due, ended
        if ended or not (progress.over or clock() >= due):
            return
        due, ended = clock() + LINE_EVERY, progress.over
        more = f"{100 * progress.share:.0f}% of the work{_left(progress)}"
        if ended:
            more = f"in {duration(clock() - begun)}"
        elif playing := [f"{one.cell.in_words} ({one.share:.0%})" for one in progress.playing]:
            more += f"; playing {some(playing, MOST_NAMED)}"
        say(f"{name}: {_cells(progress)}, {more}")

    return show


def naming_still_cells(show: Show, say: Say) -> Show:
    """Show the progress, and name each cell once that has taken no step for a minute."""
    named: set[str] = set()

    def show_and_name(progress: RunProgress) -> None:
        show(progress)
        for report in progress.playing:
            if report.still >= STILL and report.cell.file_name not in named:
                named.add(report.cell.file_name)
                say(f"no step for {duration(report.still)}: learner {report.cell.in_words}")

    return show_and_name


def _cells(progress: RunProgress) -> str:
    failed = f", {progress.failed} failed" if progress.failed else ""
    return f"{progress.done} of {progress.cells} cells done{failed}"


def _left(progress: RunProgress) -> str:
    return "" if progress.left is None else f", about {duration(progress.left)} left"


def duration(seconds: float) -> str:
    """Seconds in words, such as ``45 s``, ``3 min`` or ``2 h 10 min``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 90:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60} min"
