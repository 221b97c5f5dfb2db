"""Curves for TensorBoard: how a cell is going while it is still played.

A run of TensorBoard is a cell, and its axis counts attempts: how many each of the cell's subjects
has made, in the mean. Every point is a mean over all attempts since the point before, of all
subjects: ``attempts/reward`` and ``attempts/opened``; ``trials/solved_share`` and
``trials/attempts`` (until the last solution was found; the limit where one was not) of the trials
decided since then; and under ``learner/`` what the learner reports (:meth:`Learner.metrics`).

The record is what results are read from; these curves are for looking on.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from causal_openlock.contract.learner import Learner
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.session import Session

POINTS = 500
"""Points of a curve, at most."""


def require_tensorboard() -> None:
    """Make sure that logs can be written.

    Raises:
        OpenLockError: If TensorBoard is not installed.
    """
    if importlib.util.find_spec("tensorboard") is None:
        raise OpenLockError(
            "logs for TensorBoard need the package tensorboard; install it with: "
            "pip install 'causal-openlock[tensorboard]'"
        )


@contextmanager
def curves(session: Session, learner: Learner, folder: Path) -> Iterator[Callable[[], None]]:
    """Draw the curves of one cell; gives what draws a point if one is due, after every step.

    A cell that goes on from a checkpoint adds to the logs in ``folder``.
    """
    from torch.utils.tensorboard import SummaryWriter

    brief, log = session.brief, session.log
    # In rows of the log: the attempts of all subjects.
    period = max(brief.trials * brief.attempt_limit // POINTS, 1) * brief.subjects
    known = log.rows
    # What was drawn after the checkpoint is drawn again.
    purge = known // brief.subjects + 1 if known else None

    def draw() -> None:
        nonlocal known
        if log.rows - known >= period or session.over:
            for name, value in _point(session, learner, known).items():
                writer.add_scalar(name, value, log.rows // brief.subjects)
            known = log.rows

    with SummaryWriter(str(folder), purge_step=purge, flush_secs=10) as writer:
        yield draw


def _point(session: Session, learner: Learner, known: int) -> dict[str, float]:
    """The values of a point, over the attempts since row ``known`` of the log."""
    new = session.log.since(known)
    point = {"attempts/reward": new["reward"].mean(), "attempts/opened": new["opened"].mean()}
    complete = new["solutions_found"] == session.solutions[new["subject"], new["visit"]]
    solved = complete & new["new_solution"]
    failed = ~complete & (new["attempt"] == session.brief.attempt_limit)
    decided = np.flatnonzero(solved | failed)
    if len(decided):
        point["trials/solved_share"] = solved[decided].mean()
        point["trials/attempts"] = new["attempt"][decided].mean()
    point |= {f"learner/{name}": value for name, value in learner.metrics().items()}
    return {name: float(value) for name, value in point.items()}
