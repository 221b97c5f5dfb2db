"""A look at a learner before it plays: does it keep to what is its own?

Two promises are easily broken without anybody noticing: all randomness comes from
``brief.generators``, and what a learner is shown stays as it is. Results of a learner that breaks
the first cannot be repeated; one that breaks the second has changed what it looks at later. So a
worker plays a few steps with each new learner before its first cell, with subjects, rooms and
generators of their own, and says what it finds. The learner is thrown away afterwards, the shared
generators are put back, and the cell is played whatever was found.

The contract tests (:mod:`causal_openlock.testing`) look much closer. Learners that come with the
toolkit are under these tests and are not looked at here.
"""

from __future__ import annotations

import threading
import warnings
from contextlib import suppress
from dataclasses import replace
from itertools import islice

from causal_openlock.contract.probes import GlobalRandomness, WrittenTo, watch
from causal_openlock.contract.registry import create, is_ours
from causal_openlock.experiment.experiment import Cell
from causal_openlock.experiment.session import Session

SUBJECTS, ATTEMPTS, STEPS = 2, 2, 12
"""How long a look is: twelve actions of two subjects, two attempts to a trial."""

_seen: set[str] = set()
"""The learners that this process has looked at."""


def check_new_learner(cell: Cell) -> list[str]:
    """What is found of a cell's learner, if this process has not looked at it before."""
    name = f"{cell.spec.learner} {cell.spec.parameters}"
    if name in _seen or is_ours(cell.spec.learner):
        return []
    _seen.add(name)
    return check_learner(cell)


def check_learner(cell: Cell) -> list[str]:
    """Play a few steps with a cell's learner.

    Returns:
        A sentence for each promise that it breaks. One that fails in other ways is not judged:
        the cell itself will show it.
    """
    found = []
    before = GlobalRandomness.now()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch has one for arrays that cannot be written to
            with suppress(Exception, SystemExit):
                try:
                    _play(cell, watched=True)
                except WrittenTo as error:
                    found.append(f"{error}; let it work on a copy, array.copy()")
            # Only now, since what a learner imports while it plays may draw as well, and not
            # where other threads draw at the same time.
            if threading.current_thread() is threading.main_thread():
                before.restore()  # one that seeds would find its own seed
                start = GlobalRandomness.now()  # with torch, if that has been imported
                with suppress(Exception, SystemExit):
                    _play(cell, watched=False)
                if touched := start.differs_from(GlobalRandomness.now()):
                    found.append(
                        f"it uses or seeds the random numbers of {' and '.join(touched)}, which "
                        "all code shares, so its results may differ from run to run; let it draw "
                        "from brief.generators (or self.generator)"
                    )
    finally:
        before.restore()
    return found


def _play(cell: Cell, watched: bool) -> None:
    short = replace(
        cell.spec.protocol, attempt_limit=ATTEMPTS, baseline_loops=1, train_loops=1, test_loops=1
    )
    learner = create(cell.spec.learner, cell.spec.parameters)
    if watched:
        watch(learner)
    session = Session(cell.condition, short, SUBJECTS, reward=cell.spec.reward)
    session.begin(learner)
    for _ in islice(session.steps(learner), STEPS):
        pass
