"""Units of a run that a study stores: a row for each thing that was drawn independently.

A subject that learns alone is such a unit. Subjects that share the weights of one trained network
are not: they say how that network plays, and nothing about another training. There the network is
the unit, and its subjects are averaged.

Columns of ``units.parquet``: ``learner``, ``condition``, ``protocol``, ``phase``; ``trial`` (of
people's protocol) or ``part`` (of a long course, see
:mod:`~causal_openlock.analysis.topics.learning`; of a curve, fifty trials); ``judged``,
whether a condition is judged by this row; ``unit``, the number of the subject or of the network,
``trials``, how many of its trials, or of its subjects', were averaged; and the measures:

- ``attempts``, ``first_solution``: attempts to find every solution and the first one; a trial that
  was not solved counts as its limit.
- ``first``, ``second``, ``third``: attempts for that solution since the one before, in trials in
  which it was found. Units that were stored before there were these measures lack them.
- ``after_first``, ``saved_after_first``, not stored: attempts from the first solution to the last,
  and how many fewer these are than those to the first, where one was found. A policy without memory
  needs more, not fewer.
- ``solved``, of a course ``finds_all``: the share of trials in which every solution was found.
- ``found``: solutions found of those to be found.
- ``opens``, ``unlocks``, ``else``, of a course: the shares of attempts that open the door, that
  unlock it and do not open it, and that do neither.

Those of a recovery and of a design are in :mod:`~causal_openlock.evidence.confusions`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SOLUTIONS, SUBJECT
from causal_openlock.analysis.topics.learning import shares
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.study import (
    AFTER,
    ATTEMPTS,
    BLOCK,
    COURSE,
    EVERYONE,
    RECOVERED,
    SAVED,
    TOLD,
    TRIALS,
    Selection,
)
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.wording import joined

KEYS = [*CELL, "phase"]


def units_of(trials: pd.DataFrame, measured: str) -> pd.DataFrame:
    """A row for each subject and trial, or part of a course.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        measured: ``"trials"``, ``"course"`` or ``"curve"``.
    """
    if measured == "course":
        when, measures = "part", [*COURSE]
        table = shares(trials).rename(columns={"visits": "trials"})
    else:
        when, measures = "part" if measured == "curve" else "trial", [*TRIALS, *SOLUTIONS]
        each = trials.assign(
            solved=trials["solved"].astype(float),
            found=trials["solutions_found"] / trials["solutions"],
        )
        if when == "part":
            each["part"] = each.groupby([*KEYS, *SUBJECT], observed=True).cumcount() // BLOCK + 1
        by = [*KEYS, when, *SUBJECT]
        grouped = each.groupby(by, observed=True, sort=True)
        table = grouped[measures].mean().assign(trials=grouped.size()).reset_index()
    table = table.rename(columns={"subject": "unit"})
    table["judged"] = _judged(table, when)
    columns = [*KEYS, when, "judged", "unit", "trials", *measures]
    kept: pd.DataFrame = table[columns].astype(dict.fromkeys(KEYS, str))
    return kept


def of_network(units: pd.DataFrame, label: str, number: int) -> pd.DataFrame:
    """The subjects of one network averaged: the network is the unit."""
    own = units.assign(learner=label, unit=number)
    by = list(own.columns[: own.columns.get_loc("trials")])
    grouped = own.groupby(by, sort=True)
    means = grouped.mean(numeric_only=True).assign(trials=grouped["trials"].sum())
    return means.reset_index()[list(own.columns)]


def _judged(table: pd.DataFrame, when: str) -> BoolArray:
    """Whether a condition is judged by a row: those of its test, or the end of a baseline."""
    groups = table.groupby(CELL, observed=True)
    tested = groups["phase"].transform(lambda phase: (phase == "test").any()).astype(bool)
    last = table[when] == groups[when].transform("max")
    judged: BoolArray = np.where(tested, table["phase"] == "test", last)
    return judged


def selected(units: pd.DataFrame, selection: Selection, measure: str) -> pd.Series[float]:
    """A measure of each unit that is selected, averaged over several conditions or times.

    A unit counts if it has all that is asked for: a condition that it has not played cannot be
    averaged over.

    Raises:
        EvidenceError: If the study has no such learner, condition or measure.
    """
    conditions = selection.condition
    everyone = selection.learner == EVERYONE and measure in (*RECOVERED, *TOLD)
    wanted: dict[str, Any] = {
        "learner": [] if everyone else [selection.learner],
        "condition": [conditions] if isinstance(conditions, str) else conditions,
        "phase": selection.phase and [selection.phase],
        "trial": selection.trial and [selection.trial],
        "part": selection.part and [selection.part],
        "parameter": selection.parameter and [selection.parameter],
    }
    if selection.phase or selection.trial or selection.part:
        kept = np.ones(len(units), dtype=bool)
    else:
        kept = units["judged"].to_numpy(bool)
    for column, values in wanted.items():
        if not values:
            continue
        found = {
            value: kept & (column in units and (units[column] == value).to_numpy(bool))
            for value in values
        }
        if missing := [str(value) for value, there in found.items() if not there.any()]:
            raise EvidenceError(f"no unit has been run with {column} {joined(missing)}")
        kept = np.logical_or.reduce([*found.values()])
    needed = {*("unit", "condition", "found", *ATTEMPTS), measure}
    rows = units.loc[kept, [name for name in units if name in needed]]
    if measure in (AFTER, SAVED) and "first_solution" in rows:
        rows = rows[rows["found"] > 0]
        rest = rows["attempts"] - rows["first_solution"]
        rows = rows.assign(**{AFTER: rest, SAVED: rows["first_solution"] - rest})
    if measure not in rows or rows[measure].isna().all():
        raise EvidenceError(f"{measure} was not measured of {selection.learner}")
    if measure in (*RECOVERED, *TOLD):  # every row is a unit
        if everyone and measure in TOLD:  # of theories alone
            rows = rows[units.loc[rows.index, "information"].notna()]
        return rows[measure].dropna().reset_index(drop=True).astype(float)
    played = rows["condition"].unique()
    if len(played) == 1 and rows["unit"].is_unique:  # most often; groups take most of the time
        each = rows.set_index("unit").sort_index()[[measure]].dropna()
    else:
        each = rows.groupby(["unit", "condition"], observed=True)[measure].mean().unstack().dropna()
    if each.empty:
        raise EvidenceError(f"no unit has been run with {joined([*map(str, played)])} together")
    return each.mean(axis=1).astype(float)
