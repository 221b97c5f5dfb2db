"""``causal-openlock compare``: run an experiment and report its results."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import BesideFolders, ProtocolName, Seed, Workers
from causal_openlock.cli.report import report_results
from causal_openlock.cli.stopping import resumable
from causal_openlock.cli.terminal import complain
from causal_openlock.comparison.progress_bar import shown
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import folder_at

if TYPE_CHECKING:
    from causal_openlock.running.progress import RunProgress


def compare(
    experiment: Annotated[
        str, typer.Argument(help="Path of an experiment file, or name of a bundled experiment.")
    ] = "default",
    out: Annotated[
        str | None,
        typer.Option(
            "--out", "-o", help="Folder for the results; by default one of its own in results/."
        ),
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option("--condition", "-c", help="Play this instead: CC4, CC3-CC4, my.yaml, ..."),
    ] = None,
    learner: Annotated[
        list[str] | None, typer.Option("--learner", "-l", help="Let this play instead.")
    ] = None,
    protocol: ProtocolName = None,
    subjects: Annotated[
        int | None, typer.Option(min=1, help="Subjects for each learner and condition.")
    ] = None,
    seed: Seed = None,
    workers: Workers = None,
    cluster: Annotated[
        str | None, typer.Option(help="Let workers of Dask play: tcp://host:8786.")
    ] = None,
    shard: Annotated[
        str | None,
        typer.Option(help="Play this share of the cells alone, such as 3/16; writes no report."),
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Also try cells that have failed three times.")
    ] = False,
    allow_version: Annotated[
        bool,
        typer.Option(
            "--allow-version", help="Complete cells that were begun with other package versions."
        ),
    ] = False,
    checkpoint_every: Annotated[
        float,
        typer.Option(min=0, help="Seconds between checkpoints inside a cell; inf takes none."),
    ] = 60.0,
    time_limit: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            help="Seconds after which a cell is ended and counted as failed; by default never.",
        ),
    ] = None,
    beside: BesideFolders = None,
    tensorboard: Annotated[
        Path | None, typer.Option(help="Folder for TensorBoard's logs, a run for each cell.")
    ] = None,
) -> None:
    """Compare learners, and write a report of the results.

    The default takes one to three minutes. A folder that holds a part of it is completed.

    Exit status: 0 if everything was played, 1 if cells failed and all others were played, 2 if what
    was asked for cannot be done, 130 or 143 if it was stopped.
    """
    from causal_openlock.comparison.comparing import play
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.results import open_results
    from causal_openlock.experiment.making import Changes, find_experiment, read_experiment
    from causal_openlock.storage.folder_lock import Shard
    from causal_openlock.storage.store import Store

    part = Shard.parse(shard) if shard else None
    if cluster and workers:
        raise OpenLockError("a --cluster has workers of its own; leave out --workers")
    changes = Changes(condition or None, learner or None, protocol, subjects, seed)
    console = Terminal()
    chosen = read_experiment(find_experiment(experiment), changes, console.print_line)
    # A changed experiment is another one, and has results of its own.
    own = "" if changes == Changes() else f"-{chosen.identity[:8]}"
    folder = folder_at(out or Path("results") / f"{chosen.name}{own}")
    if own and (name := Store(folder).name):  # other learners, say: one comparison all the same
        chosen = replace(chosen, name=name)
    standings: list[RunProgress] = []
    with resumable():
        with shown(chosen.name, console) as show:

            def progress(standing: RunProgress) -> None:
                standings.append(standing)
                show(standing)

            failed = play(
                chosen,
                folder,
                warn=console.warn,
                progress=progress,
                beside=beside or (),
                workers=workers,
                cluster=cluster,
                shard=part,
                retry_failed=retry_failed,
                allow_version=allow_version,
                checkpoint_every=checkpoint_every,
                time_limit=time_limit,
                tensorboard=tensorboard,
            )
        if (first := standings[0]).done and not failed:
            console.print(f"{first.done} of {first.cells} cells were there already")
        played = not (failed and failed.every)
        if played and part:
            console.print_line(
                f"shard {shard} is done; when all shards are: causal-openlock report {folder}"
            )
        elif played:
            report_results(open_results(folder, beside=beside or ()), folder, reasons=False)
    if failed:  # the reasons were printed when they did
        complain(failed.summary)
        raise typer.Exit(failed.status)
