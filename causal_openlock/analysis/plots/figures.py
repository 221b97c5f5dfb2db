"""Figures in the form of the paper's; all figures of a record.

In Figures 3 and 4 people come first, the published model of them next (see
:mod:`~causal_openlock.analysis.results.people.published`) and then every learner that played the
human protocol, one panel each with a common scale. Error bars are the paper's, population SD / √n,
so that those of people and of learners mean the same. A dashed line shows what the ideal observer
needs (see :mod:`~causal_openlock.analysis.results.bounds`).

In Figures 6 and 7 each segment's *height* is log10 of its count, and segments are stacked: the form
that the paper chose. So a stack is a sum of logarithms; it shrinks as one category takes over. The
paper's own DDQN is the first panel, from its published counts; then come the learners under
protocols with many attempts in a trial, that is, all but ``human``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, Counts, mean_by_trial, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.course import attempts_by_trial
from causal_openlock.analysis.plots.style import Plot
from causal_openlock.analysis.results.bounds import Bounds, bounds_in_words, ideal_bounds
from causal_openlock.analysis.results.people.published import (
    HUMAN_PROTOCOL,
    comparable,
    did_what_people_did,
    model,
    paper_conditions,
    paper_ddqn,
    people,
)
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.wording import file_names

_OUTLINES = {"CE4": ":", "CC4": "-"}  # left to right, as in the paper's Figure 6


def draw_all(
    counts: Counts, learners: Sequence[str] = (), experiment: Experiment | None = None
) -> list[Plot]:
    """Every figure that the record has data for.

    Args:
        counts: From :func:`~causal_openlock.analysis.measures.count`.
        learners: Labels of learners in the order in which to draw them; the others follow.
        experiment: What was run: what differs from the paper there is not drawn beside the paper's
            results. Without it names decide.
    """
    trials, blocks = counts
    bounds = ideal_bounds(experiment) if experiment else {}
    pairs = comparable(experiment) if experiment else None
    beside_people = trials[did_what_people_did(trials, pairs)]
    if experiment:
        blocks = blocks[blocks["condition"].isin(list(paper_conditions(experiment)))]
    plots = [
        baseline_attempts(beside_people, learners, bounds),
        transfer_attempts(beside_people, learners, bounds),
        baseline_categories(blocks, learners),
        transfer_categories(blocks, learners),
    ]
    for protocol, part in file_names(trials["protocol"].unique()).items():
        plot = attempts_by_trial(trials, protocol, learners, bounds)
        plots.append(plot and replace(plot, name=f"{plot.kind}_{part}"))
    return [plot for plot in plots if plot is not None]


def baseline_attempts(
    trials: pd.DataFrame, learners: Sequence[str] = (), bounds: Bounds | None = None
) -> Plot | None:
    """Figure 3: mean attempts in each baseline trial, CC4 beside CE4.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        learners: The order of the panels.
        bounds: From :func:`~causal_openlock.analysis.results.bounds.ideal_bounds`.

    Returns:
        The plot, or None if no learner played CC4 or CE4 under the human protocol.
    """
    means = mean_by_trial(_chosen(trials, trials["protocol"] == HUMAN_PROTOCOL, BASELINES, "train"))
    if means.empty:
        return None
    count = max(int(means["trial"].max()), int(people()["trial"].max()))

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for side, condition in enumerate(BASELINES):
            one = rows[rows["condition"] == condition]
            _bars(axes, one["trial"] + 0.4 * side - 0.2, one, condition)
        for attempts in sorted(set(ideal.values())):
            style.ideal_line(axes, attempts, 0.4, count + 0.6)
        axes.set_xticks(range(1, count + 1))
        axes.set(xlim=(0.4, count + 0.6), xlabel="Trial")

    keys = {name: name for name in BASELINES}
    return _beside_people("baseline_attempts", trials, means, learners, bounds, panel, keys)


def transfer_attempts(
    trials: pd.DataFrame, learners: Sequence[str] = (), bounds: Bounds | None = None
) -> Plot | None:
    """Figure 4: mean attempts in the transfer test, by what was tested and what was trained.

    Arguments are those of :func:`baseline_attempts`.

    Returns:
        The plot, or None if no learner played a transfer condition of the paper under the human
        protocol.
    """
    chosen = _chosen(trials, trials["protocol"] == HUMAN_PROTOCOL, TRANSFERS, "test")
    means = mean_by_trial(chosen, ["phase"])
    if means.empty:
        return None

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for place, condition in enumerate(TRANSFERS):
            one = rows[rows["condition"] == condition]
            x = place // 2 + 0.4 * (place % 2) - 0.2
            _bars(axes, np.full(len(one), x), one, condition)
        halves = {(TRANSFERS.index(name) // 2, attempts) for name, attempts in ideal.items()}
        for half, attempts in sorted(halves):
            style.ideal_line(axes, attempts, half - 0.45, half + 0.45)
        axes.set_xticks([0, 1], BASELINES)
        axes.set(xlim=(-0.6, 1.6), xlabel="Transfer test")

    keys = {f"{name} training": name for name in ("CC3", "CE3")}
    return _beside_people("transfer_attempts", trials, means, learners, bounds, panel, keys)


def _chosen(
    table: pd.DataFrame, protocol: pd.Series, conditions: Sequence[str], phase: str
) -> pd.DataFrame:
    return table[protocol & table["condition"].isin(conditions) & (table["phase"] == phase)]


def _beside_people(
    kind: str,
    trials: pd.DataFrame,
    means: pd.DataFrame,
    learners: Sequence[str],
    bounds: Bounds | None,
    panel: Callable[[Axes, pd.DataFrame, Mapping[str, float]], None],
    keys: Mapping[str, str],
) -> Plot:
    """A panel for people, one for the published model, and one for each learner."""
    phase = str(means["phase"].iloc[0])
    played = {name: (str(name), HUMAN_PROTOCOL, phase) for name in ordered(means["condition"])}
    known = {name: bounds[key] for name, key in played.items() if bounds and key in bounds}
    ideal = {name: bound.attempts for name, bound in known.items()}
    shown = [
        ("People", "", people().query("phase == @phase")),
        ("Published model", "theory-based, ", model().query("phase == @phase")),
        *(
            (name, "", means[means["learner"] == name])
            for name in ordered(means["learner"], learners)
        ),
    ]
    handles: list[Any] = [
        Patch(fc=style.trained_colour(condition), ec="black", lw=0.6, label=text)
        for text, condition in keys.items()
    ]
    figure = style.small_multiples(
        [(name, detail + style.sizes(rows), rows) for name, detail, rows in shown],
        lambda axes, rows: panel(axes, rows, ideal),
        (3, 2.3, "Attempts"),
        [*handles, style.ideal_key()] if ideal else handles,
    )
    first = figure.axes[0]
    limit = float(trials.loc[trials["protocol"] == HUMAN_PROTOCOL, "last_attempt"].max())
    top = max(30.0, limit)
    first.set_ylim(0, top * 1.03)
    ticks = MultipleLocator(5) if top <= 40 else MaxNLocator(integer=True)
    first.yaxis.set_major_locator(ticks)
    return Plot(kind, figure, facts={"ideal": bounds_in_words(known.values())})


def _bars(axes: Axes, x: Any, rows: pd.DataFrame, condition: str) -> None:
    colour = style.trained_colour(condition)
    axes.bar(x, rows["mean"], width=0.38, color=colour, edgecolor="black", linewidth=0.6)
    spread = rows["se"].where(rows["subjects"] > 1)  # one subject has none
    axes.errorbar(x, rows["mean"], spread, fmt="none", ecolor="black", elinewidth=0.9, capsize=2)


def baseline_categories(counts: pd.DataFrame, learners: Sequence[str] = ()) -> Plot | None:
    """Figure 6: what attempts came to over the course of the baseline conditions.

    Args:
        counts: From :func:`~causal_openlock.analysis.measures.category_counts`.
        learners: The order of the panels.

    Returns:
        The plot, or None if no learner played CC4 or CE4 under a protocol other than ``human``.
    """

    def panel(axes: Axes, rows: pd.DataFrame) -> None:
        for side, (condition, outline) in enumerate(_OUTLINES.items()):
            for block, part in rows[rows["condition"] == condition].groupby("block"):
                _stack(axes, block - 1 + 0.4 * side - 0.2, part, outline)
        names = _ranges(rows.groupby("block")["until"].max().to_numpy())
        axes.set_xticks(range(len(names)), names, fontsize=7.5)
        whose = " of each subject" if "learner" in rows else ""
        axes.set(xlim=(-0.6, len(names) - 0.4), xlabel=f"Attempts{whose}")

    outlines = [
        Patch(fc="white", ec="black", lw=1.1, ls=line, label=f"{name} ({side})")
        for (name, line), side in zip(_OUTLINES.items(), ("left", "right"), strict=True)
    ]
    conditions = list(_OUTLINES)
    return _beside_ddqn("baseline_categories", counts, conditions, learners, panel, outlines)


def transfer_categories(counts: pd.DataFrame, learners: Sequence[str] = ()) -> Plot | None:
    """Figure 7: what attempts came to in the test phase of the transfer conditions.

    Arguments are those of :func:`baseline_categories`.

    Returns:
        The plot, or None if no learner played a transfer condition of the paper under a protocol
        other than ``human``.
    """

    def panel(axes: Axes, rows: pd.DataFrame) -> None:
        for place, condition in enumerate(TRANSFERS):
            _stack(axes, place, rows[rows["condition"] == condition], "-", width=0.6)
        axes.set_xticks(range(len(TRANSFERS)), TRANSFERS)
        axes.set(xlim=(-0.6, len(TRANSFERS) - 0.4), xlabel="Training and test")

    return _beside_ddqn("transfer_categories", counts, TRANSFERS, learners, panel, [])


def _beside_ddqn(
    kind: str,
    counts: pd.DataFrame,
    conditions: Sequence[str],
    learners: Sequence[str],
    panel: Callable[[Axes, pd.DataFrame], None],
    outlines: Sequence[Any],
) -> Plot | None:
    """A panel for the paper's DDQN, and one for each learner under each protocol."""
    phase = "train" if conditions[0] in BASELINES else "test"
    chosen = _chosen(counts, counts["protocol"] != HUMAN_PROTOCOL, conditions, phase)
    if chosen.empty:
        return None
    published = paper_ddqn().query("phase == @phase")
    shown = [("DDQN of the paper", "published counts", published)]
    for name in ordered(chosen["learner"], learners):
        own = chosen[chosen["learner"] == name]
        for protocol in ordered(own["protocol"], ()):
            rows = own[own["protocol"] == protocol]
            shown.append((name, f"{protocol}, {style.sizes(rows)}", rows))
    categories = [
        Patch(fc=style.CATEGORY_COLOURS[name], ec="black", lw=0.6, label=style.CATEGORY_NAMES[name])
        for name in CATEGORIES
    ]
    layout = (2, 2.7, r"$\log_{10}$ of attempts, stacked")
    return Plot(kind, style.small_multiples(shown, panel, layout, [*categories, *outlines]))


def _stack(axes: Axes, x: float, rows: pd.DataFrame, outline: str, width: float = 0.38) -> None:
    counts = rows.groupby("category", observed=True)["count"].sum()
    bottom = 0.0
    for category in CATEGORIES:
        height = float(np.log10(max(1, counts.get(category, 1))))
        if height:
            colour = style.CATEGORY_COLOURS[category]
            axes.bar(x, height, width, bottom, color=colour, ec="black", lw=1.0, ls=outline)
        bottom += height


def _ranges(until: Sequence[float]) -> list[str]:
    """Names of blocks: ``0–0.6k``, ``0.6–1.2k``, ... as the paper's ``0–30k``; few in full."""
    thousands = bool(until[-1] >= 1000)
    ends = [f"{round(value / 1000, 2):g}" if thousands else f"{value:.0f}" for value in (0, *until)]
    return [f"{low}–{high}{'k' * thousands}" for low, high in pairwise(ends)]
