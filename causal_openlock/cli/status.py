"""``causal-openlock status``: the status of a comparison that runs here or elsewhere."""

from __future__ import annotations

import time

from causal_openlock.cli.options import ResultsFolder

MOST_LISTED = 20
"""Cells that are listed of each kind."""


def status(folder: ResultsFolder) -> None:
    """Show what of a comparison is done, and the time left.

    Running and failed cells are named. The comparison may run anywhere: on this machine, on a
    cluster, or as shards in a job array.
    """
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.progress_bar import duration
    from causal_openlock.running.progress import status_of
    from causal_openlock.storage.store import LOG, Store
    from causal_openlock.wording import counted

    console = Terminal()
    store = Store(folder)
    experiment = store.experiment()
    if (store.folder / LOG).exists():
        people = counted(len(experiment.files), "person has", "people have")
        console.print_line(f"{people} finished a trial")
        if unwritten := store.unwritten():
            console.print_line(unwritten)
        return
    progress, quiet_cells, failures = status_of(store, experiment)
    waiting = progress.cells - progress.done - progress.failed - len(progress.playing)
    console.print_line(
        f"{experiment.name}: {progress.done} of {progress.cells} cells done, "
        f"{len(progress.playing)} running, {progress.failed} failed, {waiting} waiting; "
        f"{100 * progress.share:.0f}% of the work"
    )
    running = [
        f"{one.cell.in_words}: {100 * one.share:.0f}%, for {duration(one.seconds)}"
        for one in progress.playing
    ]
    quiet = [f"{cell}: no report for {duration(since)}" for cell, since in quiet_cells.items()]
    for head, lines in (
        ("running", running),
        ("begun, and stopped or in a long step", quiet),
        ("failed", failures),
    ):
        if lines:
            console.print_line(f"{head}:")
        for line in lines[:MOST_LISTED]:
            console.print_line(f"  {line}")
        if len(lines) > MOST_LISTED:
            console.print_line(f"  and {len(lines) - MOST_LISTED} more")
    if progress.over:
        again = "; compare with --retry-failed tries the others again" if progress.failed else ""
        console.print_line(f"over{again}")
    elif not progress.playing:
        console.print_line("nothing is running")
    elif progress.left is None:
        console.print_line("the time left is not known yet")
    else:
        then = time.strftime("%Y-%m-%d %H:%M", time.localtime(time.time() + progress.left))
        console.print_line(f"over in about {duration(progress.left)}, at {then}")
