"""The tables of results, with published results beside them.

Beside learners that played as people did stand people and a published model of them (see
:mod:`~causal_openlock.analysis.results.people.published`), and wherever it is known what the ideal
observer needs (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import (
    CELL,
    attempts_to_solve,
    by_subject,
    mean_by_trial,
)
from causal_openlock.analysis.results.bounds import Bounds, ideal_bounds
from causal_openlock.analysis.results.people.published import (
    PUBLISHED_COLUMNS,
    Pairs,
    beside_published,
    comparable,
)
from causal_openlock.analysis.statistics import mean_intervals
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import cell

if TYPE_CHECKING:
    import pyarrow as pa

SUMMARY_COLUMNS = (
    *(*CELL, "phase", "trial", "loops", "subjects"),
    *("attempts", "se", "ci_low", "ci_high", "share_solved", *PUBLISHED_COLUMNS, "ideal_attempts"),
)


def summary_table(record: pa.Table, experiment: Experiment | None = None) -> pd.DataFrame:
    """Every trial of every condition: how many attempts it took, and how that compares.

    >>> from causal_openlock import PROTOCOLS, Condition, Session, create, find_schema
    >>> session = Session(Condition.named("CC4", find_schema), PROTOCOLS["human"], 2)
    >>> table = summary_table(session.play(create("oracle")))
    >>> table[["condition", "trial", "attempts", "human_attempts"]].head(1).values.tolist()
    [['CC4', 1, 3.0, 19.375]]

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        experiment: What was run: published results then stand beside conditions that are the
            paper's, and not beside all that have their names.

    Returns:
        See :func:`summarise`.
    """
    return summarise(attempts_to_solve(record), *_beside(experiment))


def headline_table(record: pa.Table, experiment: Experiment | None = None) -> pd.DataFrame:
    """The result of each learner in each condition, in one row; see :func:`headline`.

    Args:
        record: As in :func:`summary_table`.
        experiment: As there.
    """
    return headline(attempts_to_solve(record), *_beside(experiment))


def _beside(experiment: Experiment | None) -> tuple[Pairs | None, Bounds | None]:
    return (comparable(experiment), ideal_bounds(experiment)) if experiment else (None, None)


def summarise(
    trials: pd.DataFrame, pairs: Pairs | None = None, bounds: Bounds | None = None
) -> pd.DataFrame:
    """Every trial of every condition, of trials that are counted already.

    A protocol with loops visits a trial number many times; a subject's visits are averaged first,
    so a row is about one trial number over all loops, and every subject counts once.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        pairs: Learners and conditions that people can be compared with, from
            :func:`~causal_openlock.analysis.results.people.published.comparable`; by default all
            that have a condition of the paper's name under ``human``.
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
    table = _means(trials, pairs, bounds).rename(columns={"visits": "loops"})
    return table[list(SUMMARY_COLUMNS)]


def write_table(table: pd.DataFrame, path: Path | str) -> None:
    """Write a table of results as CSV; equal data give equal bytes.

    Numbers have at most six significant digits and lines end in a line feed, so that two runs of an
    experiment can be compared byte for byte. A value that does not exist is left empty.

    Args:
        table: Its rows and columns in a fixed order, such as :func:`summary_table` gives.
        path: The file to write.

    Raises:
        OpenLockError: If it cannot be written; a file that was there stays as it was.
    """
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


def headline(
    trials: pd.DataFrame, pairs: Pairs | None = None, bounds: Bounds | None = None
) -> pd.DataFrame:
    """The result of each learner in each condition, of trials that are counted already.

    Returns:
        One row for each ``learner``, ``protocol`` and ``condition``, with ``measured`` (such as
        ``trial 5`` or ``test``), ``subjects``, ``attempts``, ``ci_low``, ``ci_high``,
        ``share_solved``,
        :data:`~causal_openlock.analysis.results.people.published.PUBLISHED_COLUMNS` and
        ``ideal_attempts`` as in :func:`summarise`.
    """
    table = _means(judged(trials), pairs, bounds)
    table = table.assign(measured=measured(table)).sort_values(
        ["learner", "protocol", "condition"], kind="stable", ignore_index=True
    )
    first = ["learner", "protocol", "condition", "measured", "subjects", "attempts"]
    last = ["ci_low", "ci_high", "share_solved", *PUBLISHED_COLUMNS, "ideal_attempts"]
    return table[first + last]


def judged(trials: pd.DataFrame) -> pd.DataFrame:
    """The trials that a condition is judged by; those of the test all get number 1.

    A condition with a test phase is judged by its test (the mean of a subject's test trials, in the
    human protocol a single one); one without, by the last trial of its last loop.
    """
    is_test = trials["phase"] == "test"
    tested = is_test.groupby([trials[name] for name in CELL], observed=True).transform("any")
    last_loop = trials["loop"] == trials.groupby(CELL, observed=True)["loop"].transform("max")
    chosen = trials[is_test | (~tested & last_loop)]
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


def _means(trials: pd.DataFrame, pairs: Pairs | None, bounds: Bounds | None) -> pd.DataFrame:
    """The means of each trial with intervals, published results and ideal attempts beside them."""
    by = ["phase", "trial"]
    means = mean_by_trial(trials, by).rename(columns={"mean": "attempts"})
    intervals = mean_intervals(by_subject(trials, by), [*CELL, *by], "attempts")
    table = means.assign(ci_low=intervals["ci_low"], ci_high=intervals["ci_high"])
    keys = zip(
        *(table[name].astype(str) for name in ("condition", "protocol", "phase")), strict=True
    )
    known = [(bounds or {}).get(key) for key in keys]
    ideal = [np.nan if one is None else one.attempts for one in known]
    return beside_published(table, pairs).assign(ideal_attempts=np.array(ideal, float))
