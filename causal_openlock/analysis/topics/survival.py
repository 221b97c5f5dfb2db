"""Kaplan-Meier curves: the share of trials still unsolved after k attempts.

A mean counts a trial that was not solved as the limit, and hides how many these are. Survival
analysis does not: a trial at the limit is *censored*, which says that it took more attempts than
that, and nothing else. Of the trials that were still unsolved before an attempt, some share is
solved by it; the product of what is left is the share of trials that survive.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import CELL, SUBJECT, judged, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import (
    Names,
    in_rows,
    panels,
    trials_under,
)
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.statistics import share_interval
from causal_openlock.analysis.topic import Topic
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.wording import file_names

MOST_LINES = 6
"""Learners in one figure: with more, nobody can tell lines apart."""

_PROSE = Prose(__name__)


def unsolved_after(trials: pd.DataFrame) -> pd.DataFrame:
    """The share of trials not solved after each attempt, of those a condition is judged by.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.

    Returns:
        A row for each ``learner``, ``condition``, ``protocol`` and number of ``attempts``, from 0
        to the most that one of its trials had: ``unsolved`` (a share), ``ci_low`` and ``ci_high``
        (Wilson's interval of a share of subjects), ``subjects`` and ``at_risk``, how many
        trials were neither solved nor censored before that attempt.
    """
    parts = []
    for key, own in judged(trials).groupby(CELL, observed=True, sort=True):
        subject = own.groupby(SUBJECT, observed=True).ngroup().to_numpy()
        ended, solved = own["attempts"].to_numpy(), own["solved"].to_numpy()
        size, length = subject.max() + 1, ended.max() + 1
        events = np.zeros((size, length))  # whole numbers, whose products BLAS adds exactly
        np.add.at(events, (subject[solved], ended[solved]), 1)
        left = np.zeros((size, length))
        np.add.at(left, (subject, ended), 1)
        risk = left[:, ::-1].cumsum(axis=1)[:, ::-1]  # those that end at an attempt, or later
        share = kaplan_meier(events.sum(axis=0), risk.sum(axis=0))
        rows = pd.DataFrame({"attempts": np.arange(length), "unsolved": share})
        low, high = share_interval(share, size)
        rows = rows.assign(
            ci_low=low, ci_high=high, subjects=size, at_risk=risk.sum(axis=0).astype(int)
        )
        parts.append(rows.assign(**dict(zip(CELL, map(str, key), strict=True))))
    columns = [*CELL, "attempts", "unsolved", "ci_low", "ci_high", "subjects", "at_risk"]
    return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns)


def kaplan_meier(events: IntArray | FloatArray, at_risk: IntArray | FloatArray) -> FloatArray:
    """The share that survives.

    >>> kaplan_meier(np.array([0, 1, 0, 1]), np.array([4, 4, 3, 2])).tolist()
    [1.0, 0.75, 0.75, 0.375]

    Args:
        events: ``[..., T]`` how many ended at each time.
        at_risk: ``[..., T]`` how many had neither ended nor been lost before.
    """
    kept = 1 - events / np.maximum(at_risk, 1)
    return np.cumprod(kept, axis=-1, dtype=np.float64)


def plot_survival(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Any:
    """Draw the share of trials that are still unsolved after k attempts (Kaplan-Meier).

    They are the trials that a condition is judged by: its test, or the last trial of a baseline. A
    trial that was not solved is censored at its limit: a line that does not reach 0 is the share
    that never was. A panel for each condition, a line for each learner, by default of the
    :data:`MOST_LINES` that are fastest; with at most four learners a band is the 95%
    interval over subjects.

    >>> axes = plot_survival(results, conditions=["CC4"])
    >>> [line.get_label() for line in axes.lines]
    ['random', 'oracle']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    trials = trials_under(results, protocol, learners, conditions)[1]
    if learners is None:
        trials = trials[trials["learner"].isin(fastest(trials))]
    table = unsolved_after(trials)
    names = ordered(table["learner"].unique(), results.learners)
    # The first lines are broad and the next ones narrow: where they coincide, both are still seen.
    looks = {
        name: {**style.current().line(number, name), "lw": max(1.2, 3.2 - 0.5 * number)}
        for number, name in enumerate(names)
    }
    shown = ordered(table["condition"].unique(), results.conditions)
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.2)) as at:
        for axes, condition in zip(at.axes, shown, strict=True):
            here = table[table["condition"] == condition]
            for name in names:
                own = here[here["learner"] == name]
                if own.empty:
                    continue
                x, line = own["attempts"], looks[name]
                axes.step(x, own["unsolved"], where="post", label=name, **line)
                if len(names) <= style.MOST_BANDS:
                    axes.fill_between(
                        x, own["ci_low"], own["ci_high"], step="post", color=line["color"],
                        alpha=0.15, lw=0,
                    )  # fmt: skip
            style.panel_title(axes, condition, style.sizes(here))
            axes.set(xlim=(0, float(table["attempts"].max())), ylim=(0, 1.02), xlabel="Attempts")
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
            axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        at.label_y("Trials not solved yet")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name])
                for name in names]  # fmt: skip
        at.legend(keys, columns=min(len(names), 4))
    return at.returned


def fastest(trials: pd.DataFrame) -> list[str]:
    """Return the learners with the fewest mean attempts, :data:`MOST_LINES` of them at most."""
    means = judged(trials).astype({"learner": str}).groupby("learner")["attempts"].mean()
    return means.sort_values(kind="stable").index[:MOST_LINES].tolist()


def section(material: Material) -> Section | None:
    """A figure for each protocol; None of an empty record."""
    trials = material.trials
    names = ordered(trials["protocol"].unique(), ("human",))
    plots = []
    for protocol, part in file_names(names).items():
        own = trials[trials["protocol"] == protocol]
        learners, drawn = ordered(own["learner"].unique(), material.learners), fastest(own)
        plots.append(
            _PROSE.plot(
                "survival", plot_survival, material, {"protocol": protocol}, f"survival_{part}",
                protocol=protocol, bands=len(drawn) <= style.MOST_BANDS,
                left_out=[name for name in learners if name not in drawn],
            )
        )  # fmt: skip
    return _PROSE.section("survival", plots=plots) if plots else None


TOPIC = Topic("survival", 40, section)
