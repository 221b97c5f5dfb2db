"""``causal-openlock export`` and ``bundle``: results for other programs and other people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.options import ResultsFolder
from causal_openlock.cli.terminal import say
from causal_openlock.errors import OpenLockError
from causal_openlock.wording import counted, nearest


def export(
    folder: ResultsFolder,
    form: Annotated[
        str, typer.Option("--format", "-f", help="csv, or minari (for reinforcement learning).")
    ] = "csv",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="CSV: the file, .csv or .csv.gz. Minari: the folder for data sets.",
        ),
    ] = None,
    episodes: Annotated[
        str | None,
        typer.Option(help="Minari: what an episode is, a trial (default) or an attempt."),
    ] = None,
    learner: Annotated[
        list[str] | None, typer.Option("--learner", "-l", help="Minari: these learners alone.")
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option("--condition", "-c", help="Minari: these conditions alone.")
    ] = None,
) -> None:
    """Write the record in another format."""
    from causal_openlock.storage.store import Store

    store = Store(folder)
    if missing := store.files()[1]:
        what = counted(len(missing), "cell")
        say(f"warning: {what} not played yet and not exported; run compare", error=True)
    if form == "csv":
        if episodes or learner or condition:
            raise OpenLockError(
                "--episodes, --learner and --condition are for --format minari; a CSV file has "
                "the whole record"
            )
        from causal_openlock.export.as_csv import write_csv

        path = out or folder / "record.csv"
        count = write_csv(store, path)
        say(f"{path} written, {counted(count, 'attempt')} played")
        return
    if form != "minari":
        raise OpenLockError(f"there is no format {form!r}; {nearest(form, ['csv', 'minari'])}")
    from causal_openlock.export.as_minari import EPISODES, why_no_environment, write_minari

    kind = episodes or EPISODES[0]
    if kind not in EPISODES:
        raise OpenLockError(f"an episode is a trial or an attempt, not {kind!r}")
    root = out or folder / "minari"
    data, count = write_minari(
        store, root, episodes=kind, learners=learner or (), conditions=condition or ()
    )
    say(f"{data} written, {counted(count, 'episode')}")
    say(f"With MINARI_DATASETS_PATH={root} it is loaded by: minari.load_dataset({data.name!r})")
    if why := why_no_environment(store, kind, learner or ()):
        say(f"recover_environment() finds none: {why}")


def bundle(
    folder: ResultsFolder,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="ZIP file to write; default: FOLDER.zip."),
    ] = None,
    licence: Annotated[
        str, typer.Option("--license", help="Of the data, such as CC-BY-4.0, for its data card.")
    ] = "",
) -> None:
    """Pack an experiment, its record and its report into one file."""
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.export.bundle import write_bundle
    from causal_openlock.storage.store import Store

    whole = folder.resolve()
    path = out or whole.with_name(f"{whole.name}.zip")  # a dot in the name begins no suffix
    for warning in write_bundle(Store(folder), path, licence):
        Terminal(stderr=True).warn(warning)
    size = path.stat().st_size / 1e6
    say(f"{path} written, {size:.1f} MB; its README.md says how to run it again")
