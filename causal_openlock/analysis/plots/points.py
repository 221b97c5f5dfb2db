"""People's means at fourteen points, and a learner's beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Plot
from causal_openlock.analysis.results.people.human_likeness import (
    PUBLISHED_MODEL,
    distance,
    effects_of,
)

CLEAR = 0.05
"""An effect is clear of chance if its sign is people's and its p is below this."""

MOST_DRAWN = 5
"""So many learners are drawn beside people and the published model: those nearest to people."""

_BASELINES = {"CC4": 0.0, "CE4": 5.8}  # where their trials begin on the x axis
_TESTS = dict(zip(TRANSFERS, (12.3, 14.1, 16.5, 18.3), strict=True))
_GREY = "#777777"


def draw_points(
    shown: Sequence[pd.DataFrame],
    most: int = MOST_DRAWN,
    effects: Mapping[str, pd.DataFrame] | None = None,
) -> Plot:
    """Draw people's means at the fourteen points, and one learner's beside them in each panel.

    Args:
        shown: The points of each learner, the nearest to people first.
        most: How many learners to draw at most, besides the published model.
        effects: From :func:`~causal_openlock.analysis.results.people.human_likeness.effects_of`,
            by learner; of others they come from the points alone.
    """
    named = [(str(own["learner"].iloc[0]), own) for own in shown]
    drawn = [one for one in named if one[0] != PUBLISHED_MODEL][:most]
    drawn += [one for one in named if one[0] == PUBLISHED_MODEL]
    titled = []
    for name, own in drawn:
        tested = (effects or {}).get(name)
        found = signs(effects_of(own) if tested is None else tested)
        titled.append((name, f"RMSE {distance(own)[0]:.2f}; {found}", own))
    keys = [
        Line2D([], [], marker="o", ms=4, ls="", color=_GREY, label="people"),
        Line2D([], [], marker="D", ms=4.5, ls="", color=style.COMMON_CAUSE, label="on CC4"),
        Line2D([], [], marker="D", ms=4.5, ls="", color=style.COMMON_EFFECT, label="on CE4"),
    ]
    layout = (2, 2.5, "Attempts to solve")
    figure = style.small_multiples(titled, draw_learner_points, layout, keys)
    highest = max(float(own[["mean", "people_mean"]].max().max()) for _, own in drawn)
    figure.axes[0].set_ylim(0, 1.2 * highest)  # all panels have the same scale
    return Plot("human_likeness", figure)


def signs(effects: pd.DataFrame) -> str:
    """How many of one learner's effects have people's sign, and how many are clear of chance."""
    like = int(effects["like_people"].sum())
    return f"{like} of {len(effects)} signs, {clear_of_chance(effects)} at p < .05"


def clear_of_chance(effects: pd.DataFrame) -> int:
    """How many effects have people's sign and a p below :data:`CLEAR`."""
    return int((effects["like_people"] & (effects["p"] < CLEAR)).sum())


def draw_learner_points(axes: Axes, own: pd.DataFrame) -> None:
    """Draw people's points and those of one learner into axes."""
    for condition, rows in own.groupby("condition", sort=False):
        start = _TESTS.get(str(condition))
        x = (
            np.array([start])
            if start
            else _BASELINES[str(condition)] + rows["trial"].to_numpy(float)
        )
        line = "" if start else "-"
        colour = style.COMMON_CAUSE if str(condition).endswith("CC4") else style.COMMON_EFFECT
        axes.errorbar(
            x - 0.13, rows["people_mean"], rows["people_se"],
            fmt=f"o{line}", ms=3.5, lw=0.8, color=_GREY, elinewidth=0.9,
        )  # fmt: skip
        axes.errorbar(
            x + 0.13, rows["mean"], rows["se"],
            fmt=f"D{line}", ms=3.8, lw=1.1, color=colour, elinewidth=0.9,
        )  # fmt: skip
    axes.set_xticks(
        [*(start + trial for start in _BASELINES.values() for trial in range(1, 6)),
         *_TESTS.values()],
        [*(list("12345") * 2), *(name.split("-")[0] for name in _TESTS)],
        fontsize=7,
    )  # fmt: skip
    for at, text in ((3.0, "CC4"), (8.8, "CE4"), (13.2, "→ CC4"), (17.4, "→ CE4")):
        axes.annotate(
            text, (at, 0), xytext=(0, -18), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", va="top", fontsize=8, fontweight="bold",
        )  # fmt: skip
    axes.set_xlim(0.3, 19.2)
