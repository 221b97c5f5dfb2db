"""Warnings to read before believing the numbers of a report."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.report.about_people import exclusions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import beside_any
from causal_openlock.analysis.statistics import FEW_SUBJECTS
from causal_openlock.analysis.table import share
from causal_openlock.experiment.declare import HUMAN_PROTOCOL
from causal_openlock.wording import some


def warnings_of(results: Material) -> Iterator[str]:
    """Warnings to read before believing the numbers, a sentence each."""
    summary, trials = results.summary, results.counts.trials
    yield from results.experiment.warned
    yield from exclusions(results)
    if others := _called_alike(results):
        yield (
            "Some conditions are called like the paper's and have other rooms, trials or budgets, "
            f"so published results are not shown next to them ({some(others)})."
        )
    of_learner = ["learner", "protocol"]
    fewest = summary.groupby(of_learner, observed=True)["subjects"].min()
    if few := _by_label(fewest[fewest < FEW_SUBJECTS]):
        yield f"Fewer than {FEW_SUBJECTS} subjects, so intervals are unreliable ({some(few)})."
    subjects = summary.groupby(CELL, observed=True)["subjects"].agg(["min", "max"])
    if uneven := [*map(_label, subjects.index[subjects["min"] != subjects["max"]])]:
        yield (
            "Not every subject played every trial, so means of different trials are about "
            f"different subjects ({some(uneven)})."
        )
    solved = trials.groupby(of_learner, observed=True)["solved"].mean()
    if unsolved := _by_label(solved[solved < 1]):
        shares = {name: share(1 - solved) for name, solved in unsolved.items()}
        yield (
            "Some trials were not solved, so means there are lower than what solving them would "
            "have taken (share of all trials that were not solved, training included: "
            f"{some(shares)})."
        )
    for package, versions in results.experiment.versions.items():
        if not isinstance(versions, str):
            several = ", ".join(sorted(versions))
            yield f"Cells were run with different versions of {package} ({several})."


def not_applicable(reasons: Iterable[str]) -> tuple[str, ...]:
    """Say why learners have no results, where they cannot play: a dash in tables.

    >>> not_applicable(["ideal cannot play in rooms of wide: they are too many"])
    ('Not applicable (–): ideal cannot play in rooms of wide: they are too many.',)
    """
    return tuple(f"Not applicable (–): {why}." for why in reasons)


def _called_alike(results: Material) -> list[str]:
    """Cells of conditions that are called like published ones, and are others."""
    summary = results.summary
    named = np.zeros(len(summary), bool)
    for one in results.references:
        named |= summary["condition"].isin(one.reference.points["condition"]).to_numpy()
    named &= (summary["protocol"] == HUMAN_PROTOCOL).to_numpy()
    others = summary.loc[named & ~beside_any(summary, results.references), CELL].drop_duplicates()
    return [_label(key) for key in others.itertuples(index=False)]


def _by_label(values: pd.Series) -> dict[str, Any]:
    """Values by group, the lowest first."""
    return {_label(key): value for key, value in values.sort_values(kind="stable").items()}


def _label(key: Any) -> str:
    """``ddqn, CC4 (human)``: a learner, perhaps a condition, and a protocol."""
    *names, protocol = map(str, key)
    return f"{', '.join(names)} ({protocol})"
