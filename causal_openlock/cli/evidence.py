"""``causal-openlock evidence``: run studies, and check that what is written follows from them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.comparison.progress import shown
from causal_openlock.errors import EvidenceError

if TYPE_CHECKING:
    from causal_openlock.evidence.study import Study


def evidence(
    names: Annotated[
        list[str] | None, typer.Argument(help="Studies to run or to complete; see --list.")
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Run or complete all studies.")] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Recompute all from what is stored; exit with 1 on a fault."),
    ] = False,
    write: Annotated[
        bool, typer.Option("--write", help="Write verdicts and pages anew from what is stored.")
    ] = False,
    folder: Annotated[Path, typer.Option(help="Folder of the studies.")] = Path("evidence"),
    results: Annotated[
        Path, typer.Option(help="Folder for records and networks, which are not kept.")
    ] = Path("results/evidence"),
    workers: Workers = None,
) -> None:
    """Run studies: every number and verdict of the result pages comes from one.

    Without names and options, list the studies, what each takes and how far it is. A study that
    is stopped keeps what was measured, and the same command completes it.
    """
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.evidence import checking
    from causal_openlock.evidence.running import Watched, run_study
    from causal_openlock.evidence.study import read_studies

    console = Terminal()
    if check:
        faults = checking.check(folder)
        for fault in faults:
            console.print_line(fault)
        if faults:
            error = EvidenceError(f"{len(faults)} faults; nothing was changed")
            error.status = 1
            raise error
        console.print("all numbers and verdicts follow from what is stored")
        return
    if names or every:
        studies = read_studies(folder, tuple(names or ()))
        with resumable():
            for study in studies:
                with shown(study.name, console) as show:
                    run_study(
                        study,
                        results / study.name,
                        Watched(console.print_line, console.warn, show, workers),
                    )
    elif not write:
        for study in read_studies(folder):
            console.print_line(_in_words(study))
        return
    for path in checking.write(folder):
        console.print_line(f"{path} written")


def _in_words(study: Study) -> str:
    from causal_openlock.evidence.running import read_run

    try:
        run = read_run(study)
    except EvidenceError:
        state = "not run"
    else:
        state = "complete" if run["complete"] else f"{run['runs']} runs, {run['cells']} cells"
    return f"{study.name}: {study.file.title} ({study.file.hours:g} core hours; {state})"
