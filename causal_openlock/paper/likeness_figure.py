"""Figure of people's means at fourteen points, and of a learner's."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
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
    Likeness,
    distance,
    likeness,
    points_of_model,
    points_of_people,
)
from causal_openlock.paper.noise_ceiling import misfit, noise_ceiling
from causal_openlock.paper.references import people_beside

CLEAR = 0.05
"""An effect is clear of chance if its sign is people's and its p is below this."""

MOST_DRAWN = 5
"""Learners that have a panel next to the published model's: those nearest to people."""

MOST_TOGETHER = 4
"""Learners that are drawn in one panel: those nearest to people."""

_BASELINES = {"CC4": 0.0, "CE4": 5.8}  # where their trials begin on the x axis
_TESTS = dict(zip(TRANSFERS, (12.3, 14.1, 16.5, 18.3), strict=True))
_GREY = "#777777"


def plot_likeness(
    results: Material, *, learners: Names = None, together: bool = False, ax: Any = None
) -> Any:
    """Draw people's means at the fourteen points, and one learner's in each panel.

    The learners stand in the order of their distance from people, the nearest first. The published
    model stands last, even where it is nearer than they are. Above a panel: that distance (RMSE),
    that of a perfect model with the same number of subjects, whether sampling error explains it
    (:func:`~causal_openlock.paper.noise_ceiling.misfit`), and how many differences between
    conditions or trials go the same way as people's.

    >>> [axes.get_title(loc="left") for axes in plot_likeness(results, learners=["random"])]
    ['random', 'published model']

    With ``together`` there are two panels: people with the published model, and the learners that
    are given neither the schema nor the room. By default the nearest :data:`MOST_DRAWN` learners
    are drawn. Arguments, what is returned and
    errors are those of :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    found = results.once(likeness_of)
    if learners is not None:
        trials = rows_of(results, results.trials, learners)
        found = likeness(trials, people_beside(results), results.learners)
    if found is None:
        raise NothingToDrawError(
            "no such learner played all six conditions of the paper as people did, in its rooms "
            "under the protocol human"
        )
    own = {name: points for name, points in found.points.items() if name != PUBLISHED_MODEL}
    names = list(own) if learners is not None else list(own)[:MOST_DRAWN]
    if together:
        given = {spec.name for spec in results.experiment.learners if spec.origin.informed}
        if learners is None and not given.issuperset(own):
            names = [name for name in own if name not in given][:MOST_TOGETHER]
        return draw_together({name: own[name] for name in names}, ax)
    drawn = {name: found.points[name] for name in [*names, PUBLISHED_MODEL]}
    return draw_points(drawn, found.effects, ax)


def likeness_of(results: Material) -> Likeness | None:
    """Compare all learners of some results with people; None where none can be compared."""
    return likeness(results.trials, people_beside(results), results.learners)


def draw_points(
    points: Mapping[str, pd.DataFrame],
    effects: Mapping[str, pd.DataFrame],
    ax: Any = None,
    fitted: Mapping[str, int] = MappingProxyType({}),
) -> Any:
    """Draw the panels from points, effects that were tested and numbers that were fitted."""
    looks = (("o", 4, _GREY, "people"),
             ("D", 4.5, style.current().trained("CC4"), "on CC4"),
             ("D", 4.5, style.current().trained("CE4"), "on CE4"))  # fmt: skip
    highest = max(float(own[["mean", "people_mean"]].max().max()) for own in points.values())
    with panels(ax, len(points), in_rows(len(points), 2, 2.5)) as at:
        for axes, (name, own) in zip(at.axes, points.items(), strict=True):
            _draw_points_of_one(axes, own)
            number = fitted.get(name, 0)
            detail = (
                f"RMSE {distance(own)[0]:.2f} (perfect {noise_ceiling(own, number).both:.2f}), "
            )
            detail += f"{misfit(own, number).in_words}\n"
            detail += with_peoples_sign(effects[name])
            style.panel_title(axes, name, detail)
            axes.set_ylim(0, 1.2 * highest)  # all panels have the same scale
        at.label_y("Attempts to solve")
        at.legend(
            [Line2D([], [], marker=marker, ms=size, ls="", color=colour, label=text)
             for marker, size, colour, text in looks]
        )  # fmt: skip
    return at.returned


def draw_together(learners: Mapping[str, pd.DataFrame], ax: Any = None) -> Any:
    """Draw people with the published model in one panel, and learners in another.

    Args:
        learners: By name, its points from :func:`~causal_openlock.paper.likeness.points_of`.
        ax: An empty figure, or None.
    """
    people, model = points_of_people(), points_of_model()
    shown = [people, model, *learners.values()]
    highest = max(float((own["mean"] + own["se"].fillna(0)).max()) for own in shown)
    with panels(ax, 2, in_rows(2, 2, 1.8)) as at:
        for axes, title, groups in zip(
            at.axes, ("People", "Learners"),
            ({"people": people, "published model": model}, learners), strict=True,
        ):  # fmt: skip
            ends = {}
            for number, (name, own) in enumerate(groups.items()):
                look = style.current().line(number)
                if title == "People":
                    look = {"color": ("black", _GREY)[number], "ls": ("-", ":")[number]}
                _draw_line(axes, own, look)
                ends[name] = float(own["mean"].iloc[-1]), look["color"]
            _points_axis(axes)
            axes.set_xlim(0.3, 26.5)
            style.panel_title(axes, title)
            axes.set_ylim(0, 1.08 * highest)
            _name_lines(axes, ends, 0.075 * highest)
        at.label_y("Attempts to solve")
    return at.returned


def _draw_line(axes: Axes, own: pd.DataFrame, look: Mapping[str, Any]) -> None:
    """Draw one learner's points: baselines as lines, tests as dots."""
    for condition, rows in own.groupby("condition", sort=False):
        start = _TESTS.get(str(condition))
        line = {**look, "ls": "" if start else look["ls"]}
        x = [start] if start else _BASELINES[str(condition)] + rows["trial"].to_numpy(float)
        axes.errorbar(x, rows["mean"], rows["se"], fmt="o", ms=3.2, lw=1.2, elinewidth=0.9, **line)


def _name_lines(axes: Axes, ends: Mapping[str, tuple[float, str]], gap: float) -> None:
    """Write names right of the last points, at least ``gap`` apart, in the order of the points."""
    height = -np.inf
    for name, (value, colour) in sorted(ends.items(), key=lambda item: item[1][0]):
        height = max(value, height + gap)
        axes.annotate(
            style.label(name, 18), (19.2, height), va="center", fontsize="small", color=colour
        )


def signs(effects: pd.DataFrame) -> str:
    """Numbers of a learner's effects with people's sign, and clear of chance, in words."""
    return f"{with_peoples_sign(effects)}, {clear_of_chance(effects)} at p < {CLEAR:g}"


def with_peoples_sign(effects: pd.DataFrame) -> str:
    """Number of one learner's effects that have people's sign, in words."""
    return f"{int(effects['like_people'].sum())} of {len(effects)} effects with people's sign"


def clear_of_chance(effects: pd.DataFrame) -> int:
    """Number of effects that have people's sign and a p below :data:`CLEAR`."""
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
    _points_axis(axes)
    axes.set_xlim(0.3, 19.2)


def _points_axis(axes: Axes) -> None:
    """Name the fourteen points on the x axis."""
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
