"""What a learner that holds beliefs believed in one trial, which it plays again.

A record says what a subject did and not what it believed. But a subject does the same whenever it
plays with the same seed, so the first subject of the first condition plays its first trial once
more and its belief is watched. Where it then does anything else than what is on record, because
the learner is no longer the one that was run, nothing is shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pandas as pd

from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.information import information_per_action, mean_information
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.wording import file_names
from causal_openlock.world.room import action_names

if TYPE_CHECKING:
    import pyarrow as pa

    from causal_openlock.belief.trace import Trace

MOST = 3
"""Learners whose belief is shown: those that are listed first."""

LONGEST = 60
"""Trials of more attempts than this are not played again: it takes long, and few are shown."""

COLUMNS = ("actions",)
"""Columns of the record that are read for this section."""

_PROSE = Prose("belief_traces")
_CELL = ("learner", "condition", "protocol", "phase")


def section(material: Material) -> Section | None:
    """A trace of each of the first learners that hold beliefs; None if there are none."""
    from causal_openlock.analysis.plots.belief import draw_trace

    traces: dict[str, Trace] = {}
    changed: list[str] = []
    more = 0
    for spec in _believers(material):
        if len(traces) >= MOST or spec.protocol.attempt_limit > LONGEST:
            more += 1
            continue
        try:
            trace = _replayed(spec, material)
        except OpenLockError:
            trace = None  # its parameters are not those of the learner as it is now
        if trace is None:
            changed.append(spec.name)
        else:
            traces[spec.name] = trace
    if not traces:
        return None
    information = information_per_action(list(traces.values()))
    means = mean_information(information, ["learner", "attempt"]).drop(columns="subjects")
    formats = {"predicted": ".2f", "obtained": "+.2f"}
    return _PROSE.section(
        "beliefs",
        [_PROSE.table("belief_information", means, formats)],
        [
            _PROSE.plot(draw_trace(traces[name]), f"belief_{part}")
            for name, part in file_names(traces).items()
        ],
        more=more,
        changed=changed,
    )


def _believers(material: Material) -> Iterator[LearnerSpec]:
    """The learners of the experiment that hold beliefs, in its order.

    Results are only read: code that they name, and that no package brings along, does not run.
    """
    from causal_openlock.belief.belief_learner import BeliefLearner
    from causal_openlock.contract.registry import learner_class

    for spec in material.experiment.learners:
        if ":" in spec.learner:
            continue
        try:
            kind = learner_class(spec.learner)
        except OpenLockError:
            continue
        if issubclass(kind, BeliefLearner):
            yield spec


def _replayed(spec: LearnerSpec, material: Material) -> Trace | None:
    """The trace, if it agrees with the record."""
    from causal_openlock.belief.trace import trace_trial
    from causal_openlock.contract.registry import create
    from causal_openlock.world.rewards import PAPER_REWARD

    trials = material.trials
    own = trials[trials["learner"] == spec.name]
    if own.empty:
        return None
    played = set(own["condition"])
    condition = next(one for one in material.experiment.conditions if one.name in played)
    mine = own[own["condition"] == condition.name]
    first = mine[mine["subject"] == mine["subject"].min()].iloc[0]
    trace = trace_trial(
        create(spec.learner, spec.parameters),
        condition,
        spec.protocol,
        subject=int(first["subject"]),
        seed=int(first["seed"]),
        # A user's own code is not run to read results; learners with beliefs ignore rewards.
        reward=PAPER_REWARD if spec.reward.depends_on_everything else spec.reward,
        label=spec.name,
    )
    return trace if _done(trace) == _recorded(material.record, first) else None


def _done(trace: Trace) -> list[list[int]]:
    """The actions of each attempt that was played again."""
    names = action_names(len(trace.nodes) - 1)
    return [[names.index(action.name) for action in attempt] for attempt in trace.attempts]


def _recorded(record: pa.Table, trial: pd.Series) -> list[list[int]]:
    """The actions of each attempt of a trial that is on record."""
    import pyarrow.compute as pc

    # Numbers first: they leave few rows, in which names are cheap to compare.
    here = pc.and_(*(pc.equal(record[name], int(trial[name])) for name in ("subject", "trial")))
    few = record.filter(here).select([*_CELL, "loop", "attempt", "actions"]).to_pylist()
    mine = [row for row in few if all(row[name] == trial[name] for name in (*_CELL, "loop"))]
    return [row["actions"] for row in sorted(mine, key=lambda row: row["attempt"])]
