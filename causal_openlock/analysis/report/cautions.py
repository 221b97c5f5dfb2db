"""What a reader should know before believing the numbers of a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.report.prose import Prose, percent
from causal_openlock.analysis.results.people.published import Pairs, did_what_people_did
from causal_openlock.experiment.protocol import PAPER_CONDITIONS

FEW_SUBJECTS = 20
"""Groups of fewer subjects than this are warned about."""


def warnings_of(
    trials: pd.DataFrame,
    summary: pd.DataFrame,
    versions: Mapping[str, Any],
    pairs: Pairs | None = None,
) -> tuple[str, ...]:
    """What a reader should know before believing the numbers, a sentence each.

    Versions of a package are a list where cells were run with several; without ``pairs`` names
    decide which learners compare with people.
    """
    named = summary[did_what_people_did(summary) & summary["condition"].isin(PAPER_CONDITIONS)]
    others = named.loc[~did_what_people_did(named, pairs), CELL].drop_duplicates()
    of_learner = ["learner", "protocol"]
    subjects = summary.groupby(CELL, observed=True)["subjects"].agg(["min", "max"])
    fewest = summary.groupby(of_learner, observed=True)["subjects"].min()
    solved = trials.groupby(of_learner, observed=True)["solved"].mean()
    several = {name: _several(version) for name, version in versions.items()}
    return Prose("cautions").paragraphs(
        "cautions",
        others=[_label(key) for key in others.itertuples(index=False)],
        least=FEW_SUBJECTS,
        few=_by_label(fewest[fewest < FEW_SUBJECTS]),
        uneven=[_label(key) for key in subjects.index[subjects["min"] != subjects["max"]]],
        unsolved={
            name: percent(1 - share) for name, share in _by_label(solved).items() if share < 1
        },
        versions={name: found for name, found in several.items() if len(found) > 1},
    )


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
