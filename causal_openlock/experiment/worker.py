"""What a worker does: it plays one cell, from its checkpoint if there is one, and keeps the record.

While it plays it takes checkpoints, says how far it is, and draws curves if somebody wants to see
them. None of that changes what is played.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, OpenLockError, in_short
from causal_openlock.experiment.checkpoint import Checkpoint, CheckpointError
from causal_openlock.experiment.experiment import Cell
from causal_openlock.experiment.learner_check import check_new_learner
from causal_openlock.experiment.session import Session
from causal_openlock.experiment.store import PROGRESS, Store, versions

TELL_EVERY = 1.0
"""Seconds after which a worker says again how far its cell is."""


@dataclass(frozen=True)
class Watching:
    """What is done beside playing.

    Attributes:
        checkpoint_every: Seconds between checkpoints inside a cell; 0 takes one after every step,
            infinity none.
        tensorboard: Folder for TensorBoard's logs; by default there are none.
    """

    checkpoint_every: float = 60.0
    tensorboard: str | None = None


def play_cell(cell: Cell, folder: str, watching: Watching) -> list[str]:
    """Play one cell and keep its record.

    Returns:
        What went wrong without stopping it, a sentence each.

    Raises:
        LearnerError: If the learner fails; why, and its traceback, are kept in ``errors``.
        OpenLockError: If a file cannot be written.
    """
    store = Store(folder)
    made_with = {"identity": cell.identity, **versions()}
    checkpoint = Checkpoint(store.path(cell), made_with, watching.checkpoint_every)
    try:
        checkpoint.warnings += check_new_learner(cell)
        session, learner = _begun(cell, checkpoint)
        with ExitStack() as stack:
            after = [_teller(session, store.path(cell).with_suffix(PROGRESS))]
            if watching.tensorboard is not None:
                from causal_openlock.experiment.tensorboard import curves

                logs = Path(watching.tensorboard) / cell.name
                after.append(stack.enter_context(curves(session, learner, logs)))

            for _ in session.steps(learner):
                checkpoint.keep(session, learner)
                for look in after:
                    look()
        record = session.record()
    except (Exception, SystemExit) as error:
        # A learner that failed will be mended, and is then another one: nothing to go on from.
        store.clear(cell)
        raise LearnerError(blame(store, cell, error)) from None
    store.write(cell, record)
    store.clear(cell)
    store.forgive(cell)
    return [f"{cell.spec.name}: {warning}" for warning in checkpoint.warnings]


def blame(store: Store, cell: Cell, error: BaseException) -> str:
    """Keep what a cell failed by; returns a sentence that says so.

    Raises:
        OpenLockError: If it cannot be written.
    """
    what = in_short(error)
    if not isinstance(error, OpenLockError):
        what = f"{type(error).__name__}: {what}".removesuffix(": ")
    return store.blame(cell, f"failed: {what}", "".join(traceback.format_exception(error)))


def _begun(cell: Cell, checkpoint: Checkpoint) -> tuple[Session, Learner]:
    """A session and its learner, ready to play: from the checkpoint, or from the beginning."""
    session, learner = _made(cell)
    try:
        if checkpoint.resume(session, learner):
            return session, learner
    except CheckpointError as error:
        checkpoint.warnings.append(f"{error}; its cell begins again")
        session, learner = _made(cell)
    session.begin(learner)
    return session, learner


def _made(cell: Cell) -> tuple[Session, Learner]:
    session = Session(
        cell.condition,
        cell.spec.protocol,
        range(cell.first_subject, cell.first_subject + cell.subjects),
        seed=cell.seed,
        reward=cell.spec.reward,
        learner=cell.spec.name,
        experiment=cell.experiment,
    )
    return session, create(cell.spec.learner, cell.spec.parameters)


def _teller(session: Session, path: Path) -> Callable[[], None]:
    """Writes down how far a session is, every now and then; see :meth:`Store.share`."""
    due = time.perf_counter() + TELL_EVERY

    def tell() -> None:
        nonlocal due
        if (now := time.perf_counter()) >= due:
            due = now + TELL_EVERY
            with suppress(OSError):  # the next one may succeed
                path.write_text(f"{session.progress:.4f}", encoding="utf-8")

    return tell
