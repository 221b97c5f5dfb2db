"""Learners against learners, paired by subject: the same number, the same room.

A condition is judged by one number of each subject: the attempts in its test, or in the last trial
of a baseline. Subjects of the same number meet the same rooms in the same order, whatever learner
they are of, so that rooms that are harder are harder for both: a comparison is the mean of the
differences of such pairs, the mean over conditions. Where learners share no rooms, their subjects
count as independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Difference, Group, weighted_difference
from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT
from causal_openlock.analysis.results.summary import judged

Outcomes = Mapping[str, Mapping[str, pd.DataFrame]]
"""By learner, by condition, from :func:`outcomes`."""

PAIR_COLUMNS = [
    *("learner", "other", "conditions", "pairs"),
    *("difference", "ci_low", "ci_high", "p", "probability"),
]
"""Columns of :func:`pairwise_table`."""


def outcomes(trials: pd.DataFrame, protocol: str) -> dict[str, dict[str, pd.DataFrame]]:
    """What subjects came to in the trials that conditions are judged by, under a protocol.

    Returns:
        By learner, by condition: a row for each subject with the means over its trials of
        ``attempts``, ``solved``, ``found`` (solutions) and ``solutions``. The index is what pairs
        subjects of different learners: seed, subject, the first layout and how many trials.
    """
    rows = judged(trials[trials["protocol"] == protocol]).sort_values(VISIT, kind="stable")
    grouped = rows.assign(layout=rows["layout"].astype(str)).groupby(
        ["learner", "condition", *SUBJECT], observed=True, sort=True
    )
    table = grouped.agg(
        layout=("layout", "first"),
        trials=("layout", "size"),
        attempts=("attempts", "mean"),
        solved=("solved", "mean"),
        found=("solutions_found", "mean"),
        solutions=("solutions", "mean"),
    ).reset_index()
    parts = [table.pop(name).astype(str) for name in (*SUBJECT[1:], "layout", "trials")]
    table.index = pd.Index(parts[0].str.cat(parts[1:], sep="/"), name="paired by")
    table = table.drop(columns=SUBJECT[0])
    held: dict[str, dict[str, pd.DataFrame]] = {}
    for (learner, condition), own in table.groupby(["learner", "condition"], observed=True):
        held.setdefault(str(learner), {})[str(condition)] = own.drop(columns=CELL[:2])
    return held


def compared(
    one: Mapping[str, pd.DataFrame], other: Mapping[str, pd.DataFrame]
) -> tuple[Difference, int, float]:
    """How many attempts more the one learner needs than the other, over their common conditions.

    Returns:
        The difference; how many pairs of subjects it is of (0 where they share no rooms); and how
        probable it is that a subject of the one needs fewer attempts than its pair, or than any
        subject of the other; ties count half.
    """
    common = [name for name in one if name in other]
    groups, wins, pairs = [], [], 0
    for name in common:
        first, second = one[name]["attempts"], other[name]["attempts"]
        shared = first.index.intersection(second.index)
        weight = 1 / len(common)
        if len(shared):
            gap = (first[shared] - second[shared]).to_numpy(float)
            groups.append(Group.of(weight, gap))
            pairs += len(gap)
        else:
            values = first.to_numpy(float), second.to_numpy(float)
            groups += [Group.of(weight, values[0]), Group.of(-weight, values[1])]
            gap = np.subtract.outer(*values)
        wins.append(float(np.mean((gap < 0) + (gap == 0) / 2)))
    return weighted_difference(groups), pairs, float(np.mean(wins)) if wins else np.nan


def pairwise_table(held: Outcomes) -> pd.DataFrame:
    """Every two learners that played a condition in common, each pair once.

    Args:
        held: From :func:`outcomes`, in the order of learners.

    Returns:
        A row for each pair with the columns :data:`PAIR_COLUMNS`: ``learner``, ``other``,
        ``conditions`` (how many in common), ``pairs`` (of subjects), ``difference`` (by how many
        attempts the learner needs more than the other) with its 95% interval ``ci_low`` and
        ``ci_high``, ``p`` (as if it were the only comparison) and ``probability`` (that a subject
        of the learner needs fewer attempts than one of the other).
    """
    rows = []
    for one, other in combinations(held, 2):
        common = len(held[one].keys() & held[other].keys())
        if common:
            found, pairs, wins = compared(held[one], held[other])
            rows.append((one, other, common, pairs, *found, wins))
    return pd.DataFrame(rows, columns=PAIR_COLUMNS)
