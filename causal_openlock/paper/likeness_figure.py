"""People's means at fourteen points, and a learner's beside them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import NothingToDrawError
from causal_openlock.paper.likeness import (
    PUBLISHED_MODEL,
    distance,
    likeness,
)
from causal_openlock.paper.noise_ceiling import noise_ceiling
from causal_openlock.paper.references import people_beside

CLEAR = 0.05
"""An effect is clear of chance if its sign is people's and its p is below this."""

MOST_DRAWN = 5
"""So many learners are drawn beside people and the published model: those nearest to people."""

_BASELINES = {"CC4": 0.0, "CE4": 5.8}  # where their trials begin on the x axis
_TESTS = dict(zip(TRANSFERS, (12.3, 14.1, 16.5, 18.3), strict=True))
_GREY = "#777777"


def plot_likeness(results: Material, *, learners: Names = None, ax: Any = None) -> Any:
    """People's means at the fourteen points, and one learner's beside them in each panel.

    The learners stand in the order of their distance from people, the nearest first. The published
    model stands last, even where it is nearer than they are. Above a panel: that distance (RMSE),
    what a perfect model with as many subjects would come to, and how many differences between
    conditions or trials go the same way as people's.

    >>> import causal_openlock as ol
    >>> [axes.get_title(loc="left") for axes in ol.plot_likeness(results, learners=["random"])]
    ['random', 'published model']

    By default the nearest :data:`MOST_DRAWN` learners are drawn. Arguments, what is returned and
    errors are those of :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    trials = rows_of(results, results.trials, learners)
    found = likeness(trials, people_beside(results), results.learners)
    if found is None:
        raise NothingToDrawError(
            "no such learner played all six conditions of the paper as people did, in its rooms "
            "under the protocol human"
        )
    own = {name: points for name, points in found.points.items() if name != PUBLISHED_MODEL}
    names = list(own) if learners is not None else list(own)[:MOST_DRAWN]
    drawn = {name: found.points[name] for name in [*names, PUBLISHED_MODEL]}
    return draw_points(drawn, found.effects, ax)


def draw_points(
    points: Mapping[str, pd.DataFrame], effects: Mapping[str, pd.DataFrame], ax: Any = None
) -> Any:
    """The same of points, and of effects that were tested, by name."""
    looks = (("o", 4, _GREY, "people"),
             ("D", 4.5, style.current().common_cause, "on CC4"),
             ("D", 4.5, style.current().common_effect, "on CE4"))  # fmt: skip
    highest = max(float(own[["mean", "people_mean"]].max().max()) for own in points.values())
    with panels(ax, len(points), in_rows(len(points), 2, 2.5)) as at:
        for axes, (name, own) in zip(at.axes, points.items(), strict=True):
            _draw_points_of_one(axes, own)
            perfect = noise_ceiling(own).both
            detail = f"RMSE {distance(own)[0]:.2f} (a perfect model {perfect:.2f})\n"
            detail += with_peoples_sign(effects[name])
            style.panel_title(axes, name, detail)
            axes.set_ylim(0, 1.2 * highest)  # all panels have the same scale
        at.label_y("Attempts to solve")
        at.legend(
            [Line2D([], [], marker=marker, ms=size, ls="", color=colour, label=text)
             for marker, size, colour, text in looks]
        )  # fmt: skip
    return at.returned


def signs(effects: pd.DataFrame) -> str:
    """How many of one learner's effects have people's sign, and how many are clear of chance."""
    return f"{with_peoples_sign(effects)}, {clear_of_chance(effects)} at p < {CLEAR:g}"


def with_peoples_sign(effects: pd.DataFrame) -> str:
    """How many of one learner's effects have people's sign."""
    return f"{int(effects['like_people'].sum())} of {len(effects)} effects with people's sign"


def clear_of_chance(effects: pd.DataFrame) -> int:
    """How many effects have people's sign and a p below :data:`CLEAR`."""
    return int((effects["like_people"] & (effects["p"] < CLEAR)).sum())


def _draw_points_of_one(axes: Axes, own: pd.DataFrame) -> None:
    """People's points and those of one learner."""
    for condition, rows in own.groupby("condition", sort=False):
        start = _TESTS.get(str(condition))
        x = (
            np.array([start])
            if start
            else _BASELINES[str(condition)] + rows["trial"].to_numpy(float)
        )
        line = "" if start else "-"
        colour = style.current().trained(str(condition)[-3:])
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
        fontsize="small",
    )  # fmt: skip
    for at, text in ((3.0, "CC4"), (8.8, "CE4"), (13.2, "→ CC4"), (17.4, "→ CE4")):
        axes.annotate(
            text, (at, 0), xytext=(0, -18), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", va="top", fontsize="medium", fontweight="bold",
        )  # fmt: skip
    axes.set_xlim(0.3, 19.2)
