"""What a reader should know before believing the numbers of a report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.results.people.comparable import Pairs
from causal_openlock.analysis.results.people.published import did_what_people_did
from causal_openlock.experiment.protocol import PAPER_CONDITIONS

FEW_SUBJECTS = 20
"""Groups of fewer subjects than this are warned about."""

_SHOWN = 8  # groups named in a warning before "and n more"


def warnings_of(
    trials: pd.DataFrame,
    summary: pd.DataFrame,
    versions: Mapping[str, Any],
    pairs: Pairs | None = None,
) -> list[str]:
    """What a reader should know before believing the numbers, a sentence each.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        summary: From :func:`~causal_openlock.analysis.results.summary.summarise`.
        versions: Versions of packages; a list where cells were run with several.
        pairs: Whom people compare with; None if names decide.
    """
    found = []
    named = summary[did_what_people_did(summary) & summary["condition"].isin(PAPER_CONDITIONS)]
    others = named.loc[~did_what_people_did(named, pairs), CELL].drop_duplicates()
    if len(others):
        names = [_group(key) for key in others.itertuples(index=False)]
        found.append(
            "Some conditions are called like the paper's and have other rooms, trials or budgets, "
            f"so published results are not shown beside them ({some(names)})."
        )
    grouped = summary.groupby(CELL, observed=True)["subjects"]
    who = ["learner", "protocol"]
    least = summary.groupby(who, observed=True)["subjects"].min().sort_values(kind="stable")
    few = least[least < FEW_SUBJECTS]
    if len(few):
        names = [f"{_group(key)}: {count}" for key, count in few.items()]
        found.append(
            f"Fewer than {FEW_SUBJECTS} subjects, so intervals are unreliable ({some(names)})."
        )
    uneven = grouped.min()[grouped.min() != grouped.max()]
    if len(uneven):
        names = [_group(key) for key in uneven.index]
        found.append(
            "Not every subject played every trial, so means of different trials are about "
            f"different subjects ({some(names)})."
        )
    solved = trials.groupby(who, observed=True)["solved"].mean().sort_values(kind="stable")
    if len(unsolved := solved[solved < 1]):
        names = [f"{_group(key)}: {percent(1 - share)}" for key, share in unsolved.items()]
        found.append(
            "Some trials were not solved, so means there are lower than what solving them would "
            f"have taken (share of trials not solved: {some(names)})."
        )
    for package, version in versions.items():
        several = _several(version)
        if len(several) > 1:
            found.append(
                f"Cells were run with different versions of {package} ({', '.join(several)})."
            )
    return found


def _several(version: Any) -> list[str]:
    if isinstance(version, str) or not isinstance(version, Iterable):
        return [str(version)]
    return sorted({str(one) for one in version})


def _group(key: Any) -> str:
    """``ddqn, CC4 (human)``: a learner, perhaps a condition, and a protocol."""
    *names, protocol = map(str, key)
    return f"{', '.join(names)} ({protocol})"


def some(names: Sequence[str]) -> str:
    """A list of names that is cut off when it gets long."""
    more = len(names) - _SHOWN
    shown = "; ".join(names[:_SHOWN])
    return f"{shown}; and {more} more" if more > 0 else shown


def percent(share: float) -> str:
    """A share, such as ``12.5%``; never 0 or 100 where it is not."""
    if 0 < share < 0.0005 or 0.9995 < share < 1:  # some is not none, and not all
        return "<0.1%" if share < 0.5 else ">99.9%"
    return f"{100 * share:.1f}%"
