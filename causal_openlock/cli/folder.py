"""``causal-openlock status``, ``export`` and ``bundle``: what to do with a results folder."""

from __future__ import annotations

import time
from typing import Annotated

import typer

from causal_openlock.cli.options import Output, ResultsFolder
from causal_openlock.cli.terminal import say
from causal_openlock.comparison.progress_bar import duration
from causal_openlock.errors import first_lines
from causal_openlock.wording import counted


def status(folder: ResultsFolder) -> None:
    """Show what of a comparison is done, and the time left.

    Running and failed cells are named. The comparison may run anywhere: on this machine, on a
    cluster, or as shards in a job array.
    """
    from causal_openlock.running.progress import status_of
    from causal_openlock.storage.store import LOG, Store

    store = Store(folder)
    experiment = store.experiment()
    if (store.folder / LOG).exists():
        people = counted(len(experiment.files), "person has", "people have")
        say(f"{people} finished a trial")
        if unwritten := store.unwritten():
            say(unwritten)
        return
    progress, quiet, failures = status_of(store, experiment)
    playing = progress.playing
    waiting = progress.cells - progress.done - progress.failed - len(playing)
    say(
        f"{experiment.name}: {progress.done} of {progress.cells} cells done, {len(playing)} "
        f"running, {progress.failed} failed, {waiting} waiting; {progress.share:.0%} of the work"
    )
    for head, lines in {
        "running": [
            f"  {one.cell.in_words}: {one.share:.0%}, for {duration(one.seconds)}"
            for one in playing
        ],
        "begun, and stopped or in a long step": [
            f"  {cell}: no report for {duration(since)}" for cell, since in quiet.items()
        ],
        "failed": [f"  {why}" for why in failures],
    }.items():
        if lines:
            say(f"{head}:\n{first_lines(lines, '  ')}")
    if progress.over:
        again = "; compare with --retry-failed tries the others again" if progress.failed else ""
        say(f"over{again}")
    elif not playing:
        say("nothing is running")
    elif progress.left is None:
        say("the time left is not known yet")
    else:
        then = time.strftime("%Y-%m-%d %H:%M", time.localtime(time.time() + progress.left))
        say(f"over in about {duration(progress.left)}, at {then}")


def export(folder: ResultsFolder, out: Output = None) -> None:
    """Write the record as CSV.

    By default it is FOLDER/record.csv; .csv.gz compresses it.
    """
    from causal_openlock.export.as_csv import write_csv
    from causal_openlock.storage.store import Store

    store = Store(folder)
    if missing := store.files()[1]:
        what = counted(len(missing), "cell")
        say(f"warning: {what} not played yet and not exported; run compare", error=True)
    path = out or folder / "record.csv"
    count = write_csv(store, path)
    say(f"{path} written, {counted(count, 'attempt')} played")


def bundle(
    folder: ResultsFolder,
    out: Output = None,
    licence: Annotated[
        str, typer.Option("--license", help="Of the data, such as CC-BY-4.0, for its data card.")
    ] = "",
) -> None:
    """Pack an experiment, its record and its report into one file.

    By default it is FOLDER.zip.
    """
    from causal_openlock.export.bundle import write_bundle
    from causal_openlock.storage.store import Store

    whole = folder.resolve()
    path = out or whole.with_name(f"{whole.name}.zip")  # a dot in the name begins no suffix
    for warning in write_bundle(Store(folder), path, licence):
        say(f"warning: {warning}", error=True)
    size = path.stat().st_size / 1e6
    say(f"{path} written, {size:.1f} MB; its README.md says how to run it again")
