"""The paper's Figures 3 and 4: attempts in the baseline trials and in the transfer test.

References come first, such as people and the published model of them (see
:mod:`~causal_openlock.analysis.results.references`), and then every learner that did what one of
them did, one panel each with a common scale. Error bars are the paper's, population SD / √n, so
that those of people and of learners mean the same. A dashed line shows what the ideal observer
needs (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, mean_by_trial
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.bounds import bounds_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import NothingToDrawError

_PAPER = {"train": BASELINES, "test": TRANSFERS}


def comparable_means(
    results: Material,
    phase: str,
    learners: Names = None,
    conditions: Names = None,
) -> pd.DataFrame:
    """Means of what learners did as a reference had: the baselines (``train``) or the ``test``.

    Returns:
        As :func:`~causal_openlock.analysis.measures.mean_by_trial`; no rows if no one did.
    """
    trials = rows_of(results, results.compared(results.trials), learners, conditions)
    trials = trials[trials["condition"].isin(_PAPER[phase]) & (trials["phase"] == phase)]
    return mean_by_trial(trials, ["phase", "trial"] if phase == "train" else ["phase"])


def plot_attempts(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    published: bool = True,
    ax: Any = None,
) -> Any:
    """Mean attempts in each baseline trial, CC4 next to CE4: the paper's Figure 3.

    >>> import causal_openlock as ol
    >>> panels = ol.plot_attempts(results)
    >>> [axes.get_title(loc="left") for axes in panels]
    ['People', 'Published model', 'random', 'oracle']

    Args:
        results: What was played.
        learners: Labels of the learners to draw; by default all that a reference suits.
        conditions: Conditions to draw; by default those of the paper's that were played.
        published: Whether references have panels before the learners.
        ax: Axes, as many as there are panels, or an empty figure; by default a new figure of
            pyplot.

    Returns:
        ``[P]`` the axes of the panels; of a single panel its axes.

    Raises:
        NothingToDrawError: If no such learner played CC4 or CE4 as people did.
        OpenLockError: If a learner or a condition is not in the results, or ``ax`` does not fit.
    """
    means = comparable_means(results, "train", learners, conditions)
    count = max([5, *means["trial"]])

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for side, condition in enumerate(BASELINES):
            one = rows[rows["condition"] == condition]
            _bars(axes, one["trial"] + 0.4 * side - 0.2, one, condition)
        for attempts in sorted(set(ideal.values())):
            style.ideal_line(axes, attempts, 0.4, count + 0.6)
        axes.set_xticks(range(1, count + 1))
        axes.set(xlim=(0.4, count + 0.6), xlabel="Trial")

    keys = {name: name for name in BASELINES}
    return _beside(results, means, "CC4 or CE4", published, panel, keys, ax)


def plot_transfer(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    published: bool = True,
    ax: Any = None,
) -> Any:
    """Mean attempts in the transfer test, by what was tested and trained: the paper's Figure 4.

    Tests that no learner played are left out, also those of people.

    >>> import causal_openlock as ol
    >>> axes = ol.plot_transfer(results, learners=["random"], published=False)
    >>> axes.get_xlabel()
    'Transfer test'

    Arguments and errors are those of :func:`plot_attempts`.

    Returns:
        ``[P]`` the axes of the panels; of a single panel its axes.
    """
    means = comparable_means(results, "test", learners, conditions)
    played = {str(name)[-3:] for name in means["condition"]}
    tests = [name for name in BASELINES if name in played]

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for place, condition in enumerate(name for name in TRANSFERS if name[-3:] in tests):
            one = rows[rows["condition"] == condition]
            x = place // 2 + 0.4 * (place % 2) - 0.2
            _bars(axes, np.full(len(one), x), one, condition)
            if one.empty and (conditions is None or condition in conditions):
                axes.text(  # an empty place would look like no attempts
                    x, 1, "not played", rotation=90, ha="center", va="bottom", color="#666666",
                    backgroundcolor="white", zorder=3,
                )  # fmt: skip
        halves = {(tests.index(name[-3:]), attempts) for name, attempts in ideal.items()}
        for half, attempts in sorted(halves):
            style.ideal_line(axes, attempts, half - 0.45, half + 0.45)
        axes.set_xticks(range(len(tests)), tests)
        axes.set(xlim=(-0.6, len(tests) - 0.4), xlabel="Transfer test")

    keys = {f"{name} training": name for name in ("CC3", "CE3")}
    return _beside(results, means, "a transfer condition", published, panel, keys, ax)


def _beside(
    results: Material,
    means: pd.DataFrame,
    played: str,
    published: bool,
    panel: Callable[[Axes, pd.DataFrame, Mapping[str, float]], None],
    keys: Mapping[str, str],
    ax: Any,
) -> Any:
    """A panel for each reference, and one for each learner."""
    if means.empty:
        raise NothingToDrawError(
            f"no such learner played {played} as people did, in the paper's rooms under the "
            "protocol human, or as another reference did; plot_course draws any condition"
        )
    known = bounds_of(results.bounds, means)
    ideal = {condition: bound.attempts for (condition, _), bound in known.items()}
    phase = str(means["phase"].iloc[0])
    shown = []
    for one in results.references if published else ():
        reference = one.reference
        means_of = reference.means(judged=phase != "train")
        rows = means_of[(means_of["phase"] == phase) & means_of["condition"].isin(_PAPER[phase])]
        if len(rows) and one.stands(means).any():
            shown.append((reference.title, f"{reference.detail}, ", rows))
    shown += [(str(name), "", rows) for name, rows in means.groupby("learner", observed=True)]
    handles: list[Any] = [
        Patch(fc=style.current().trained(condition), ec="black", lw=0.6, label=text)
        for text, condition in keys.items()
    ]
    top = max(30.0, float(results.compared(results.trials)["last_attempt"].max()))
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.3)) as at:
        for axes, (name, detail, rows) in zip(at.axes, shown, strict=True):
            panel(axes, rows, ideal)
            style.panel_title(axes, name, detail + style.sizes(rows))
            axes.set_ylim(0, top * 1.03)
            axes.yaxis.set_major_locator(
                MultipleLocator(5) if top <= 40 else MaxNLocator(integer=True)
            )
        at.label_y("Attempts")
        at.legend([*handles, style.ideal_key()] if ideal else handles)
    return at.returned


def _bars(axes: Axes, x: Any, rows: pd.DataFrame, condition: str) -> None:
    colour = style.current().trained(condition)
    axes.bar(x, rows["mean"], width=0.38, color=colour, edgecolor="black", linewidth=0.6)
    spread = rows["se"].where(rows["subjects"] > 1)  # one subject has none
    axes.errorbar(x, rows["mean"], spread, fmt="none", ecolor="black", elinewidth=0.9, capsize=2)
