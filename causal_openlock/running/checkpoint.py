"""Checkpoints: a killed cell continues where it was.

While a worker plays a cell, it keeps two files next to that of the cell's record::

    NAME.checkpoint   the state of the session and the learner (see causal_openlock.files.state)
    NAME.attempts     the attempts so far, one after the other, a fixed number of bytes each

The log grows to hundreds of megabytes, and its content never changes. So the second file is only
appended to, and the first holds how much of it is valid, with a checksum: if a process is killed
between the two writes, the attempts after that are written again.

A checkpoint is valid only for the cell and the versions of the packages that it was made with: the
record is then identical to that of a cell that was never interrupted, apart from wall times, which
count the time played. A damaged or different checkpoint is ignored with a warning, and the cell
begins again.

Reading a checkpoint of another user runs no code. The players of a
:class:`~causal_openlock.contract.one_subject.OneSubjectLearner` can hold anything and are pickled;
such a state is read only if its seal shows that this user has written it
(:mod:`causal_openlock.files.seal`).
"""

from __future__ import annotations

import os
import time
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Learner
from causal_openlock.errors import LearnerError, OpenLockError, in_short
from causal_openlock.experiment.session import Session
from causal_openlock.files.atomic import replacing
from causal_openlock.files.state import StateError, read_state, write_state
from causal_openlock.storage.running_files import ATTEMPTS, CHECKPOINT

MOST_TIME = 0.02
"""The share of the time that checkpoints may take: slow ones are taken less often."""


class CheckpointError(OpenLockError):
    """A checkpoint that cannot be used; its cell begins again."""


class Checkpoint:
    """The checkpoint of one cell.

    Args:
        record: Where the cell's record will be.
        made_with: What the record depends on: ``identity`` of the cell, versions of packages.
        every: The least number of seconds between checkpoints. 0 takes one after every step,
            however long that takes; infinity takes none.

    Attributes:
        warnings: What has gone wrong, a sentence each.
    """

    def __init__(self, record: Path, made_with: dict[str, str], every: float) -> None:
        self.path = record.with_suffix(CHECKPOINT)
        self.attempts = record.with_suffix(ATTEMPTS)
        self.made_with = made_with
        self.every = every
        self.warnings: list[str] = []
        self._rows = self._checksum = 0  # of the attempts that count
        self._due = time.perf_counter() + every

    # -- going on -------------------------------------------------------------------------------

    def resume(self, session: Session, learner: Learner) -> bool:
        """Give a new session and a new learner the state of the checkpoint.

        Returns:
            Whether there is a checkpoint; if not, both are unchanged.

        Raises:
            CheckpointError: If there is one that cannot be used; discard both then.
        """
        try:
            kept = read_state(self.path)
            self._check(kept["made_with"])
            log = self._read(session.log.row_type, kept["rows"], kept["checksum"])
            session.load_state_dict({**kept["session"], "log": log})
            session.begin(learner, kept["learner"])
        except FileNotFoundError:
            return False
        except CheckpointError:
            raise
        # The file may be from anywhere, and a learner can fail in any way.
        except Exception as error:
            raise CheckpointError(f"{self.path} cannot be used ({in_short(error)})") from None
        self._rows, self._checksum = kept["rows"], kept["checksum"]
        return True

    def _check(self, made_with: dict[str, str]) -> None:
        if made_with.get("identity") != self.made_with["identity"]:
            raise CheckpointError(f"{self.path} is of another cell")
        for package, here in self.made_with.items():
            if (there := made_with.get(package, here)) != here:
                raise CheckpointError(
                    f"{self.path} was made with {package} {there}, and here it is {here}"
                )

    def _read(self, kind: np.dtype[np.void], rows: int, checksum: int) -> NDArray[np.void]:
        try:
            with self.attempts.open("rb") as file:
                content = file.read(rows * kind.itemsize)
        except FileNotFoundError:
            content = b""
        if len(content) != rows * kind.itemsize or zlib.crc32(content) != checksum:
            raise CheckpointError(f"{self.attempts} is missing or damaged")
        return np.frombuffer(content, kind)

    # -- keeping --------------------------------------------------------------------------------

    def keep(self, session: Session, learner: Learner, *, now: bool = False) -> None:
        """Take a checkpoint if one is due, or now; called after every step.

        Errors become warnings, and the cell continues.
        """
        begun = time.perf_counter()
        if (begun < self._due and not (now and self.every < float("inf"))) or session.over:
            return
        try:
            self.save(session, learner)
        except LearnerError:  # it does not support checkpoints
            self.every = float("inf")
        except StateError as error:
            self.every = float("inf")
            self._warn(
                f"its state cannot be kept, so a killed cell begins again ({in_short(error)})"
            )
        except (OpenLockError, OSError) as error:
            self._warn(f"a checkpoint cannot be taken ({in_short(error)})")
        ended = time.perf_counter()
        least = (ended - begun) / MOST_TIME if self.every else 0.0
        self._due = ended + max(self.every, least)

    def save(self, session: Session, learner: Learner) -> None:
        """Take a checkpoint now.

        Raises:
            LearnerError: If the learner keeps no state.
            StateError: If its state cannot be kept.
            OpenLockError: If a file cannot be written; the checkpoint before stays.
        """
        state = _state_of(learner)
        here = session.state_dict(since=self._rows)
        new = here.pop("log").tobytes()
        rows, checksum = here["attempts"], zlib.crc32(new, self._checksum)
        kept = {
            "made_with": self.made_with,
            "rows": rows,
            "checksum": checksum,
            "session": here,
            "learner": state,
        }
        at = self._rows * session.log.row_type.itemsize
        with replacing(self.path) as file:
            write_state(file, kept)
            # Attempts that no checkpoint counts do no harm; one that counts too many would.
            with self.attempts.open("r+b" if at else "wb") as attempts:
                attempts.seek(at)
                attempts.write(new)
                attempts.truncate()
                attempts.flush()
                os.fsync(attempts.fileno())
        self._rows, self._checksum = rows, checksum

    def _warn(self, sentence: str) -> None:
        if sentence not in self.warnings:
            self.warnings.append(sentence)


def _state_of(learner: Learner) -> dict[str, Any]:
    """A learner's state; refuses learners that do not define how to save and load it."""
    kind = type(learner)
    own = (kind.state_dict, kind.load_state_dict)
    if Learner.state_dict in own or Learner.load_state_dict in own:
        raise LearnerError(f"{kind.__name__} keeps no state")
    try:
        return learner.state_dict()
    except LearnerError:
        raise
    except Exception as error:  # a learner can fail in any way
        raise StateError(f"{type(error).__name__}: {in_short(error)}") from None
