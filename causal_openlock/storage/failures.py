"""Reasons why cells failed: a file for each with a sentence, the traceback, and a count."""

from __future__ import annotations

import re
from pathlib import Path

from causal_openlock.experiment.declare import Cell
from causal_openlock.files.atomic import write_bytes

_COUNT = re.compile(r"\nfailures: (\d{1,6})\n\Z")


class Failures:
    """The reasons why cells of a results folder failed.

    Args:
        folder: Where their files are.

    Example:
        >>> Failures(Path("results/first_look/errors")).of("bayes_CC4_0-9_0123456789ab.parquet")
        (0, '')
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, file_name: str) -> Path:
        """The path of the reason why a cell failed, by the name of its record's file."""
        return self.folder / f"{Path(file_name).stem}.txt"

    def record(self, cell: Cell, what: str, trace: str, failures: int = 1) -> str:
        """Save why a cell failed, and return it as a sentence.

        Args:
            cell: The cell.
            what: A clause that follows its name.
            trace: The traceback.
            failures: As how many failures it counts; 0 where another try may get further.

        Raises:
            OpenLockError: If it cannot be written.
        """
        why = f"the learner {cell.in_words}, {what}"
        failures += self.of(cell.file_name)[0]
        text = f"{why}\n\n{trace}\nfailures: {failures}\n"
        write_bytes(self.path(cell.file_name), text.encode("utf-8", "backslashreplace"))
        return why

    def of(self, file_name: str) -> tuple[int, str]:
        """Number of failures of a cell since it was last played, and the last reason."""
        try:
            text = self.path(file_name).read_text("utf-8", "replace")
        except OSError:
            return 0, ""
        count = _COUNT.search(text)
        return int(count[1]) if count else 1, text.partition("\n")[0]

    def clear(self, cell: Cell) -> None:
        """Remove the reason why a cell failed."""
        self.path(cell.file_name).unlink(missing_ok=True)
