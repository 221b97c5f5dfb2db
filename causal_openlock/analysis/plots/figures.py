"""Attempts to solve a trial, in the form of the paper's Figures 3 and 4; all figures of a record.

Both figures put people first, the published model of them next (see
:mod:`~causal_openlock.analysis.results.people.published`) and every learner that played the human
protocol after them, one panel each with a common scale. Error bars are the paper's, population SD /
√n, so that those of people and of learners mean the same. A dashed line shows what the ideal
observer needs (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, Counts, mean_by_trial, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.categories import baseline_categories, transfer_categories
from causal_openlock.analysis.plots.course import attempts_by_trial
from causal_openlock.analysis.plots.style import Plot
from causal_openlock.analysis.results.bounds import Bounds, bounds_in_words, ideal_bounds
from causal_openlock.analysis.results.people.comparable import (
    HUMAN_PROTOCOL,
    comparable,
    paper_conditions,
)
from causal_openlock.analysis.results.people.published import did_what_people_did, model, people
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.wording import file_names


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
    trials, blocks = counts.trials, counts.blocks
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
    chosen = _human(trials, BASELINES, "train")
    if chosen.empty:
        return None
    means = mean_by_trial(chosen)
    count = max(int(means["trial"].max()), int(people()["trial"].max()))

    def panel(axes: Axes, rows: pd.DataFrame, ideal: Mapping[str, float]) -> None:
        for side, condition in enumerate(BASELINES):
            one = rows[rows["condition"] == condition]
            _bars(axes, one["trial"] + 0.4 * side - 0.2, one, condition)
        for attempts in sorted(set(ideal.values())):
            style.ideal_line(axes, attempts, 0.4, count + 0.6)
        axes.set_xticks(range(1, count + 1))
        axes.set_xlim(0.4, count + 0.6)
        axes.set_xlabel("Trial")

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
    chosen = _human(trials, TRANSFERS, "test")
    if chosen.empty:
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
        axes.set_xlim(-0.6, 1.6)
        axes.set_xlabel("Transfer test")

    means = mean_by_trial(chosen, ["phase"])
    keys = {f"{name} training": name for name in ("CC3", "CE3")}
    return _beside_people("transfer_attempts", trials, means, learners, bounds, panel, keys)


def _human(trials: pd.DataFrame, conditions: Sequence[str], phase: str) -> pd.DataFrame:
    return trials[
        (trials["protocol"] == HUMAN_PROTOCOL)
        & trials["condition"].isin(conditions)
        & (trials["phase"] == phase)
    ]


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
    with style.settings():
        figure, panels = style.panels(len(shown), columns=3, height=2.3)
        for axes, (name, detail, rows) in zip(panels, shown, strict=True):
            panel(axes, rows, ideal)
            style.panel_title(axes, name, detail + style.sizes(rows))
        limit = float(trials.loc[trials["protocol"] == HUMAN_PROTOCOL, "last_attempt"].max())
        top = max(30.0, limit)
        panels[0].set_ylim(0, top * 1.03)
        ticks = MultipleLocator(5) if top <= 40 else MaxNLocator(integer=True)
        panels[0].yaxis.set_major_locator(ticks)
        style.label_rows(panels, "Attempts")
        handles: list[Any] = [
            Patch(fc=style.trained_colour(condition), ec="black", lw=0.6, label=text)
            for text, condition in keys.items()
        ]
        style.legend(figure, [*handles, style.ideal_key()] if ideal else handles)
    return Plot(kind, figure, facts={"ideal": bounds_in_words(known.values())})


def _bars(axes: Axes, x: Any, rows: pd.DataFrame, condition: str) -> None:
    colour = style.trained_colour(condition)
    axes.bar(x, rows["mean"], width=0.38, color=colour, edgecolor="black", linewidth=0.6)
    spread = rows["se"].where(rows["subjects"] > 1)  # one subject has none
    axes.errorbar(x, rows["mean"], spread, fmt="none", ecolor="black", elinewidth=0.9, capsize=2)
