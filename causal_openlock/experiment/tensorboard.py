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
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.contract.learner import Learner
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.session import Session

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

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


class Curves:
    """The curves of one cell, a context manager.

    Args:
        session: What is played.
        learner: Who plays.
        folder: Where the logs go; a cell that goes on from a checkpoint adds to them.
    """

    def __init__(self, session: Session, learner: Learner, folder: Path) -> None:
        self.session, self.learner, self.folder = session, learner, folder
        brief = session.brief
        # In rows of the log: the attempts of all subjects.
        self._period = max(brief.trials * brief.attempt_limit // POINTS, 1) * brief.subjects
        self._known = session.log.rows

    def __enter__(self) -> Curves:
        from torch.utils.tensorboard import SummaryWriter

        # What was drawn after the checkpoint is drawn again.
        purge = self._known // self.session.subjects + 1 if self._known else None
        self._writer: SummaryWriter = SummaryWriter(
            str(self.folder), purge_step=purge, flush_secs=10
        )
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._writer.close()

    def draw(self) -> None:
        """Draw a point if one is due; called after every step."""
        if self.session.log.rows - self._known < self._period and not self.session.over:
            return
        moment = self.session.log.rows // self.session.subjects
        for name, value in self._point().items():
            self._writer.add_scalar(name, value, moment)
        self._known = self.session.log.rows

    def _point(self) -> dict[str, float]:
        session = self.session
        new = session.log.since(self._known)
        point = {"attempts/reward": new["reward"].mean(), "attempts/opened": new["opened"].mean()}
        complete = new["solutions_found"] == session.solutions[new["subject"], new["visit"]]
        solved = complete & new["new_solution"]
        failed = ~complete & (new["attempt"] == session.brief.attempt_limit)
        decided = np.flatnonzero(solved | failed)
        if len(decided):
            point["trials/solved_share"] = solved[decided].mean()
            point["trials/attempts"] = new["attempt"][decided].mean()
        for name, value in self.learner.metrics().items():
            point[f"learner/{name}"] = value
        return {name: float(value) for name, value in point.items()}
