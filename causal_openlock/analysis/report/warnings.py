"""Warnings to read before believing the numbers of a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.references import Beside, Reference, beside_any
from causal_openlock.analysis.statistics import FEW_SUBJECTS
from causal_openlock.analysis.table import percent


def warnings_of(
    trials: pd.DataFrame,
    summary: pd.DataFrame,
    versions: Mapping[str, Any],
    references: Sequence[Beside] = (),
    given: Sequence[Reference] = (),
) -> tuple[str, ...]:
    """Warnings to read before believing the numbers, a sentence each.

    Versions of a package are a list where cells were run with several.
    """
    published = [one for one in references if one.reference not in given]
    named = np.zeros(len(summary), bool)
    for one in published:
        called = summary["condition"].isin(one.reference.points["condition"]).to_numpy()
        named |= called & Beside(one.reference, None).stands(summary)
    others = summary.loc[named & ~beside_any(summary, published), CELL].drop_duplicates()
    own = [one for one in references if one.reference in given]
    of_learner = ["learner", "protocol"]
    subjects = summary.groupby(CELL, observed=True)["subjects"].agg(["min", "max"])
    fewest = summary.groupby(of_learner, observed=True)["subjects"].min()
    solved = trials.groupby(of_learner, observed=True)["solved"].mean()
    several = {name: _several(version) for name, version in versions.items()}
    return Prose(__name__).paragraphs(
        "warnings",
        others=[_label(key) for key in others.itertuples(index=False)],
        alone=[one.reference.name for one in own if not one.stands(summary).any()],
        least=FEW_SUBJECTS,
        few=_by_label(fewest[fewest < FEW_SUBJECTS]),
        uneven=[_label(key) for key in subjects.index[subjects["min"] != subjects["max"]]],
        unsolved={
            name: percent(1 - share) for name, share in _by_label(solved).items() if share < 1
        },
        versions={name: found for name, found in several.items() if len(found) > 1},
    )


def not_applicable(reasons: Iterable[str]) -> tuple[str, ...]:
    """Say why learners have no results, where they cannot play: a dash in tables.

    >>> not_applicable(["ideal cannot play in rooms of wide: they are too many"])
    ('Not applicable (–): ideal cannot play in rooms of wide: they are too many.',)
    """
    return tuple(f"Not applicable (–): {why}." for why in reasons)


def _by_label(values: pd.Series) -> dict[str, Any]:
    """Values by group, the lowest first."""
    ordered = values.sort_values(kind="stable")
    return {_label(key): value for key, value in ordered.items()}


def _label(key: Any) -> str:
    """``ddqn, CC4 (human)``: a learner, perhaps a condition, and a protocol."""
    *names, protocol = map(str, key)
    return f"{', '.join(names)} ({protocol})"


def _several(version: Any) -> list[str]:
    if isinstance(version, str) or not isinstance(version, Iterable):
        return [str(version)]
    return sorted({str(one) for one in version})
