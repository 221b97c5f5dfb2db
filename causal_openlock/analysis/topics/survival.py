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
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, trials_under
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import share_interval, sizes
from causal_openlock.analysis.topic import Section, Topic, drawn, sentences
from causal_openlock.wording import file_names, joined

MOST_LINES = 6  #: learners in one figure: with more, nobody can tell lines apart


def unsolved_after(trials: pd.DataFrame) -> pd.DataFrame:
    """The share of trials not solved after each attempt, of those a condition is judged by.

    A row for each ``learner``, ``condition``, ``protocol`` and number of ``attempts``, from 0 to
    the most that one of its trials had: ``unsolved`` (a share), its interval (Wilson's, over
    subjects) ``ci_low`` to ``ci_high``, ``subjects`` and ``at_risk``, how many trials were neither
    solved nor censored before that attempt.
    """
    parts = []
    for key, own in judged(trials).groupby(CELL, observed=True, sort=True):
        ended, solved = own["attempts"].to_numpy(), own["solved"].to_numpy(bool)
        attempts = np.arange(ended.max() + 1)
        at_risk = len(ended) - np.searchsorted(np.sort(ended), attempts)
        share = np.cumprod(1 - np.bincount(ended[solved], minlength=len(attempts)) / at_risk)
        subjects = own.groupby(SUBJECT, observed=True).ngroups
        low, high = share_interval(share, subjects)
        values = {"attempts": attempts, "unsolved": share, "ci_low": low, "ci_high": high}
        cell = dict(zip(CELL, map(str, key), strict=True))
        parts.append(pd.DataFrame({**cell, **values, "subjects": subjects, "at_risk": at_risk}))
    return pd.concat(parts, ignore_index=True)


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
            for name, look in looks.items():
                own = here[here["learner"] == name]
                x = own["attempts"]
                axes.step(x, own["unsolved"], where="post", label=name, **look)
                if len(names) <= style.MOST_BANDS:
                    ends, colour = (own["ci_low"], own["ci_high"]), look["color"]
                    axes.fill_between(x, *ends, step="post", color=colour, alpha=0.15, lw=0)
            style.panel_title(axes, condition, sizes(here))
            axes.set(xlim=(0, float(table["attempts"].max())), ylim=(0, 1.02), xlabel="Attempts")
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
            axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        at.label_y("Trials not solved yet")
        keys = [Line2D([], [], label=style.label(name, 24), **look) for name, look in looks.items()]
        at.legend(keys, columns=min(len(names), 4))
    return at.returned


def fastest(trials: pd.DataFrame) -> list[str]:
    """Return the learners with the fewest mean attempts, :data:`MOST_LINES` of them at most."""
    means = judged(trials).astype({"learner": str}).groupby("learner")["attempts"].mean()
    return means.sort_values(kind="stable").index[:MOST_LINES].tolist()


def section(material: Material) -> Section | None:
    """A figure for each protocol; None of an empty record."""
    trials = material.trials
    plots = []
    for protocol, part in file_names(ordered(trials["protocol"].unique(), ("human",))).items():
        own = trials[trials["protocol"] == protocol]
        shown = fastest(own)
        slower = [name for name in ordered(own["learner"], material.learners) if name not in shown]
        caption = sentences(
            "Kaplan-Meier curve: share of the trials that each condition is judged by that is "
            "still unsolved after k attempts. A line that ends above 0 is the share that was not "
            "solved within the limit.",
            f"Not drawn, as slower: {joined(slower)}." if slower else "",
            "Bands: 95% intervals." if len(shown) <= style.MOST_BANDS else "",
        )
        title = f"Trials not solved yet, protocol {protocol}"
        name = f"survival_{part}"
        plots.append(drawn(name, plot_survival, material, title, caption, protocol=protocol))
    title = "How long rooms go unsolved"
    return Section("survival", title, plots=tuple(plots)) if plots else None


TOPIC = Topic("survival", 40, section)
