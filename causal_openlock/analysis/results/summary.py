"""The tables of results, with references: of every trial, and of every condition.

Learners that played as people did are compared with people and a published model (see
:mod:`~causal_openlock.analysis.results.references`), and wherever it is known what the ideal
observer needs (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, by_subject, judged, mean_by_trial, measured
from causal_openlock.analysis.results.bounds import Bounds
from causal_openlock.analysis.results.references import Reference, with_references
from causal_openlock.analysis.statistics import mean_intervals

SUMMARY_COLUMNS = (
    *(*CELL, "phase", "trial", "loops", "subjects"),
    *("attempts", "se", "ci_low", "ci_high", "mode", "at_mode", "share_solved"),
)  #: the first columns of :func:`summarise`; those of references and ``ideal_attempts`` follow


def summarise(
    trials: pd.DataFrame, references: Sequence[Reference] = (), bounds: Bounds | None = None
) -> pd.DataFrame:
    """Every trial of every condition, of trials that are counted already.

    A protocol with loops visits a trial number many times; a subject's visits are averaged first,
    so a row is about one trial number over all loops, and every subject counts once.

    Returns:
        One row for each ``learner``, ``condition``, ``protocol``, ``phase`` and ``trial``, with

        - ``loops``: visits that were averaged (the most of any subject).
        - ``subjects``: how many.
        - ``attempts``: mean attempts to solve the trial; an unsolved trial counts as the limit.
        - ``se``: population SD / √subjects, as the paper's error bars.
        - ``ci_low``, ``ci_high``: 95% interval (Student's) over subjects; NaN for fewer than five,
          or where 90% of them have one value.
        - ``mode``, ``at_mode``: the most common value of subjects, and how many have it.
        - ``share_solved``: share of visits in which every solution was found, from 0 to 1.
        - ``human_attempts``, ``human_se``: people's, as published; NaN where there are none.
        - ``difference``: ``attempts`` minus ``human_attempts``.
        - ``model_attempts``, ``model_se``: the published model's, where people's are.
        - ``NAME_attempts``, ``NAME_se``, ``NAME_difference``: the same of each further reference.
        - ``ideal_attempts``: what the ideal observer needs, which knows the schema; NaN if that is
          not known.
    """
    table, added = _means(trials, references, bounds)
    return table.rename(columns={"visits": "loops"})[[*SUMMARY_COLUMNS, *added]]


def headline(
    trials: pd.DataFrame, references: Sequence[Reference] = (), bounds: Bounds | None = None
) -> pd.DataFrame:
    """The result of each learner in each condition, of trials that are counted already.

    Returns:
        One row for each ``learner``, ``protocol`` and ``condition``, with ``measured`` (such as
        ``trial 5`` or ``test``), ``subjects``, ``attempts``, ``ci_low``, ``ci_high``, ``mode``,
        ``at_mode``, ``share_solved``, the columns of references and ``ideal_attempts`` as in
        :func:`summarise`.
    """
    table, added = _means(judged(trials), references, bounds)
    table = table.assign(measured=measured(table)).sort_values(
        ["learner", "protocol", "condition"], kind="stable", ignore_index=True
    )
    first = ["learner", "protocol", "condition", "measured", "subjects", "attempts"]
    return table[[*first, "ci_low", "ci_high", "mode", "at_mode", "share_solved", *added]]


def _means(
    trials: pd.DataFrame,
    references: Sequence[Reference],
    bounds: Bounds | None,
) -> tuple[pd.DataFrame, list[str]]:
    """The means of each trial, and the names of the columns of references and ideal attempts."""
    by = ["phase", "trial"]
    means = mean_by_trial(trials, by).rename(columns={"mean": "attempts"})
    intervals = mean_intervals(by_subject(trials, by), [*CELL, *by], "attempts")
    table = means.assign(**intervals[["ci_low", "ci_high", "mode", "at_mode"]])
    keys = zip(
        *(table[name].astype(str) for name in ("condition", "protocol", "phase")), strict=True
    )
    known = [(bounds or {}).get(key) for key in keys]
    ideal = [np.nan if one is None else one.attempts for one in known]
    table, added = with_references(table, references)
    return table.assign(ideal_attempts=np.array(ideal, float)), [*added, "ideal_attempts"]


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as mappings, with None for what does not exist."""
    return table.astype(object).where(table.notna(), None).to_dict("records")
