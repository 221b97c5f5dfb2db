"""``python -m evidence``: run studies, and check that what is written follows from them."""

from __future__ import annotations

import os
import sys
from argparse import ArgumentParser, Namespace
from collections import Counter
from pathlib import Path

from causal_openlock.cli.stopping import resumable
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_bytes
from causal_openlock.wording import counted
from evidence.figures import drawn
from evidence.measured import Evidence
from evidence.pages import check
from evidence.run import run_study
from evidence.study import read_studies


def arguments() -> ArgumentParser:
    """The command's arguments."""
    parser = ArgumentParser("python -m evidence", description="Without arguments, list the studies")
    parser.add_argument("names", nargs="*", metavar="NAME", help="run this study, or continue it")
    parser.add_argument("--workers", type=int, help="processes; by default one for each core")
    parser.add_argument("--check", action="store_true", help="whether all texts follow from units")
    parser.add_argument("--write", action="store_true", help="write texts and figures anew")
    return parser


def main(asked: Namespace, root: Path, results: Path) -> list[str]:
    """Do what is asked for, and return the faults of what is written."""
    studies = read_studies(root, asked.names)
    with resumable():
        for study in studies if asked.names else ():
            run_study(study, results / study.name, asked.workers)
    evidences = [Evidence(study) for study in studies]
    if asked.names or asked.write:
        for evidence in evidences:
            for name, path in evidence.figures.items():
                write_bytes(path, drawn(evidence, name))
        return check(root, write=True)
    told = Counter(evidence.played_with for evidence in evidences)
    for evidence in evidences if not asked.check else ():
        hours = f"{evidence.study.file.hours:g} core hours"
        print(f"{evidence.study.name}: {evidence.study.file.title} ({hours}; {evidence.state})")
    for sentence, number in told.items():
        print(f"{counted(number, 'study', 'studies')}: {sentence or 'played with these results.'}")
    faults = check(root) if asked.check else []
    if asked.check and not faults:
        print("all numbers and verdicts follow from the stored units")
    return faults


if __name__ == "__main__":
    try:
        here = Path(os.path.relpath(Path(__file__).parent))
        wrong = main(arguments().parse_args(), here, Path("results") / "evidence")
    except OpenLockError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    for fault in wrong:
        print(fault)
    sys.exit(1 if wrong else 0)
