"""Attempts to solve a trial, drawn: the paper's Figures 3 and 4, and every condition by trial.

Figures 3 and 4 put people first and every learner that played the human protocol after them, one
panel each with a common scale. Error bars are the paper's everywhere, population SD / √n, so that
bars of people and of learners mean the same.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator, MultipleLocator

from causal_openlock.analysis import style
from causal_openlock.analysis.categories import baseline_categories, transfer_categories
from causal_openlock.analysis.measures import (
    BASELINES,
    PAPER_CONDITIONS,
    TRANSFERS,
    attempts_to_solve,
    category_counts,
    mean_by_trial,
    number_visits,
    ordered,
)
from causal_openlock.analysis.style import Drawing
from causal_openlock.analysis.summary import HUMAN_PROTOCOL, people, people_per_condition

if TYPE_CHECKING:
    import pyarrow as pa

_ERROR_BARS = "Error bars: ± 1 standard error (population SD / √n)."
_POINTS = 60  # the most that a line by trial is drawn with
_MARKERS = 12  # with more points than this a line has no markers


def draw_all(record: pa.Table, learners: Sequence[str] = ()) -> list[Drawing]:
    """Every figure that the record has data for.

    Args:
        record: Columns as in :func:`causal_openlock.record.record_schema`, rows in any order.
        learners: Labels of learners in the order in which to draw them; the others follow.

    Returns:
        Those of :func:`baseline_attempts`, :func:`transfer_attempts`,
        :func:`~causal_openlock.analysis.categories.baseline_categories`,
        :func:`~causal_openlock.analysis.categories.transfer_categories` and, for each protocol,
        :func:`attempts_by_trial` that there are data for.
    """
    trials = attempts_to_solve(record)
    drawings = [
        baseline_attempts(trials, learners),
        transfer_attempts(trials, learners),
        baseline_categories(category_counts(record, blocks=5), learners),
        transfer_categories(category_counts(record, blocks=1), learners),
        *(
            attempts_by_trial(trials, protocol, learners)
            for protocol in trials["protocol"].unique()
        ),
    ]
    return [drawing for drawing in drawings if drawing is not None]


def baseline_attempts(trials: pd.DataFrame, learners: Sequence[str] = ()) -> Drawing | None:
    """Figure 3: mean attempts in each baseline trial, CC4 beside CE4.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        learners: The order of the panels.

    Returns:
        The drawing, or None if no learner played CC4 or CE4 under the human protocol.
    """
    chosen = _human(trials, BASELINES, "train")
    if chosen.empty:
        return None
    means = mean_by_trial(chosen)
    published = _published("train")
    count = max(int(means["trial"].max()), int(published["trial"].max()))
    with style.settings():
        names = ordered(means["learner"], learners)
        figure, axes = style.panels(1 + len(names), columns=3, height=2.3)
        for panel, name, rows in _with_people(axes, names, means, published):
            for side, condition in enumerate(BASELINES):
                one = rows[rows["condition"] == condition]
                _bars(panel, one["trial"] + 0.4 * side - 0.2, one, _colour(condition))
            panel.set_xticks(range(1, count + 1))
            panel.set_xlim(0.4, count + 0.6)
            panel.set_xlabel("Trial")
            style.panel_title(panel, name, _sizes(rows))
        _finish(figure, axes, trials, [(name, _colour(name)) for name in BASELINES])
    return Drawing(
        "baseline_attempts",
        "Baseline trials",
        "Mean attempts to find every solution in each of the baseline trials, common cause (CC4) "
        "beside common effect (CE4); the first panel shows people as published in the paper's "
        f"Figure 3. {_ERROR_BARS}",
        figure,
    )


def transfer_attempts(trials: pd.DataFrame, learners: Sequence[str] = ()) -> Drawing | None:
    """Figure 4: mean attempts in the transfer test, by what was tested and what was trained.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        learners: The order of the panels.

    Returns:
        The drawing, or None if no learner played a transfer condition of the paper under the
        human protocol.
    """
    chosen = _human(trials, TRANSFERS, "test")
    if chosen.empty:
        return None
    means = mean_by_trial(chosen, ["phase"])
    with style.settings():
        names = ordered(means["learner"], learners)
        figure, axes = style.panels(1 + len(names), columns=3, height=2.3)
        for panel, name, rows in _with_people(axes, names, means, _published("test")):
            for place, condition in enumerate(TRANSFERS):
                one = rows[rows["condition"] == condition]
                x = place // 2 + 0.4 * (place % 2) - 0.2
                _bars(panel, np.full(len(one), x), one, _colour(condition))
            panel.set_xticks([0, 1], BASELINES)
            panel.set_xlim(-0.6, 1.6)
            panel.set_xlabel("Transfer test")
            style.panel_title(panel, name, _sizes(rows))
        keys = [(f"{name} training", _colour(name)) for name in ("CC3", "CE3")]
        _finish(figure, axes, trials, keys)
    return Drawing(
        "transfer_attempts",
        "Transfer test",
        "Mean attempts to find every solution in the four-lever test, common cause (CC4) left and "
        "common effect (CE4) right, after training with three levers under CC3 or CE3; the first "
        f"panel shows people as published in the paper's Figure 4. {_ERROR_BARS}",
        figure,
    )


def attempts_by_trial(
    trials: pd.DataFrame, protocol: str, learners: Sequence[str] = ()
) -> Drawing | None:
    """Mean attempts over the course of every condition of a protocol, whichever they are.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        protocol: Name of the protocol.
        learners: The order of the panels.

    Returns:
        The drawing, or None if there are no trials under that protocol.
    """
    chosen = trials.assign(visit=number_visits(trials))[trials["protocol"] == protocol]
    if chosen.empty:
        return None
    most = chosen.groupby("condition", observed=True)["visit"].transform("max").astype(int)
    width = -(-most // _POINTS)
    first = (chosen["visit"] - 1) // width * width + 1
    # A point of a long course stands for as many visits in a row, in its middle.
    chosen = chosen.assign(place=first + (np.minimum(width, most - first + 1) - 1) / 2)
    means = mean_by_trial(chosen, ["phase", "place"])
    with style.settings():
        names = ordered(means["learner"], learners)
        conditions = ordered(means["condition"])
        looks = _looks(conditions)
        figure, axes = style.panels(len(names), columns=3 if len(names) > 2 else 2, height=2.3)
        for panel, name in zip(axes, names, strict=True):
            rows = means[means["learner"] == name]
            for index, condition in enumerate(conditions):
                one = rows[rows["condition"] == condition]
                aside = (index - (len(conditions) - 1) / 2) * min(0.08, 0.4 / len(conditions))
                _course(panel, one, looks[condition], aside)
            panel.set_ylim(bottom=0)
            panel.xaxis.set_major_locator(MaxNLocator(8, integer=True))
            panel.set_xlabel("Trial, in the order played")
            style.panel_title(panel, name, _sizes(rows))
        style.label_rows(axes, "Attempts")
        keys: list[Any] = [Line2D([], [], label=name, **looks[name]) for name in conditions]
        if (chosen["phase"] == "test").any():
            keys.append(
                Line2D([], [], ls="", marker="o", mfc="white", mec="black", label="transfer test")
            )
        style.legend(figure, keys, columns=4)
    wide = int(width.max())
    return Drawing(
        "attempts_by_trial_" + re.sub(r"\W+", "_", protocol.lower(), flags=re.ASCII),
        f"Attempts by trial, protocol {protocol}",
        "Mean attempts to find every solution in each trial, in the order in which they were "
        "played"
        + (f" (a point averages up to {wide} trials in a row)" if wide > 1 else "")
        + ". Shaded: ± 1 standard error (population SD / √n).",
        figure,
    )


def _human(trials: pd.DataFrame, conditions: Sequence[str], phase: str) -> pd.DataFrame:
    return trials[
        (trials["protocol"] == HUMAN_PROTOCOL)
        & trials["condition"].isin(conditions)
        & (trials["phase"] == phase)
    ]


def _published(phase: str) -> pd.DataFrame:
    table = people().rename(columns={"human_attempts": "mean", "human_se": "se"})
    return table[table["phase"] == phase].assign(subjects=people_per_condition())


def _with_people(
    axes: Sequence[Axes], names: Sequence[str], means: pd.DataFrame, published: pd.DataFrame
) -> list[tuple[Axes, str, pd.DataFrame]]:
    tables = [published, *(means[means["learner"] == name] for name in names)]
    return list(zip(axes, ["People", *names], tables, strict=True))


def _sizes(rows: pd.DataFrame) -> str:
    low, high = int(rows["subjects"].min()), int(rows["subjects"].max())
    return f"n = {low}" if low == high else f"n = {low} to {high}"


def _bars(axes: Axes, x: Any, rows: pd.DataFrame, colour: str) -> None:
    axes.bar(x, rows["mean"], width=0.38, color=colour, edgecolor="black", linewidth=0.6)
    axes.errorbar(
        x, rows["mean"], rows["se"], fmt="none", ecolor="black", elinewidth=0.9, capsize=2
    )


def _finish(
    figure: Any, axes: Sequence[Axes], trials: pd.DataFrame, keys: Sequence[tuple[str, str]]
) -> None:
    limit = float(trials.loc[trials["protocol"] == HUMAN_PROTOCOL, "last_attempt"].max())
    axes[0].set_ylim(0, max(30.0, limit) * 1.03)
    axes[0].yaxis.set_major_locator(_ticks(max(30.0, limit)))
    style.label_rows(axes, "Attempts")
    style.legend(
        figure, [Patch(fc=colour, ec="black", lw=0.6, label=label) for label, colour in keys]
    )


def _ticks(limit: float) -> Any:
    return MultipleLocator(5) if limit <= 40 else MaxNLocator(integer=True)


def _colour(condition: str) -> str:
    """By the schema that was trained: common cause or common effect."""
    return style.COMMON_CAUSE if condition.startswith("CC") else style.COMMON_EFFECT


def _looks(conditions: Sequence[str]) -> dict[str, dict[str, Any]]:
    """How each condition's line looks; the paper's say by colour what they train."""
    looks: dict[str, dict[str, Any]] = {}
    for condition in conditions:
        if condition in PAPER_CONDITIONS:
            kind = 0 if condition in BASELINES else 1 + TRANSFERS.index(condition) // 2
            colour = _colour(condition)
        else:
            others = sum(name not in PAPER_CONDITIONS for name in looks)
            kind, colour = others // len(style.OTHER) % 3, style.OTHER[others % len(style.OTHER)]
        looks[condition] = {
            "color": colour,
            "ls": ("-", (0, (5, 1.5)), (0, (1, 1.2)))[kind],
            "marker": "os^"[kind],
            "ms": 4,
            "lw": 1.4,
        }
    return looks


def _course(axes: Axes, rows: pd.DataFrame, look: dict[str, Any], aside: float) -> None:
    """A line for each phase; points that have markers stand a little aside of one another."""
    for phase, part in rows.groupby("phase", observed=True):
        x, mean, se = (part[column].to_numpy(dtype=float) for column in ("place", "mean", "se"))
        face = "white" if phase == "test" else look["color"]
        marked = len(x) <= _MARKERS
        x = x + aside * marked
        axes.fill_between(x, mean - se, mean + se, color=look["color"], alpha=0.15, lw=0)
        if len(x) == 1:  # a band of no width
            axes.errorbar(x, mean, se, fmt="none", ecolor=look["color"], elinewidth=1, capsize=2)
        line = {**look, "marker": look["marker"] if marked else ""}
        axes.plot(x, mean, **line, mfc=face, clip_on=False, zorder=3)


__all__ = ["attempts_by_trial", "baseline_attempts", "draw_all", "transfer_attempts"]
