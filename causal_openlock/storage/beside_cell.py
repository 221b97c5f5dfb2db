"""What stands beside the record of a cell: its checkpoint and progress, and why it failed.

The checkpoint and the progress are there only while the cell is played, under the name of its
record with another ending. Why it failed is in ``errors``: a sentence, the traceback, and a count.
"""

from __future__ import annotations

import time
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from causal_openlock.experiment.declare import Cell
from causal_openlock.files.atomic import sweep, write_bytes

AWAITED = ".awaited-"  # begins the names of files that are there while a run waits for its workers
CHECKPOINT, PROGRESS = ".checkpoint", ".progress"
ERRORS = "errors"
COUNT = "\nfailures: "
MOST_SECONDS = 1e9  # upper bound of a cell's time: thirty years


def report_progress(record: Path, share: float, seconds: float) -> None:
    """Report the share of a cell that is done, after how many seconds; ignore OS errors."""
    with suppress(OSError):
        record.with_suffix(PROGRESS).write_text(f"{share:.4f} {seconds:.1f}", encoding="utf-8")


def reported_progress(record: Path) -> tuple[float, float, float] | None:
    """Share of a cell that is done, seconds since it began, and seconds since it said so."""
    path = record.with_suffix(PROGRESS)
    with suppress(OSError, ValueError):  # just written, or just removed
        share, seconds = map(float, path.read_text(encoding="utf-8").split())
        if 0.0 <= share <= 1.0 and 0.0 <= seconds <= MOST_SECONDS:  # no NaN, either
            still = max(0.0, time.time() - path.stat().st_mtime)
            return share, seconds + still, still
    return None


def checkpointed(record: Path) -> int:
    """When a cell's checkpoint was taken, as a number; 0 if there is none."""
    with suppress(OSError):
        return record.with_suffix(CHECKPOINT).stat().st_mtime_ns
    return 0


def remove_files_of(record: Path) -> None:
    """Remove the files that a cell has only while it is played."""
    for suffix in (CHECKPOINT, PROGRESS):
        record.with_suffix(suffix).unlink(missing_ok=True)


def failure_file(record: Path) -> Path:
    """The path of the reason why a cell failed."""
    return record.parents[1] / ERRORS / f"{record.stem}.txt"


def failures_of(record: Path) -> tuple[int, str]:
    """Number of failures of a cell since it was last played, and the last reason."""
    try:
        text = failure_file(record).read_text("utf-8", "replace")
    except OSError:
        return 0, ""
    count = text.rpartition(COUNT)[2].strip()
    return int(count) if count.isdecimal() else 1, text.partition("\n")[0]


def keep_failure(record: Path, cell: Cell, what: str, trace: str, failures: int = 1) -> str:
    """Keep why a cell failed, and return it as a sentence: its name, and a clause, ``what``.

    It counts as a number of failures: 0 where another try may get further.
    """
    why = f"the learner {cell.in_words}, {what}"
    text = f"{why}\n\n{trace}{COUNT}{failures + failures_of(record)[0]}\n"
    write_bytes(failure_file(record), text.encode("utf-8", "backslashreplace"))
    record.with_suffix(PROGRESS).unlink(missing_ok=True)
    return why


def tidy(folder: Path, names: Collection[str]) -> None:
    """Remove what killed runs left, and checkpoints and errors of cells without these names."""
    cells = folder / "cells"
    sweep(folder)
    sweep(cells)
    leftovers = [*cells.glob(f"*{CHECKPOINT}"), *(folder / ERRORS).glob("*")]
    leftovers = [path for path in leftovers if path.stem not in names]
    for path in [*leftovers, *folder.glob(f"{AWAITED}*"), *cells.glob(f"*{PROGRESS}")]:
        path.unlink(missing_ok=True)
