"""Checkpoints: a cell that is killed goes on where it was.

Beside the file that a cell's record will be in, a worker keeps two others while it plays::

    NAME.checkpoint   where the session and the learner stand (see causal_openlock.files.state)
    NAME.attempts     the attempts so far, one after the other, a fixed number of bytes each

The log grows to hundreds of megabytes, and what is in it never changes. So the second file is only
ever added to, and the first says how much of it counts and what the checksum of that is: a process
killed between the two leaves some attempts too many, which are then written again.

A checkpoint counts only for the very cell, and with the very versions of the packages that compute,
with which it was made: the record is then to the last bit the one of a cell that was never
interrupted, apart from wall times, which count the time played. One that is damaged or foreign is
left aside with a warning, and the cell begins again.

Reading a checkpoint from somebody else runs no code. The players of a
:class:`~causal_openlock.contract.one_subject.OneSubjectLearner` can hold anything and are pickled;
such a state is read only if this user has written it, which its seal tells
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
from causal_openlock.experiment.store import ATTEMPTS, CHECKPOINT
from causal_openlock.files.atomic import replacing
from causal_openlock.files.state import StateError, read_state, write_state

MOST_TIME = 0.02
"""Share of the time that checkpoints may take: where they take long, they are taken seldom."""


class CheckpointError(OpenLockError):
    """A checkpoint that cannot be used; its cell begins again."""


class Checkpoint:
    """The checkpoint of one cell.

    Args:
        record: Where the cell's record will be.
        made_with: What the record depends on: ``identity`` of the cell, versions of packages.
        every: Seconds from one checkpoint to the next, at least. 0 takes one after every step,
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
        """Put a new session and a new learner where the checkpoint was taken.

        Returns:
            Whether there is a checkpoint; if not, both are as they were.

        Raises:
            CheckpointError: If there is one that cannot be used; neither can be used then, either.
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
        # Whoever wrote it is not known, and a learner can fail in any way.
        except Exception as error:
            raise CheckpointError(f"{self.path} cannot be used ({in_short(error)})") from None
        self._rows, self._checksum = kept["rows"], kept["checksum"]
        return True

    def _check(self, made_with: dict[str, str]) -> None:
        if made_with.get("identity") != self.made_with["identity"]:
            raise CheckpointError(f"{self.path} is of another cell")
        for package, here in self.made_with.items():
            if (there := made_with.get(package)) != here:
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

    def keep(self, session: Session, learner: Learner) -> None:
        """Take a checkpoint if one is due; called after every step.

        What goes wrong here is a warning, and the cell plays on.
        """
        begun = time.perf_counter()
        if begun < self._due or session.over:
            return
        try:
            self.save(session, learner)
        except LearnerError:  # it keeps no state, and says so
            self.every = float("inf")
        except StateError as error:
            self.every = float("inf")
            self._warn(
                f"its state cannot be kept, so a killed cell begins again ({in_short(error)})"
            )
        except (OpenLockError, OSError) as error:
            self._warn(f"a checkpoint cannot be taken ({in_short(error)})")
        now = time.perf_counter()
        least = (now - begun) / MOST_TIME if self.every else 0.0
        self._due = now + max(self.every, least)

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
    """A learner's state, if it says how that is kept; one left out would be lost unnoticed."""
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
