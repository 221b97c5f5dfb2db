"""What a learner that holds beliefs believed in one trial, played again from its description.

A record says what a subject did and not what it believed. But a subject does the same whenever it
plays with the same seed, so the first subject of the first condition plays its first trial once
more and its belief is watched. Where it then does anything else than what is on record, because
the learner is no longer the one that was run, nothing is shown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import pandas as pd

from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.results.description import mappings_with
from causal_openlock.analysis.results.information import information_per_action, mean_information
from causal_openlock.errors import OpenLockError
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

_TOLD = ("learner", "condition", "protocol", "phase")
_NEEDED = {"name", "learner", "parameters", "protocol", "reward"}


def section(material: Material) -> Section | None:
    """A trace of each of the first learners that hold beliefs; None if none does."""
    drawings: list[Drawing] = []
    traces: list[Trace] = []
    changed: list[str] = []
    more = 0
    for entry in _believers(material):
        if len(drawings) >= MOST or entry["protocol"]["attempt_limit"] > LONGEST:
            more += 1
            continue
        try:
            trace = _replayed(entry, material)
        except (OpenLockError, TypeError, ValueError, KeyError):
            trace = None  # it cannot be made any more from what the description says
        if trace is None:
            changed.append(entry["name"])
            continue
        traces.append(trace)
        drawings.append(_drawing(trace, entry["name"]))
    if not drawings:
        return None
    text = [
        "What the first subject believed in the first trial of the first condition, action by "
        "action: it has played the trial once more, and done what is on record. "
        "causal-openlock trace shows any other trial."
    ]
    if more:
        text.append(f"Learners that hold beliefs, too, and are not shown here: {more}.")
    if changed:
        text.append(f"Not what they were when they were run, and not shown: {', '.join(changed)}.")
    return Section("beliefs", "Beliefs", tuple(text), (_information(traces),), tuple(drawings))


def _believers(material: Material) -> Iterator[Mapping[str, Any]]:
    """The learners of the experiment that hold beliefs, in its order.

    Results are only read: code that they name, and that no package brings along, does not run.
    """
    from causal_openlock.belief.believer import Believer
    from causal_openlock.contract.registry import learner_class

    learners: Any = material.experiment.get("learners")
    if not mappings_with(learners, _NEEDED):
        return
    for entry in learners:
        if ":" in entry["learner"]:
            continue
        try:
            kind = learner_class(entry["learner"])
        except OpenLockError:
            continue
        if issubclass(kind, Believer):
            yield entry


def _replayed(entry: Mapping[str, Any], material: Material) -> Trace | None:
    """The trace, if it tells of what is on record."""
    from causal_openlock.belief.trace import trace_trial
    from causal_openlock.contract.registry import create
    from causal_openlock.experiment.from_description import (
        condition_from_dict,
        protocol_from_dict,
        reward_from_dict,
    )
    from causal_openlock.world.rewards import PAPER_REWARD

    trials = material.trials
    own = trials[trials["learner"] == entry["name"]]
    if own.empty:
        return None
    conditions = {one["name"]: one for one in material.experiment["conditions"]}
    played = set(own["condition"])
    told = next(one for name, one in conditions.items() if name in played)
    mine = own[own["condition"] == told["name"]]
    first = mine[mine["subject"] == mine["subject"].min()].iloc[0]
    reward = reward_from_dict(entry["reward"])
    trace = trace_trial(
        create(entry["learner"], entry["parameters"]),
        condition_from_dict(told),
        protocol_from_dict(entry["protocol"]),
        subject=int(first["subject"]),
        seed=int(first["seed"]),
        # Code of one's own is not run to read results, and those who believe do not heed rewards.
        reward=PAPER_REWARD if reward.depends_on_everything else reward,
        label=entry["name"],
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
    few = record.filter(here).select([*_TOLD, "loop", "attempt", "actions"]).to_pylist()
    mine = [row for row in few if all(row[name] == trial[name] for name in (*_TOLD, "loop"))]
    return [row["actions"] for row in sorted(mine, key=lambda row: row["attempt"])]


def _information(traces: list[Trace]) -> Table:
    """What an action told, attempt by attempt."""
    means = mean_information(information_per_action(traces), ["learner", "attempt"])
    return Table(
        "belief_information",
        "Information gained per action",
        means.drop(columns="subjects"),
        {"predicted": ".2f", "obtained": "+.2f"},
        "Bits that an action was expected to tell and that it told, on average over the actions of "
        "an attempt: by how much less is missing to certainty after it. Below nothing where an "
        "answer left the subject less certain. Actions after which hypotheses were drawn anew do "
        "not count as having told anything.",
    )


def _drawing(trace: Trace, name: str) -> Drawing:
    from causal_openlock.analysis.plots.belief import draw_trace

    drawn = draw_trace(trace)
    label = "belief_" + re.sub(r"\W+", "_", name.lower(), flags=re.ASCII)
    return Drawing(label, f"What {name} believed", drawn.caption, drawn.figure)
