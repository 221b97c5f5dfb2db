"""The studies of the folder ``evidence``, each read once for all tests of a process."""

from __future__ import annotations

from functools import cache

from causal_openlock.evidence.study import FILE, Study, read_study
from support.places import ROOT

EVIDENCE = ROOT / "evidence"
NAMES = sorted(path.parent.name for path in EVIDENCE.glob(f"*/{FILE}"))


@cache
def shipped(name: str) -> Study:
    """Return a study by its name; its experiment and trainings are read when asked for."""
    return read_study(EVIDENCE / name)


DECLARED = [name for name in NAMES if not shipped(name).file.published]
"""Studies whose experiments can be read; of others only results are stored."""
