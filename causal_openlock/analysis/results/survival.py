"""How many trials are not solved yet after so many attempts: the Kaplan-Meier estimate.

A mean counts a trial that was not solved as the limit, and hides how many these are. Survival
analysis does not: a trial at the limit is *censored*, which says that it took more attempts than
that, and nothing else. Of the trials that were still going on before an attempt, some share is
solved by it; the product of what is left is the share of trials that survive.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SUBJECT
from causal_openlock.analysis.results.summary import judged
from causal_openlock.analysis.statistics import SEED, bootstrap_interval
from causal_openlock.schemas.fsm import FloatArray, IntArray


def unsolved_after(trials: pd.DataFrame) -> pd.DataFrame:
    """The share of trials not solved after each attempt, of those a condition is judged by.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.

    Returns:
        A row for each ``learner``, ``condition``, ``protocol`` and number of ``attempts``, from 0
        to the most that one of its trials had: ``unsolved`` (a share), ``ci_low`` and ``ci_high``
        (95% bootstrap over subjects; NaN for one subject), ``subjects`` and ``at_risk``, how many
        trials were neither solved nor censored before that attempt.
    """
    parts = []
    for key, own in judged(trials).groupby(CELL, observed=True, sort=True):
        subject = own.groupby(SUBJECT, observed=True).ngroup().to_numpy()
        ended, solved = own["attempts"].to_numpy(), own["solved"].to_numpy()
        size, length = subject.max() + 1, ended.max() + 1
        events = np.zeros((size, length), np.int64)
        np.add.at(events, (subject[solved], ended[solved]), 1)
        left = np.zeros((size, length), np.int64)
        np.add.at(left, (subject, ended), 1)
        risk = left[:, ::-1].cumsum(axis=1)[:, ::-1]  # those that end at an attempt, or later
        low, high = bootstrap_interval(
            lambda drawn, e=events, r=risk: kaplan_meier(drawn @ e, drawn @ r).swapaxes(-1, -2),
            [np.ones(size, np.int64)],  # each subject once
            np.random.default_rng(SEED),
            counted=True,
        )
        share = kaplan_meier(events.sum(axis=0), risk.sum(axis=0))
        rows = pd.DataFrame({"attempts": np.arange(length), "unsolved": share})
        rows = rows.assign(ci_low=low, ci_high=high, subjects=size, at_risk=risk.sum(axis=0))
        parts.append(rows.assign(**dict(zip(CELL, map(str, key), strict=True))))
    columns = [*CELL, "attempts", "unsolved", "ci_low", "ci_high", "subjects", "at_risk"]
    return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)


def kaplan_meier(events: IntArray, at_risk: IntArray) -> FloatArray:
    """The share that survives.

    >>> kaplan_meier(np.array([0, 1, 0, 1]), np.array([4, 4, 3, 2])).tolist()
    [1.0, 0.75, 0.75, 0.375]

    Args:
        events: ``[..., T]`` how many ended at each time.
        at_risk: ``[..., T]`` how many had neither ended nor been lost before.
    """
    kept = 1 - events / np.maximum(at_risk, 1)
    return np.cumprod(kept, axis=-1, dtype=np.float64)
