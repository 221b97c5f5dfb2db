"""Exploration that shrinks as fast as people's attempts: does anything get learned?

The paper lets epsilon of its DDQN shrink by the decays that it fitted to people, and sees "no
meaningful learning". It does not say with what it shrinks, every action, attempt or trial, so an
experiment can try all of these; the section holds every learner whose epsilon shrinks in some way
against the paper's sentence, beside the fits of
:mod:`~causal_openlock.analysis.results.deep.decay`.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionTable
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
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.people.published import HUMAN_PROTOCOL
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PAPER_ACTION_LIMIT

USUAL = 0.99
"""Slower decays are what the paper calls typical, "to allow exploration for thousands of steps"."""

NONE, SOME, OPEN = "no meaningful learning", "meaningful learning", "undecided"

_PROSE = Prose("exploration")
_SCHEDULES = {
    **{"decay": "g", "after_trial": ".2g", "steps": ".0f", "all": ".1%"},
    **dict.fromkeys(("first_trial", "later_trial"), ".1f"),
    **dict.fromkeys(("door", "ci_low", "ci_high", "chance"), ".2%"),
}
_FITS = {"decay": ".3f", **dict.fromkeys(("scale", "offset", "error"), ".2f")}
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


def changing(explored: pd.DataFrame) -> bool:
    """Whether an epsilon shrinks at all, of those of :func:`schedules`."""
    return bool(((explored["decay"] != 1) | explored["after_trial"].notna()).any())


def beside_learning(explored: pd.DataFrame, progressed: pd.DataFrame) -> pd.DataFrame:
    """Schedules with what each of them led to.

    Returns:
        One row for each learner, condition and protocol that both tables have: the columns of
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


def meanings(table: pd.DataFrame) -> pd.Series:
    """Whether each fast decay leads to meaningful learning; empty for usual decays.

    It takes a learner of a usual decay that learns in the same condition to say so. Learning with a
    fast decay is meaningful if the learner learns too and surely opens the door at least half as
    often, and it is not if it surely opens it less than half as often, by the interval of its
    share; else it is undecided.

    Args:
        table: From :func:`beside_learning`, with ``usual``, the share with a usual decay.
    """
    half = table["usual"] / 2
    some = (table["verdict"] == LEARNS) & (table["ci_low"] >= half)
    found = np.where(table["ci_high"] < half, NONE, np.where(some, SOME, OPEN))
    return pd.Series(np.where(table["decay"] > USUAL, "", found), table.index)


def _usual(table: pd.DataFrame) -> pd.Series:
    """How often the best learner of a usual decay opens the door there; NaN if none learns."""
    able = table["door"].where((table["decay"] > USUAL) & (table["verdict"] == LEARNS))
    return able.groupby([table["condition"], table["protocol"]]).transform("max")


def section(material: Material) -> Section | None:
    """How fast people's attempts and learners' exploration shrink.

    Returns:
        None unless a learner's exploration shrinks, and learners differ in how it does or someone
        played enough trials under the protocol ``human`` for a curve to be fitted.
    """
    explored = schedules(material.experiment)
    several = len(explored[["decay", "shrinks_with"]].drop_duplicates()) > 1
    curves = {
        f"{learner}, {condition}": values
        for (learner, condition), values in learning_curves(material.trials, HUMAN_PROTOCOL).items()
        if len(values) >= LEAST_TRIALS and (learner, condition) in (material.like_people or ())
    }
    if not changing(explored) or not (several or curves):
        return None
    people = fitted({f"people, {name}": values for name, values in people_over_trials().items()})
    tables = [_fits("people_decay", people)]
    if curves:
        tables.append(_fits("learners_decay", fitted(curves)))
    learned = pd.DataFrame()
    if several:
        learned = beside_learning(explored, progress(material.trials, material.experiment))
    if len(learned):
        usual = _usual(learned)
        learned.insert(7, "meaning", meanings(learned.assign(usual=usual)))
        one = learned["protocol"].nunique() == 1
        shown = learned.drop(columns="protocol") if one else learned
        tables.insert(0, _PROSE.table("exploration", shown, _SCHEDULES, usual=USUAL))
        learned = learned.assign(usual=usual)[learned["decay"] <= USUAL]
    paper = people[people["curve"] == "people, CC3 and CE3 training"].set_index("form")["decay"]
    return _PROSE.section(
        "exploration",
        tables,
        mean=PAPER_MEAN,
        median=PAPER_MEDIAN,
        fits=paper.to_dict(),
        steps={d: steps_until(d) for d in (PAPER_MEAN, PAPER_MEDIAN, 0.995)} if several else {},
        learners=[own.to_dict("records") for _, own in learned.groupby("learner", sort=False)]
        if len(learned)
        else [],
    )


def _fits(name: str, table: pd.DataFrame) -> SectionTable:
    frame = table.assign(near=np.where(table["near"], "yes", "no"))
    return _PROSE.table(name, frame, _FITS, mean=PAPER_MEAN)
