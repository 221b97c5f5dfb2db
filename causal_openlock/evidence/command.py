"""``causal-openlock evidence``: run studies, and check that what is written follows from them."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.errors import EvidenceError, OpenLockError
from causal_openlock.wording import counted

if TYPE_CHECKING:
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.evidence.study import Study


def evidence(
    names: Annotated[
        list[str] | None,
        typer.Argument(help="Studies to run or to complete; without any they are listed."),
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Run or complete all studies.")] = False,
    check: Annotated[
        bool,
        typer.Option("--check", help="Recompute all from stored units; exit with 1 on a fault."),
    ] = False,
    write: Annotated[
        bool, typer.Option("--write", help="Write verdicts and pages again from the stored units.")
    ] = False,
    folder: Annotated[Path, typer.Option(help="Folder of the studies.")] = Path("evidence"),
    results: Annotated[
        Path, typer.Option(help="Folder for records and networks, which are not kept.")
    ] = Path("results/evidence"),
    workers: Workers = None,
    stamp: Annotated[
        str,
        typer.Option(
            help="Store this study with the hash of its present declaration, if its learners do "
            "the same by the code before; needs --before and --reason."
        ),
    ] = "",
    before: Annotated[
        Path | None, typer.Option(help="Checkout of the code before the change.")
    ] = None,
    reason: Annotated[str, typer.Option(help="Why the declaration is written otherwise.")] = "",
    anew: Annotated[
        bool, typer.Option("--anew", help="Also play cells that are stored with the studies.")
    ] = False,
    trust: Annotated[
        list[str] | None,
        typer.Option(help="Let code run that this study names, also where it is only checked."),
    ] = None,
) -> None:
    """Run the studies that the documentation's numbers come from.

    Without names and options, list the studies, what each takes and how far it is. A study that
    is stopped keeps what was measured, and the same command completes it, on any machine. Code that
    a study names runs only where the study is run, which is announced, or where you trust it.
    """
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.evidence import checking
    from causal_openlock.evidence.measured import Evidence
    from causal_openlock.evidence.study import read_studies

    console = Terminal()
    if check and (names or every or write or stamp):
        raise EvidenceError("--check looks at everything and changes nothing; give it alone")
    if stamp:
        from causal_openlock.evidence.stamping import stamp as stamp_study

        if not (before and reason):
            raise EvidenceError(
                "--stamp needs the code before the change and why: --before CHECKOUT "
                "--reason 'A sentence.'"
            )
        (study,) = read_studies(folder, (stamp,), console.print_line)
        stamp_study(study, before, reason, console.print_line)
        write, trust = True, [*(trust or ()), stamp]
    if not (check or write or names or every):
        for study in read_studies(folder):
            console.print_line(_in_words(study))
        return
    if check:
        faults = checking.check(folder, trust or ())
    else:
        if names or every:
            studies = read_studies(folder, tuple(names or ()), console.print_line)
            if not names:
                studies = [study for study in studies if not study.file.published]
            _run(studies, results, workers, anew, console)
            trust = [*(trust or ()), *(study.name for study in studies)]
        changed, faults = checking.write(folder, trust or ())
        for path in changed:
            console.print_line(f"{path} written")
    if faults and (names or every):
        console.warn(f"{counted(len(faults), 'fault')} in what studies say elsewhere; see --check")
        return
    for fault in faults:
        console.print_line(fault)
    if faults:
        error = EvidenceError(f"{counted(len(faults), 'fault')}, as listed")
        error.status = 1
        raise error
    if check:
        told = Counter(filter(None, (Evidence(one).played_with for one in read_studies(folder))))
        for played_with, number in told.items():
            console.print_line(f"{counted(number, 'study', 'studies')}: {played_with}")
        console.print("all numbers and verdicts follow from the stored units")


def _run(
    studies: list[Study], results: Path, workers: int | None, anew: bool, console: Terminal
) -> None:
    from causal_openlock.comparison.progress_bar import shown
    from causal_openlock.evidence.keeping import Watched
    from causal_openlock.evidence.running import run_study

    with resumable():
        for study in studies:
            with shown(study.name, console) as show:
                watched = Watched(console.print_line, console.warn, show, workers)
                run_study(study, results / study.name, watched, anew)


def _in_words(study: Study) -> str:
    from causal_openlock.evidence.measured import Evidence

    found = Evidence(study)
    try:
        _ = found.units
        parts = "networks" if study.file.networks else "cells"
        state = "complete" if found.complete else f"{found.run['cells']} {parts}"
        if study.file.published:
            state = f"published with version {study.file.published}"
        elif not found.stands:
            state = "changed since it was run"
    except OpenLockError as error:
        state = "not run" if not found.was_run else str(error)
    return f"{study.name}: {study.file.title} ({study.file.hours:g} core hours; {state})"
