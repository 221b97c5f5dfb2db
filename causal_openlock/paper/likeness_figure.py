"""Figure of people's means at fourteen points, and of a learner's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from causal_openlock.analysis.measures import BASELINES, TRANSFERS
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

_STARTS = dict(zip((*BASELINES, *TRANSFERS), (0.0, 5.8, 11.3, 13.1, 15.5, 17.3), strict=True))
"""Where the trials of a condition begin on the x axis."""
_GREY = "#777777"


def plot_likeness(
    results: Material, *, learners: Names = None, together: bool = False, ax: Any = None
) -> Any:
    """Draw people's means at the fourteen points, and one learner's in each panel.

    The nearest to people stands first, the published model last. Above a panel: the distance
    (RMSE), that of a perfect model with as many subjects, whether sampling error explains it
    (:func:`~causal_openlock.paper.noise_ceiling.misfit`), and how many effects have people's sign.

    >>> [axes.get_title(loc="left") for axes in plot_likeness(results, learners=["random"])]
    ['random', 'published model']

    With ``together`` there are two panels: people with the published model, and the learners that
    are given neither the schema nor the room. By default the nearest :data:`MOST_DRAWN` are drawn.
    Arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
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
    people: Any = {"marker": "o", "ms": 3.5, "color": _GREY, "lw": 0.8, "ls": "-"}
    colours = {schema: style.current().trained(schema) for schema in BASELINES}
    highest = max(float(own[["mean", "people_mean"]].max().max()) for own in points.values())
    with panels(ax, len(points), in_rows(len(points), 2, 2.5)) as at:
        for axes, (name, own) in zip(at.axes, points.items(), strict=True):
            number = fitted.get(name, 0)
            detail = (
                f"RMSE {distance(own)[0]:.2f} (perfect {noise_ceiling(own, number).both:.2f}), "
                f"{misfit(own, number).in_words}\n{with_peoples_sign(effects[name])}"
            )
            _draw_line(axes, own, people, -0.13, "people_")
            for schema, colour in colours.items():
                look = {**people, "marker": "D", "ms": 3.8, "color": colour, "lw": 1.1}
                _draw_line(axes, own[own["condition"].str.endswith(schema)], look, 0.13)
            style.panel_title(axes, name, detail)
            _points_axis(axes, 19.2, 1.2 * highest)  # all panels have the same scale
        at.label_y("Attempts to solve")
        keys = [Line2D([], [], marker="o", ms=4, ls="", color=_GREY, label="people")]
        keys += [
            Line2D([], [], marker="D", ms=4.5, ls="", color=colour, label=f"on {schema}")
            for schema, colour in colours.items()
        ]
        at.legend(keys)
    return at.returned


def draw_together(learners: Mapping[str, pd.DataFrame], ax: Any = None) -> Any:
    """Draw people with the published model in one panel, and learners in another.

    Args:
        learners: By name, its points from :func:`~causal_openlock.paper.likeness.points_of`.
        ax: An empty figure, or None.
    """
    people = {"people": points_of_people(), "published model": points_of_model()}
    greys = ({"color": "black", "ls": "-"}, {"color": _GREY, "ls": ":"})
    looks = [style.current().line(number) for number in range(len(learners))]
    shown = [*people.values(), *learners.values()]
    highest = max(float((own["mean"] + own["se"].fillna(0)).max()) for own in shown)
    with panels(ax, 2, in_rows(2, 2, 1.8)) as at:
        for axes, title, group, lines in zip(
            at.axes, ("People", "Learners"), (people, learners), (greys, looks), strict=True
        ):
            for own, look in zip(group.values(), lines, strict=True):
                _draw_line(axes, own, {**look, "marker": "o", "ms": 3.2, "lw": 1.2})
            style.panel_title(axes, title)
            _points_axis(axes, 26.5, 1.08 * highest)
            _name_lines(axes, group, [look["color"] for look in lines], 0.075 * highest)
        at.label_y("Attempts to solve")
    return at.returned


def _draw_line(
    axes: Axes, points: pd.DataFrame, look: Mapping[str, Any], shift: float = 0, whose: str = ""
) -> None:
    """Draw means and standard errors: baselines as lines, tests as dots."""
    for condition, rows in points.groupby("condition", sort=False):
        start = _STARTS[str(condition)]
        line = {**look, "ls": "" if str(condition) in TRANSFERS else look["ls"]}
        x = start + rows["trial"].to_numpy(float) + shift
        axes.errorbar(x, rows[f"{whose}mean"], rows[f"{whose}se"], elinewidth=0.9, **line)


def _name_lines(
    axes: Axes, learners: Mapping[str, pd.DataFrame], colours: Sequence[str], gap: float
) -> None:
    """Write names right of the last points, at least ``gap`` apart, in the order of the points."""
    height = -np.inf
    ends = [float(own["mean"].iloc[-1]) for own in learners.values()]
    for value, name, colour in sorted(zip(ends, learners, colours, strict=True)):
        height = max(value, height + gap)
        axes.annotate(
            style.label(name, 18), (19.2, height), va="center", fontsize="small", color=colour
        )


def signs(effects: pd.DataFrame) -> str:
    """Numbers of a learner's effects with people's sign, and clear of chance, in words."""
    clear = int((effects["like_people"] & (effects["p"] < CLEAR)).sum())
    return f"{with_peoples_sign(effects)}, {clear} at p < {CLEAR:g}"


def with_peoples_sign(effects: pd.DataFrame) -> str:
    """Number of one learner's effects that have people's sign, in words."""
    return f"{int(effects['like_people'].sum())} of {len(effects)} effects with people's sign"


def _points_axis(axes: Axes, right: float, top: float) -> None:
    """Name the fourteen points on the x axis, and set the limits of both axes."""
    ticks = {_STARTS[name] + trial: str(trial) for name in BASELINES for trial in range(1, 6)}
    ticks |= {_STARTS[name] + 1: name.split("-")[0] for name in TRANSFERS}
    axes.set_xticks([*ticks], [*ticks.values()], fontsize="small")
    for at, text in ((3.0, "CC4"), (8.8, "CE4"), (13.2, "→ CC4"), (17.4, "→ CE4")):
        axes.annotate(
            text, (at, 0), xytext=(0, -18), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", va="top", fontsize="medium", fontweight="bold",
        )  # fmt: skip
    axes.set(xlim=(0.3, right), ylim=(0, top))
