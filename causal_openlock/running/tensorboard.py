"""Curves for TensorBoard, drawn while a cell is played.

A run of TensorBoard is a cell, and its axis is the mean number of attempts of the cell's subjects.
Every point is a mean over the attempts of all subjects since the last point, and over the trials
that were decided since then. Results are computed from the record, not from these curves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from causal_openlock.contract.learner import Learner
from causal_openlock.experiment.session import Session

POINTS = 500  # of a curve, at most


@contextmanager
def curves(session: Session, learner: Learner, folder: Path) -> Iterator[Callable[[], None]]:
    """Draw the curves of one cell; yields a function to call after every step.

    A cell that continues from a checkpoint adds to the logs in ``folder``.
    """
    from torch.utils.tensorboard import SummaryWriter

    brief, log = session.brief, session.log
    # In rows of the log: the attempts of all subjects.
    period = max(brief.trials * brief.attempt_limit // POINTS, 1) * brief.subjects
    drawn = log.rows
    purge = drawn // brief.subjects + 1 if drawn else None  # points after the checkpoint

    def draw() -> None:
        nonlocal drawn
        if log.rows - drawn < period and not session.over:
            return
        new, drawn = log.since(drawn), log.rows
        point = {"attempts/reward": new["reward"].mean(), "attempts/opened": new["opened"].mean()}
        complete = new["solutions_found"] == session.solutions[new["subject"], new["visit"]]
        solved = complete & new["new_solution"]
        decided = solved | (~complete & (new["attempt"] == brief.attempt_limit))
        if decided.any():
            point["trials/solved_share"] = solved[decided].mean()
            point["trials/attempts"] = new["attempt"][decided].mean()
        point |= {f"learner/{name}": value for name, value in learner.metrics().items()}
        for name, value in point.items():
            writer.add_scalar(name, float(value), log.rows // brief.subjects)

    with SummaryWriter(str(folder), purge_step=purge, flush_secs=10) as writer:
        yield draw
