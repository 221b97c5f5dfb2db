"""Checkpoints: a killed cell continues where it was.

While a worker plays a cell, it keeps the state of session and learner next to the record: a pickle,
which is read only under the seal of this user's key (:mod:`causal_openlock.files.seal`). A
checkpoint that is damaged, or was written by another user, for another cell or with other versions
of packages, is passed over with a warning, and the cell begins again. Otherwise the record is that
of a cell that was never interrupted, apart from wall times, which count the time played.
"""

from __future__ import annotations

import io
import pickle
import threading
import time
from math import inf
from pathlib import Path

from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import PerSubjectAdapter
from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.experiment.session import Session
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.seal import sealed, unsealed
from causal_openlock.storage.beside_cell import CHECKPOINT

MOST_TIME = 0.02  # share of the time that checkpoints may take: slow ones are taken less often


class Checkpoint:
    """The checkpoint of one cell, beside its record, which depends on what it is ``made_with``."""

    def __init__(self, record: Path, made_with: dict[str, str], every: float) -> None:
        self.path = record.with_suffix(CHECKPOINT)
        self.made_with = made_with
        self.every = every
        self.warnings: list[str] = []  # sentences
        self._due = time.perf_counter() + every

    def resume(self, session: Session, learner: Learner) -> bool:
        """Give a new session and a new learner the state of the checkpoint, if there is one.

        If it cannot be used, there is a warning, and session and learner are to be discarded.
        """
        try:
            file = io.BytesIO(unsealed(self.path.read_bytes()))
            for name, other in pickle.load(file).items():
                if other != (here := self.made_with.get(name, other)):
                    raise OpenLockError(f"it was made with {name} {other}, and here is {here}")
            state, of_learner, randomness = pickle.load(file)
            session.resume(state)
            session.begin(learner, of_learner)
            if threading.current_thread() is threading.main_thread():
                randomness.restore()  # others may draw from these generators in a thread
            return True
        except FileNotFoundError:
            pass
        except Exception as error:  # code may have changed, and a learner can fail in any way
            why = f"{self.path} cannot be used ({in_short(error)})"
            self.warnings.append(f"{why}; its cell begins again")
        return False

    def keep(self, session: Session, learner: Learner, *, now: bool = False) -> None:
        """Take a checkpoint if one is due, or now; called after every step.

        Errors become warnings, and the cell continues from the checkpoint before if it is killed.
        """
        begun = time.perf_counter()
        is_due = self.every < inf and (now or begun >= self._due)
        if not (is_due and learner.resumable) or session.over:
            return
        try:
            state = session.state, learner.__getstate__(), GlobalRandomness.now()
            content = pickle.dumps(self.made_with) + pickle.dumps(state)
        except Exception:  # a learner can hold anything; the worker says so when the cell is over
            self.every = inf
            return
        try:
            write_bytes(self.path, sealed(content))
        except OpenLockError as error:
            if (warning := f"no checkpoint can be taken: {in_short(error)}") not in self.warnings:
                self.warnings.append(warning)
        ended = time.perf_counter()
        self._due = ended + max(self.every, (ended - begun) / MOST_TIME if self.every else 0.0)


def unresumable(learner: Learner) -> str:
    """Why the cell of a learner begins again after a kill; empty if it continues."""
    if not learner.resumable:
        return "it says resumable = False"
    try:
        pickle.dumps(learner.__getstate__())
        return ""
    except Exception:  # a learner can hold anything
        player = learner._players[0] if isinstance(learner, PerSubjectAdapter) else learner
    what = "its state"
    for name, value in vars(player).items():
        try:
            pickle.dumps(value)
        except Exception:
            what = f"its attribute {name}"
    return f"{what} cannot be pickled; let __getstate__ leave it out and __setstate__ make it anew"
