"""``causal-openlock export`` and ``bundle``: results for other programs and other people."""

from __future__ import annotations

from typing import Annotated

import typer

from causal_openlock.cli.options import Output, ResultsFolder
from causal_openlock.cli.terminal import say
from causal_openlock.wording import counted


def export(
    folder: ResultsFolder,
    out: Output = None,
) -> None:
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
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.export.bundle import write_bundle
    from causal_openlock.storage.store import Store

    whole = folder.resolve()
    path = out or whole.with_name(f"{whole.name}.zip")  # a dot in the name begins no suffix
    for warning in write_bundle(Store(folder), path, licence):
        Terminal(stderr=True).warn(warning)
    size = path.stat().st_size / 1e6
    say(f"{path} written, {size:.1f} MB; its README.md says how to run it again")
