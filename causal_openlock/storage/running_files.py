"""Files that are there only while cells are played: checkpoints, progress, and that a run waits.

Files of a cell are next to that of its record, under the same name with another ending.
"""

from __future__ import annotations

from collections.abc import Collection
from contextlib import suppress
from pathlib import Path

from causal_openlock.files.atomic import sweep

AWAITED = ".awaited-"
"""The beginning of the names of files that are there while a run waits for its workers."""
CHECKPOINT, PROGRESS = ".checkpoint", ".progress"
"""Endings; see :mod:`causal_openlock.running.checkpoint` for the first."""

MOST_SECONDS = 1e9
"""Upper bound of a cell's time: thirty years."""


def report_progress(record: Path, share: float, seconds: float) -> None:
    """Report the share of a cell that is done, after how many seconds; ignore OS errors."""
    with suppress(OSError):
        record.with_suffix(PROGRESS).write_text(f"{share:.4f} {seconds:.1f}", encoding="utf-8")


def reported_progress(record: Path) -> tuple[int, float, float] | None:
    """Time of a cell's last report, in nanoseconds; the share that is done; the seconds."""
    path = record.with_suffix(PROGRESS)
    with suppress(OSError, ValueError):  # just written, or just removed
        share, seconds = map(float, path.read_text(encoding="utf-8").split())
        if 0.0 <= share <= 1.0 and 0.0 <= seconds <= MOST_SECONDS:  # no NaN, either
            return path.stat().st_mtime_ns, share, seconds
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


def tidy(folder: Path, known: Collection[str]) -> None:
    """Remove what killed runs and earlier forms of an experiment left in a results folder.

    Args:
        folder: The results folder.
        known: Names of files of cells without the ending, whose checkpoints and errors stay.
    """
    cells, identity = folder / "cells", "[0-9a-f]" * 12
    for place in (folder, cells):
        sweep(place)
    for path in [*folder.glob(f"{AWAITED}*"), *cells.glob(f"*{PROGRESS}")]:
        path.unlink(missing_ok=True)
    for path in [*cells.glob(f"*{CHECKPOINT}"), *(folder / "errors").glob(f"*_{identity}.txt")]:
        if path.stem not in known:
            path.unlink(missing_ok=True)
