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
- ``solved``, of a course ``finds_all``: the share of trials in which every solution was found.
- ``found``: solutions found of those to be found.
- ``opens``, ``unlocks``, ``else``, of a course: the shares of attempts that open the door, that
  unlock it and do not open it, and that do neither.

Not stored are ``after_first`` and ``saved_after_first``: attempts from the first solution to the
last, and how many fewer these are than those to the first, where one was found. A policy without
memory needs more, not fewer. Those of theories are in :mod:`evidence.theories`.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.analysis.topics.learning import shares
from causal_openlock.errors import EvidenceError
from causal_openlock.wording import joined
from evidence.published import BLOCK, PUBLISHED, judged, published_units
from evidence.study import ATTRIBUTED, COURSE, EVERYONE, TOLD, TRIALS, selection

KEYS = [*CELL, "phase"]


def units_of(trials: pd.DataFrame, measured: str) -> pd.DataFrame:
    """A row for each subject and trial, or part of a course or a curve (``measured``)."""
    when, measures = "trial" if measured == "trials" else "part", [*TRIALS]
    if measured == "course":
        measures = [*COURSE]
        table = shares(trials).rename(columns={"visits": "trials"})
    else:
        share = trials["solutions_found"] / trials["solutions"]
        trials = trials.assign(solved=trials["solved"].astype(float), found=share)
        if measured == "curve":
            place = trials.groupby([*KEYS, *SUBJECT], observed=True).cumcount()
            trials["part"] = place // BLOCK + 1
        grouped = trials.groupby([*KEYS, when, *SUBJECT], observed=True, sort=True)
        table = grouped[measures].mean().assign(trials=grouped.size()).reset_index()
    table = table.rename(columns={"subject": "unit"})
    table["judged"] = judged(table, table[when], CELL)
    columns = [*KEYS, when, "judged", "unit", "trials", *measures]
    units: pd.DataFrame = table[columns].astype(dict.fromkeys(KEYS, str))
    return units


def of_network(units: pd.DataFrame, label: str, number: int) -> pd.DataFrame:
    """The subjects of one network averaged: the network is the unit."""
    units = units.assign(learner=label, unit=number)
    by = list(units.columns[: units.columns.get_loc("trials")])
    grouped = units.groupby(by, sort=True)
    means = grouped.mean(numeric_only=True).assign(trials=grouped["trials"].sum())
    return means.reset_index()[list(units.columns)]


def with_differences(units: pd.DataFrame) -> pd.DataFrame:
    """Units with the measures that are not stored; rows are then selected by categories."""
    if "first_solution" in units:
        rest = (units["attempts"] - units["first_solution"]).where(units["found"] > 0)
        units = units.assign(after_first=rest, saved_after_first=units["first_solution"] - rest)
    return units.astype(dict.fromkeys(KEYS, "category"))


def selected(units: pd.DataFrame, words: str, measure: str) -> pd.Series[float]:
    """A measure of each unit that is selected, averaged over several conditions or times.

    A unit counts if it has all that is asked for: a condition that it has not played cannot be
    averaged over.

    Units are those of :func:`with_differences`; of what is published none are needed.

    Raises:
        EvidenceError: If the study has no such learner, condition or measure.
    """
    wanted = selection(words)
    (learner,) = wanted["learner"]
    rows = published_units() if learner in PUBLISHED else units
    keep = np.ones(len(rows), dtype=bool)
    if not {"phase", "trial", "part"} & {*wanted}:
        keep = rows["judged"].to_numpy(bool)
    if learner == EVERYONE:  # all theories, and not the learners that are none
        del wanted["learner"]
        keep = keep & rows[[*ATTRIBUTED]].notna().any(axis=1).to_numpy()
    for column, values in wanted.items():
        has = [keep & (column in rows and (rows[column] == value).to_numpy()) for value in values]
        if missing := [str(one) for one, mask in zip(values, has, strict=True) if not mask.any()]:
            raise EvidenceError(f"no unit has been run with {column} {joined(missing)}")
        keep = np.logical_or.reduce(has)
    if measure not in rows or rows[measure][keep].isna().all():
        raise EvidenceError(f"{measure} was not measured of {learner}")
    values = rows[measure].to_numpy(float)[keep]
    unit = rows["unit"].to_numpy()[keep]
    if measure in (*ATTRIBUTED, *TOLD):  # every row is a unit, but two halves are of one group
        unit = np.arange(len(values))
        if measure == "halves":
            unit = rows.groupby(CELL, observed=True).ngroup().to_numpy()[keep]
        return pd.Series(values).groupby(unit).mean().dropna()
    if len(np.unique(unit)) == len(unit):
        return pd.Series(values, unit).dropna().sort_index()
    condition = rows["condition"][keep].astype(str).to_numpy()
    each = pd.Series(values).groupby([unit, condition]).mean().unstack().dropna()
    if each.empty:
        raise EvidenceError(f"no unit has been run with {joined([*each.columns])} together")
    return each.mean(axis=1).astype(float)
