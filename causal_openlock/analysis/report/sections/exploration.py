"""Exploration that shrinks as fast as people's attempts: does anything get learned?

The paper lets epsilon of its DDQN shrink by the decays that it fitted to people, and sees "no
meaningful learning". It does not say with what it shrinks, every action, attempt or trial, so an
experiment can try all of these; the section holds every learner whose epsilon shrinks in some way
against the paper's sentence, beside the fits of
:mod:`~causal_openlock.analysis.results.deep.decay`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.report.sections.learning import LEARNS, progress
from causal_openlock.analysis.results.deep.decay import (
    LEAST_TRIALS,
    PAPER_MEAN,
    PAPER_MEDIAN,
    fitted,
    learning_curves,
    people_over_trials,
    random_actions,
    steps_until,
)
from causal_openlock.analysis.results.deep.visits import FINDS_ALL, OPENS
from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PAPER_ACTION_LIMIT

USUAL = 0.99
"""Slower decays are what the paper calls typical, "to allow exploration for thousands of steps"."""

_SCHEDULE = ("epsilon_start", "epsilon_min", "epsilon_decay", "epsilon_decays_with")
_AFTER = "epsilon_after_trial"


def schedules(experiment: Experiment) -> pd.DataFrame:
    """How every learner that has an epsilon explores.

    Returns:
        One row for each: ``learner``; ``decay``, ``shrinks_with`` and ``after_trial`` (NaN if
        nothing sets epsilon at a trial's end); ``steps``, how often epsilon shrinks until it is
        below one percent; ``first_trial`` and ``later_trial``, how many random actions are to be
        expected in the first trial and in the second.
    """
    rows = []
    for spec in experiment.learners:
        given = spec.parameters
        if given.keys() >= {*_SCHEDULE, _AFTER}:
            limit = spec.protocol.action_limit or PAPER_ACTION_LIMIT
            decay = float(given["epsilon_decay"])
            first, later = random_actions(given, spec.protocol.attempt_limit, limit)
            steps = float(steps_until(decay)) if 0 < decay < 1 else float("nan")
            after = float("nan") if given[_AFTER] is None else float(given[_AFTER])
            shrinks = given["epsilon_decays_with"]
            rows.append((spec.name, decay, shrinks, after, steps, first, later))
    columns = ["learner", "decay", "shrinks_with", "after_trial", "steps"]
    return pd.DataFrame(rows, columns=[*columns, "first_trial", "later_trial"])


def beside_learning(explored: pd.DataFrame, progressed: pd.DataFrame) -> pd.DataFrame:
    """Schedules with what each of them led to.

    Args:
        explored: From :func:`schedules`.
        progressed: From :func:`~causal_openlock.analysis.report.sections.learning.progress`.

    Returns:
        One row for each learner, condition and protocol that both tell of: the columns of
        ``explored``, ``condition``, ``protocol``, ``door`` with ``ci_low`` and ``ci_high`` (share
        of attempts that open the door in the last part of training), ``chance``, the ``verdict``
        on it, ``all`` (share of visits with every solution found, there) and ``all_verdict``.
    """
    key = ["learner", "condition", "protocol"]
    doors = progressed[progressed["measure"] == OPENS]
    doors = doors[[*key, "last", "ci_low", "ci_high", "chance", "verdict"]]
    alls = progressed.loc[progressed["measure"] == FINDS_ALL, [*key, "last", "verdict"]]
    alls = alls.rename(columns={"last": "all", "verdict": "all_verdict"})
    table = explored.merge(doors, on="learner", how="inner", sort=False)
    table = table.rename(columns={"last": "door"}).merge(alls, on=key, how="left", sort=False)
    first = ["learner", "condition", "decay", "shrinks_with", "door", "ci_low", "ci_high"]
    return table[[*first, *(name for name in table if name not in first)]]


def on_meaningful_learning(table: pd.DataFrame) -> list[str]:
    """Whether people's decays lead to no meaningful learning, a sentence for each learner.

    It takes a learner of a usual decay that learns in the same condition to tell. Learning with a
    fast decay is meaningful if the learner learns too and surely opens the door at least half as
    often, and it is not if it surely opens it less than half as often, by the interval of its
    share; else it is undecided.

    Args:
        table: From :func:`beside_learning`.
    """
    said = []
    judged = table.assign(meaning=meanings(table), usual=_usual(table))
    for learner, mine in judged[judged["decay"] <= USUAL].groupby("learner", sort=False):
        row = mine.iloc[0]
        several = mine["meaning"].nunique() > 1
        whole = "not the same in every condition" if several else _PAPER[mine["meaning"].iloc[0]]
        parts = [
            f"in {own['condition']} {own['door']:.1%} ({own['ci_low']:.1%} to "
            f"{own['ci_high']:.1%}) of its last attempts open the door, with a usual decay "
            f"{_share(own['usual'])}{': ' + own['meaning'] if several else ''}"
            for own in mine.to_dict("records")
        ]
        how = f"epsilon shrinks by {row['decay']:g} with every {row['shrinks_with']}"
        said.append(f"{learner} ({how}): {whole}; {'; '.join(parts)}.")
    return said


def meanings(table: pd.DataFrame) -> list[str]:
    """What :func:`on_meaningful_learning` holds each row to be; empty for usual decays.

    Args:
        table: From :func:`beside_learning`.
    """
    rows = table.assign(usual=_usual(table)).to_dict("records")
    return ["" if own["decay"] > USUAL else _meaning(own, own["usual"]) for own in rows]


_NONE, _SOME, _OPEN = "no meaningful learning", "meaningful learning", "undecided"
_PAPER = {
    _NONE: f"{_NONE}, as the paper says",
    _SOME: f"{_SOME}, unlike in the paper",
    _OPEN: _OPEN,
}


def _usual(table: pd.DataFrame) -> list[float]:
    """How often the best learner of a usual decay opens the door there; NaN if none learns."""
    able = table[(table["decay"] > USUAL) & (table["verdict"] == LEARNS)]
    best = able.groupby(["condition", "protocol"])["door"].max().to_dict()
    places = zip(table["condition"], table["protocol"], strict=True)
    return [best.get(place, float("nan")) for place in places]


def _share(usual: float) -> str:
    return "nothing is learned" if usual != usual else f"{usual:.1%}"


def _meaning(own: Mapping[str, Any], usual: float) -> str:
    if own["ci_high"] < usual / 2:  # never, if there is no usual share
        return _NONE
    return _SOME if own["verdict"] == LEARNS and own["ci_low"] >= usual / 2 else _OPEN


def section(material: Material) -> Section | None:
    """How fast people's attempts and learners' exploration shrink.

    Returns:
        None unless learners of the experiment differ in how their exploration shrinks, or someone
        played enough trials under the protocol ``human`` for a curve to be fitted.
    """
    explored = schedules(material.experiment)
    several = len(explored[["decay", "shrinks_with"]].drop_duplicates()) > 1
    curves = {
        f"{learner}, {condition}": values
        for (learner, condition), values in learning_curves(material.trials, HUMAN_PROTOCOL).items()
        if len(values) >= LEAST_TRIALS and (learner, condition) in (material.pairs or ())
    }
    if not several and not curves:
        return None
    people = fitted({f"people, {name}": values for name, values in people_over_trials().items()})
    text, tables = [_on_people(people)], [_fits("people_decay", "People's attempts", people)]
    if curves:
        own = fitted(_in_order(curves, material.learners))
        tables.append(_fits("learners_decay", "Learners' attempts", own))
    if several:
        text.append(_on_steps())
        table = beside_learning(explored, progress(material.trials, material.experiment))
        if len(table):
            text += on_meaningful_learning(table)
            table.insert(7, "meaning", meanings(table))
            if table["protocol"].nunique() == 1:
                table = table.drop(columns="protocol")
            tables.insert(0, _schedules(table))
    return Section("exploration", "How fast exploration shrinks", tuple(text), tuple(tables))


def _in_order(
    curves: Mapping[str, list[float]], learners: tuple[str, ...]
) -> dict[str, list[float]]:
    first = ordered({name.rsplit(", ", 1)[0] for name in curves}, learners)
    return {
        name: curves[name]
        for learner in first
        for name in curves
        if name.rsplit(", ", 1)[0] == learner
    }


def _on_people(people: pd.DataFrame) -> str:
    both = people[people["curve"] == "people, CC3 and CE3 training"].set_index("form")["decay"]
    return (
        f"The paper fits an exponential decay to people's attempts over six training trials: "
        f"{PAPER_MEDIAN} (median), {PAPER_MEAN} (mean). Of the published means of training, CC3 "
        f"and CE3 averaged, least squares of a·dᵗ give d = {both['exponential']:.2f}, a line "
        f"through the logarithms {both['log-linear']:.2f}, and least squares with an offset "
        f"{both['with offset']:.2f}. So {PAPER_MEAN} is of the right size for a fit without an "
        "offset; how the paper fitted cannot be recovered, and medians are not published."
    )


def _on_steps() -> str:
    counts = [f"{steps_until(d)} with {d:g}" for d in (PAPER_MEAN, PAPER_MEDIAN, 0.995)]
    return (
        f"Steps until epsilon, 1 at first, is below one percent: {', '.join(counts)}. If a step is "
        "an action, people's decays end exploration within the first six attempts."
    )


def _fits(name: str, title: str, table: pd.DataFrame) -> Table:
    formats = dict.fromkeys(("decay",), ".3f") | dict.fromkeys(("scale", "offset", "error"), ".2f")
    return Table(
        name,
        title,
        table.assign(near=table["near"].map({True: "yes", False: "no"})),
        formats,
        "Mean attempts by trial as offset + scale · decayᵗ, t = 0 being the first trial; error: "
        f"root mean squared deviation in attempts; near: decay within .035 of {PAPER_MEAN}.",
    )


def _schedules(table: pd.DataFrame) -> Table:
    formats = {"decay": "g", "after_trial": ".2g", "steps": ".0f"}
    formats |= dict.fromkeys(("first_trial", "later_trial"), ".1f")
    formats |= dict.fromkeys(("door", "ci_low", "ci_high", "chance"), ".2%") | {"all": ".1%"}
    return Table(
        "exploration",
        "Exploration and what is learned with it",
        table,
        formats,
        "decay: the factor by which epsilon shrinks; shrinks_with: with every one of these; "
        "after_trial: what epsilon is set to at the end of a trial; steps: until it is below one "
        "percent, from 1; first_trial, later_trial: random actions to be expected in the first "
        "trial and in the second. door: share of attempts that open the door in the last part of "
        "training, with its 95% bootstrap interval; all: share of visits there in which every "
        "solution is found. The verdicts are those of “Which learners learn”. meaning: whether "
        "the door surely comes to be opened less than half as often as by the best learner of a "
        f"decay above {USUAL:g} that learns there, or surely more often.",
    )
