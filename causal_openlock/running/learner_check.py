"""A check of new learners before they play: global randomness, and changes to their input.

Two rules are easily broken without anybody noticing: all randomness comes from
``brief.generators``, and a learner does not change the arrays it gets. Results of a learner that
breaks the first cannot be reproduced; one that breaks the second changes its own later input. So a
worker plays a few steps with each new learner before its first cell, with other subjects, rooms and
generators, and reports what it finds. Afterwards the learner is discarded, the global generators
are restored, and the cell is played in any case.

The contract tests (:mod:`causal_openlock.testing`) check much more. Learners of the toolkit pass
those tests and are not checked here.
"""

from __future__ import annotations

import threading
import warnings
from contextlib import suppress
from dataclasses import replace
from itertools import islice

from causal_openlock.contract.probes import GlobalRandomness, InputChangedError, watch
from causal_openlock.contract.registry import create, is_ours
from causal_openlock.experiment.experiment import Cell
from causal_openlock.experiment.session import Session

SUBJECTS, ATTEMPTS, STEPS = 2, 2, 12
"""The length of the check: twelve actions of two subjects, two attempts in a trial."""

IN_TORCH = (
    ". In torch: pass torch.Generator().manual_seed(seed), with seed = "
    "int(self.generator.integers(2**63)), to what takes a generator; put what takes none, such as "
    "new layers, under `with torch.random.fork_rng():` after torch.manual_seed(seed) inside it"
)
"""Additional hint for a learner that draws with torch."""

_seen: set[str] = set()
"""The learners that this process has checked."""


def check_new_learner(cell: Cell) -> list[str]:
    """The faults of a cell's learner, if this process has not checked it before."""
    name = f"{cell.spec.learner} {cell.spec.parameters}"
    if name in _seen or is_ours(cell.spec.learner):
        return []
    _seen.add(name)
    return check_learner(cell)


def check_learner(cell: Cell) -> list[str]:
    """Play a few steps with a cell's learner.

    Returns:
        A sentence for each rule that it breaks. Other failures are ignored: they will show in the
        cell itself.
    """
    found = []
    before = GlobalRandomness.now()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # torch has one for arrays that cannot be written to
            with suppress(Exception, SystemExit):
                try:
                    _play(cell, watched=True)
                except InputChangedError as error:
                    found.append(f"{error}; let it work on a copy, array.copy()")
            # Second, since modules imported in the first play may draw too; and only in the main
            # thread, since other threads may draw at the same time.
            if threading.current_thread() is threading.main_thread():
                before.restore()  # a learner that seeds would find its own seed
                start = GlobalRandomness.now()  # with torch, if that has been imported
                with suppress(Exception, SystemExit):
                    _play(cell, watched=False)
                if touched := start.differs_from(GlobalRandomness.now()):
                    in_torch = IN_TORCH if "torch" in touched else ""
                    found.append(
                        f"it uses or seeds the random numbers of {' and '.join(touched)}, which "
                        "all code shares, so its results may differ from run to run; let it draw "
                        f"from brief.generators (or self.generator){in_torch}"
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
