"""Attempts to solve a trial, in the form of the paper's Figures 3 and 4.

Both figures put people first, the published model of them next (see
:mod:`~causal_openlock.analysis.results.people.published`) and every learner that played the human
protocol after them, one panel each with a common scale. Error bars are the paper's, population SD /
√n, so that those of people and of learners mean the same. A dashed line shows what the ideal
observer needs (see :mod:`~causal_openlock.analysis.results.bounds`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from causal_openlock.analysis.measures import (
    BASELINES,
    TRANSFERS,
    mean_by_trial,
    ordered,
)
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.categories import baseline_categories, transfer_categories
from causal_openlock.analysis.plots.course import attempts_by_trial
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.results.bounds import Bound, Bounds, bounds_in_words, ideal_bounds
from causal_openlock.analysis.results.counting import Counts, count
from causal_openlock.analysis.results.people.comparable import (
    HUMAN_PROTOCOL,
    comparable,
    paper_conditions,
)
from causal_openlock.analysis.results.people.published import did_what_people_did, model, people
from causal_openlock.experiment.experiment import Experiment

if TYPE_CHECKING:
    import pyarrow as pa

_ERROR_BARS = (
    "Error bars: ± 1 standard error (population SD / √n); those of the published model as drawn "
    "there."
)
_SOURCES = (
    "the first panel shows people as published in the paper's Figure {}, the second the "
    "theory-based model of Edmonds et al. (AAAI 2020) as published in their Figure 5"
)


def draw_all(
    record: pa.Table, learners: Sequence[str] = (), experiment: Experiment | None = None
) -> list[Drawing]:
    """Every figure that the record has data for.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        learners: Labels of learners in the order in which to draw them; the others follow.
        experiment: What was run: what differs from the paper there is not drawn beside the paper's
            results. Without it names decide.

    Returns:
        See :func:`draw_counted`.
    """
    return draw_counted(count(record), learners, experiment)


def draw_counted(
    counts: Counts, learners: Sequence[str] = (), experiment: Experiment | None = None
) -> list[Drawing]:
    """Every figure of a record that is counted already.

    Args:
        counts: From :func:`~causal_openlock.analysis.results.counting.count`.
        learners: As in :func:`draw_all`.
        experiment: As there.

    Returns:
        Those of :func:`baseline_attempts`, :func:`transfer_attempts`,
        :func:`~causal_openlock.analysis.plots.categories.baseline_categories`,
        :func:`~causal_openlock.analysis.plots.categories.transfer_categories` and, for each
        protocol, :func:`~causal_openlock.analysis.plots.course.attempts_by_trial` that there are
        data for.
    """
    trials, blocks = counts.trials, counts.blocks
    bounds = ideal_bounds(experiment) if experiment else {}
    pairs = comparable(experiment) if experiment else None
    beside_people = trials[did_what_people_did(trials, pairs)]
    if experiment:
        blocks = blocks[blocks["condition"].isin(list(paper_conditions(experiment)))]
    drawings = [
        baseline_attempts(beside_people, learners, bounds),
        transfer_attempts(beside_people, learners, bounds),
        baseline_categories(blocks, learners),
        transfer_categories(blocks, learners),
        *(
            attempts_by_trial(trials, protocol, learners, bounds)
            for protocol in trials["protocol"].unique()
        ),
    ]
    named: dict[str, Drawing] = {}
    for drawing in drawings:
        if drawing is not None:
            name = drawing.name
            while name in named:  # protocols whose names differ in signs only
                name += "_2"
            named[name] = replace(drawing, name=name)
    return list(named.values())


def baseline_attempts(
    trials: pd.DataFrame, learners: Sequence[str] = (), bounds: Bounds | None = None
) -> Drawing | None:
    """Figure 3: mean attempts in each baseline trial, CC4 beside CE4.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        learners: The order of the panels.
        bounds: From :func:`~causal_openlock.analysis.results.bounds.ideal_bounds`.

    Returns:
        The drawing, or None if no learner played CC4 or CE4 under the human protocol.
    """
    chosen = _human(trials, BASELINES, "train")
    if chosen.empty:
        return None
    means = mean_by_trial(chosen)
    count = max(int(means["trial"].max()), int(people()["trial"].max()))
    ideal = _ideal(means, bounds, "train")
    with style.settings():
        names = ordered(means["learner"], learners)
        shown = _with_published(names, means, "train")
        figure, axes = style.panels(len(shown), columns=3, height=2.3)
        for panel, (name, kind, rows) in zip(axes, shown, strict=True):
            for side, condition in enumerate(BASELINES):
                one = rows[rows["condition"] == condition]
                _bars(panel, one["trial"] + 0.4 * side - 0.2, one, style.trained_colour(condition))
            panel.set_xticks(range(1, count + 1))
            panel.set_xlim(0.4, count + 0.6)
            for attempts in sorted({bound.attempts for bound in ideal.values()}):
                style.ideal_line(panel, attempts, 0.4, count + 0.6)
            panel.set_xlabel("Trial")
            style.panel_title(panel, name, kind + style.sizes(rows))
        keys = [(name, style.trained_colour(name)) for name in BASELINES]
        _finish(figure, axes, trials, keys, bool(ideal))
    return Drawing(
        "baseline_attempts",
        "Baseline trials",
        "Mean attempts to solve each of the baseline trials, common cause (CC4) "
        f"beside common effect (CE4); {_SOURCES.format(3)}. {_ERROR_BARS}{_ideal_caption(ideal)}",
        figure,
    )


def transfer_attempts(
    trials: pd.DataFrame, learners: Sequence[str] = (), bounds: Bounds | None = None
) -> Drawing | None:
    """Figure 4: mean attempts in the transfer test, by what was tested and what was trained.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        learners: The order of the panels.
        bounds: From :func:`~causal_openlock.analysis.results.bounds.ideal_bounds`.

    Returns:
        The drawing, or None if no learner played a transfer condition of the paper under the
        human protocol.
    """
    chosen = _human(trials, TRANSFERS, "test")
    if chosen.empty:
        return None
    means = mean_by_trial(chosen, ["phase"])
    ideal = _ideal(means, bounds, "test")
    with style.settings():
        names = ordered(means["learner"], learners)
        shown = _with_published(names, means, "test")
        figure, axes = style.panels(len(shown), columns=3, height=2.3)
        for panel, (name, kind, rows) in zip(axes, shown, strict=True):
            for place, condition in enumerate(TRANSFERS):
                one = rows[rows["condition"] == condition]
                x = place // 2 + 0.4 * (place % 2) - 0.2
                _bars(panel, np.full(len(one), x), one, style.trained_colour(condition))
            panel.set_xticks([0, 1], BASELINES)
            panel.set_xlim(-0.6, 1.6)
            halves = {(TRANSFERS.index(name) // 2, bound.attempts) for name, bound in ideal.items()}
            for half, attempts in sorted(halves):
                style.ideal_line(panel, attempts, half - 0.45, half + 0.45)
            panel.set_xlabel("Transfer test")
            style.panel_title(panel, name, kind + style.sizes(rows))
        keys = [(f"{name} training", style.trained_colour(name)) for name in ("CC3", "CE3")]
        _finish(figure, axes, trials, keys, bool(ideal))
    return Drawing(
        "transfer_attempts",
        "Transfer test",
        "Mean attempts to solve the trial of the four-lever test, common cause (CC4) left and "
        "common effect (CE4) right, after training with three levers under CC3 or CE3; "
        f"{_SOURCES.format(4)}. {_ERROR_BARS}{_ideal_caption(ideal)}",
        figure,
    )


def _human(trials: pd.DataFrame, conditions: Sequence[str], phase: str) -> pd.DataFrame:
    return trials[
        (trials["protocol"] == HUMAN_PROTOCOL)
        & trials["condition"].isin(conditions)
        & (trials["phase"] == phase)
    ]


def _ideal(means: pd.DataFrame, bounds: Bounds | None, phase: str) -> dict[str, Bound]:
    """What the ideal observer needs in the conditions that were played."""
    keys = {name: (str(name), HUMAN_PROTOCOL, phase) for name in ordered(means["condition"])}
    return {name: bounds[key] for name, key in keys.items() if bounds and key in bounds}


def _ideal_caption(ideal: Mapping[str, Bound]) -> str:
    return f" Dashed: {style.IDEAL}, {bounds_in_words(ideal.values())}." if ideal else ""


def _with_published(
    names: Sequence[str], means: pd.DataFrame, phase: str
) -> list[tuple[str, str, pd.DataFrame]]:
    """Each panel's title, what it says before the number of subjects, and its means."""
    published = [("People", "", people()), ("Published model", "theory-based, ", model())]
    return [
        *((name, kind, table[table["phase"] == phase]) for name, kind, table in published),
        *((name, "", means[means["learner"] == name]) for name in names),
    ]


def _bars(axes: Axes, x: Any, rows: pd.DataFrame, colour: str) -> None:
    axes.bar(x, rows["mean"], width=0.38, color=colour, edgecolor="black", linewidth=0.6)
    spread = rows["se"].where(rows["subjects"] > 1)  # one subject has none
    axes.errorbar(x, rows["mean"], spread, fmt="none", ecolor="black", elinewidth=0.9, capsize=2)


def _finish(
    figure: Any,
    axes: Sequence[Axes],
    trials: pd.DataFrame,
    keys: Sequence[tuple[str, str]],
    ideal: bool,
) -> None:
    limit = float(trials.loc[trials["protocol"] == HUMAN_PROTOCOL, "last_attempt"].max())
    axes[0].set_ylim(0, max(30.0, limit) * 1.03)
    axes[0].yaxis.set_major_locator(_ticks(max(30.0, limit)))
    style.label_rows(axes, "Attempts")
    handles: list[Any] = [
        Patch(fc=colour, ec="black", lw=0.6, label=label) for label, colour in keys
    ]
    style.legend(figure, [*handles, style.ideal_key()] if ideal else handles)


def _ticks(limit: float) -> Any:
    return MultipleLocator(5) if limit <= 40 else MaxNLocator(integer=True)
