"""The tables of results, with published results beside them.

What people did, and what a published model of them did, stands beside whoever did the same (see
:mod:`~causal_openlock.analysis.results.people.published`), and what the ideal observer needs
wherever it is known (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import (
    CELL,
    attempts_to_solve,
    by_subject,
    mean_by_trial,
)
from causal_openlock.analysis.results.bounds import Bounds, ideal_bounds
from causal_openlock.analysis.results.people.comparable import Pairs, comparable
from causal_openlock.analysis.results.people.published import PUBLISHED_COLUMNS, beside_published
from causal_openlock.analysis.statistics import mean_intervals
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import cell

if TYPE_CHECKING:
    import pyarrow as pa

SUMMARY_COLUMNS = (
    *CELL,
    "phase",
    "trial",
    "loops",
    "subjects",
    "attempts",
    "se",
    "ci_low",
    "ci_high",
    "share_solved",
    *PUBLISHED_COLUMNS,
    "ideal_attempts",
)


def summary_table(record: pa.Table, experiment: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """Every trial of every condition: how many attempts it took, and how that compares.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        experiment: The description of what was run, which tells whom people compare with; without
            it names do.

    Returns:
        See :func:`summarise`.
    """
    known = experiment or {}
    return summarise(attempts_to_solve(record), comparable(known), ideal_bounds(known))


def summarise(
    trials: pd.DataFrame, pairs: Pairs | None = None, bounds: Bounds | None = None
) -> pd.DataFrame:
    """The summary of trials that are counted already.

    A protocol with loops visits a trial number many times; a subject's visits are averaged first,
    so a row is about one trial number over all loops, and every subject counts once.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        pairs: Whom people compare with, from
            :func:`~causal_openlock.analysis.results.people.comparable.comparable`; by default
            whoever played a condition of the paper's name under ``human``.
        bounds: What the ideal observer needs, from
            :func:`~causal_openlock.analysis.results.bounds.ideal_bounds`.

    Returns:
        One row for each ``learner``, ``condition``, ``protocol``, ``phase`` and ``trial``, with

        - ``loops``: visits that were averaged (the most of any subject).
        - ``subjects``: how many.
        - ``attempts``: mean attempts to solve the trial; an unsolved trial counts as the limit.
        - ``se``: population SD / √subjects, as the paper's error bars.
        - ``ci_low``, ``ci_high``: 95% bootstrap interval over subjects; NaN for one subject.
        - ``share_solved``: share of visits in which every solution was found, from 0 to 1.
        - ``human_attempts``, ``human_se``: people's, as published; NaN where there are none.
        - ``difference``: ``attempts`` minus ``human_attempts``.
        - ``model_attempts``, ``model_se``: the published model's, where people's are.
        - ``ideal_attempts``: what the ideal observer needs, which knows the schema; NaN if that is
          not known.
    """
    table = _means(trials, ["phase", "trial"]).rename(columns={"visits": "loops"})
    return _beside_ideal(beside_published(table, pairs), bounds)[list(SUMMARY_COLUMNS)]


def write_summary(
    record: pa.Table, path: Path | str, experiment: Mapping[str, Any] | None = None
) -> None:
    """Write the summary as CSV; equal data give equal bytes.

    Rows and columns have a fixed order, numbers at most six significant digits and lines end in
    a line feed, so two runs of an experiment can be compared byte for byte. A value that does not
    exist is left empty.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        path: The file to write.
        experiment: As in :func:`summary_table`.

    Raises:
        OpenLockError: If it cannot be written; a file that was there stays as it was.
    """
    write_table(summary_table(record, experiment), path)


def write_table(table: pd.DataFrame, path: Path | str) -> None:
    """Write a table of results as CSV; see :func:`write_summary`."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([cell(str(name)) for name in table.columns])
    for row in table.itertuples(index=False):
        writer.writerow([_cell(value) for value in row])
    write_text(path, text.getvalue())


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value + 0.0:.6g}"  # + 0.0: no minus zero
    return cell(value) if isinstance(value, str) else str(value)


def headline_table(record: pa.Table, experiment: Mapping[str, Any] | None = None) -> pd.DataFrame:
    """What each learner came to in each condition, in one row.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        experiment: As in :func:`summary_table`.

    Returns:
        See :func:`headline`.
    """
    known = experiment or {}
    return headline(attempts_to_solve(record), comparable(known), ideal_bounds(known))


def headline(
    trials: pd.DataFrame, pairs: Pairs | None = None, bounds: Bounds | None = None
) -> pd.DataFrame:
    """The headline of trials that are counted already.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        pairs: As in :func:`summarise`.
        bounds: As there.

    Returns:
        One row for each ``learner``, ``protocol`` and ``condition``, with ``measured`` (such as
        ``trial 5`` or ``test``), ``subjects``, ``attempts``, ``ci_low``, ``ci_high``,
        ``share_solved``,
        :data:`~causal_openlock.analysis.results.people.published.PUBLISHED_COLUMNS` and
        ``ideal_attempts`` as in :func:`summarise`.
    """
    chosen = judged(trials)
    table = beside_published(_means(chosen, ["phase", "trial"]), pairs)
    table = _beside_ideal(table, bounds)
    table = table.assign(measured=measured(table)).sort_values(
        ["learner", "protocol", "condition"], kind="stable", ignore_index=True
    )
    return table[
        [
            "learner",
            "protocol",
            "condition",
            "measured",
            "subjects",
            "attempts",
            "ci_low",
            "ci_high",
            "share_solved",
            *PUBLISHED_COLUMNS,
            "ideal_attempts",
        ]
    ]


def judged(trials: pd.DataFrame) -> pd.DataFrame:
    """The trials that a condition is judged by.

    A condition with a test phase is judged by its test (the mean of a subject's test trials, in
    the human protocol a single one); one without, by the last trial of its last loop.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.

    Returns:
        Some of its rows; trials of the test all have number 1.
    """
    cell = trials.groupby(CELL, observed=True)
    tested = (trials["phase"] == "test").groupby([trials[c] for c in CELL], observed=True)
    is_test = trials["phase"] == "test"
    last_loop = trials["loop"] == cell["loop"].transform("max")
    chosen = trials[is_test | (~tested.transform("any") & last_loop)]
    last = chosen["trial"] == chosen.groupby(CELL, observed=True)["trial"].transform("max")
    chosen = chosen[last | (chosen["phase"] == "test")]
    # People's test is one trial, number 1; a baseline is compared trial by trial.
    return chosen.assign(trial=np.where(chosen["phase"] == "test", 1, chosen["trial"]))


def measured(table: pd.DataFrame) -> list[str]:
    """What a condition was judged by, in words: ``test``, or such as ``trial 5``."""
    return [
        "test" if phase == "test" else f"trial {trial}"
        for phase, trial in zip(table["phase"], table["trial"], strict=True)
    ]


def _means(trials: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    means = mean_by_trial(trials, by).rename(columns={"mean": "attempts"})
    intervals = mean_intervals(by_subject(trials, by), [*CELL, *by], "attempts")
    return means.assign(ci_low=intervals["ci_low"], ci_high=intervals["ci_high"])


def _beside_ideal(table: pd.DataFrame, bounds: Bounds | None) -> pd.DataFrame:
    keys = zip(table["condition"], table["protocol"], table["phase"], strict=True)
    known = [(bounds or {}).get((str(c), str(p), str(phase))) for c, p, phase in keys]
    return table.assign(
        ideal_attempts=np.array([np.nan if one is None else one.attempts for one in known], float)
    )
