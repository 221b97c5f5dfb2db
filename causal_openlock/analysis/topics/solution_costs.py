"""Cost of each solution: attempts for the first, and for each later one since the one before.

What a subject knows before it enters a room may pay at the first solution, or only once the first
solution says which lever plays which role. The attempts of a whole room hide which it was.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, SOLUTIONS, SUBJECT, judged
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import mean_intervals
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic


def solution_costs(trials: pd.DataFrame) -> pd.DataFrame:
    """Attempts for each solution, in the trials that a condition is judged by.

    >>> table = solution_costs(results.trials)
    >>> table[["learner", "solution", "attempts"]].values.tolist()[1:4]
    [['oracle', 'first', 1.0], ['oracle', 'second', 1.0], ['oracle', 'third', 1.0]]

    Returns:
        A row for each ``condition``, ``protocol``, ``learner`` and ``solution`` that was found:
        ``subjects`` that found it, their mean ``attempts`` since the solution before, and its 95%
        interval over subjects, ``ci_low`` to ``ci_high``.
    """
    each = judged(trials).groupby([*CELL, *SUBJECT], observed=True)[[*SOLUTIONS]].mean()
    long = each.rename_axis(columns="solution").stack().dropna().rename("attempts").reset_index()
    long["solution"] = pd.Categorical(long["solution"], SOLUTIONS)
    by = ["condition", "protocol", "learner", "solution"]
    means = long.groupby(by, observed=True)["attempts"].agg(subjects="size", attempts="mean")
    return means.reset_index().merge(mean_intervals(long, by, "attempts"), on=by)


def section(material: Material) -> Section | None:
    """A table of means with their intervals; None where no solution was found."""
    costs = solution_costs(material.trials)
    if costs.empty:
        return None
    costs["text"] = [
        f"{row.attempts:.2f}{_interval(row.ci_low, row.ci_high)}, n = {row.subjects}"
        for row in costs.itertuples()
    ]
    about = ["condition", "protocol", "learner"]
    about = about if costs["protocol"].nunique() > 1 else ["condition", "learner"]
    wide = costs.pivot(index=about, columns="solution", values="text").fillna("–")
    frame = wide.rename_axis(columns=None).reset_index()
    text = (
        "Attempts for the first solution, and for each later one since the one before, in the "
        "trials that each condition is judged by. Knowledge of a schema may pay at the first "
        "solution, or only once that solution says which lever plays which role."
    )
    caption = (
        "Means over the n subjects that found that solution, with 95% intervals. Who "
        "often fails looks better here than in a mean of all trials, which counts an unsolved "
        "trial as the limit."
    )
    title = "Attempts for the first, second and third solution"
    table = Table("solution_costs", title, frame, caption=caption)
    return Section("solution_costs", "What each solution cost", (text,), (table,))


def _interval(low: float, high: float) -> str:
    """An interval in brackets; empty for one subject, of whom there is none."""
    return f" [{low:.2f}, {high:.2f}]" if np.isfinite(low) else ""


TOPIC = Topic("solution_costs", 45, section)
