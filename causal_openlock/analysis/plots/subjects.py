"""How the subjects of a learner vary: a circle is as large as their share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import by_subject, judged, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import NothingToDrawError

_BINS = 30  # heights that circles can have
_WIDEST = 16.0  # diameter of a circle that is all subjects, in points
_CIRCLES = 84.0  # of those of all conditions next to one another


def plot_subjects(
    results: Material, *, learners: Names = None, conditions: Names = None, ax: Any = None
) -> Any:
    """Attempts of each subject in the trials that conditions are judged by.

    A learner has a panel for each protocol. All panels of a protocol have the same scale, which
    holds every subject of the results, so that figures of different learners can be laid side by
    side.

    >>> axes = plot_subjects(results, learners=["random"])
    >>> [label.get_text() for label in axes.get_xticklabels()][:2]
    ['CC4', 'CE4']

    Arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    table = rows_of(results, results.headline, learners, conditions)
    order = {name: place for place, name in enumerate(results.conditions)}
    table = table.sort_values("condition", key=lambda of: of.astype(str).map(order), kind="stable")
    shown = [
        (name, protocol, own[own["protocol"] == protocol])
        for name in ordered(table["learner"], results.learners)
        for own in [table[table["learner"] == name]]
        for protocol in ordered(own["protocol"], ("human",))
    ]
    if not shown:
        raise NothingToDrawError("no such learner played such a condition")
    values = results.once(_values)
    keys = [
        Line2D([], [], **_circle(), marker="o", ls="", ms=7, label="subjects"),
        Line2D([], [], color="black", lw=2, label="mean, 95% interval"),
    ]
    looks: dict[str, dict[str, Any]] = {
        one.reference.prefix: {"color": style.current().other(2), "marker": marker, "ms": 4.5}
        for one, marker in zip(results.leading, cycle("Ds^v"), strict=False)
    }
    for one in results.leading:
        if table[f"{one.reference.prefix}_attempts"].notna().any():
            look = looks[one.reference.prefix]
            keys.append(Line2D([], [], ls="", label=one.reference.name, **look))
    if table["ideal_attempts"].notna().any():
        keys.append(style.ideal_key())
    protocols, most = table["protocol"].nunique(), max(len(own) for _, _, own in shown)
    columns, common = 3 if most <= 4 else 2, protocols == 1
    rows = in_rows(len(shown), columns, 2.6, common=common, above=0.7)  # a legend of two lines
    with panels(ax, len(shown), rows) as at:
        for axes, (name, protocol, own) in zip(at.axes, shown, strict=True):
            played = values[values["protocol"] == protocol]
            means = results.headline[results.headline["protocol"] == protocol]
            known = [(means[f"{of}_attempts"] + means[f"{of}_se"]).max() for of in looks]
            ideal = means["ideal_attempts"].max()
            highest = float(np.nanmax([played["attempts"].max(), *known, ideal]))
            widest = min(_WIDEST, _CIRCLES / len(own))
            _scale(axes, list(own["condition"]), highest)
            for place, row in enumerate(own.to_dict("records")):
                of_row = (played["learner"] == name) & (played["condition"] == row["condition"])
                mine = played.loc[of_row, "attempts"].to_numpy(float)
                _circles(axes, place, mine, highest, widest)
                _means(axes, place, row, looks)
            if len(shown) > 1:
                title = protocol if table["learner"].nunique() == 1 else name
                under = f"{protocol}, " if protocols > 1 and title != protocol else ""
                style.panel_title(axes, title, under + style.sizes(own))
        at.label_y("Attempts")
        at.legend(keys, columns=2)
    return at.returned


def _values(results: Material) -> pd.DataFrame:
    """Attempts of each subject of all learners."""
    return by_subject(judged(results.trials), ["phase"])


def _circle() -> dict[str, Any]:
    colour = style.current().other(3)
    return {"color": colour, "alpha": 0.75, "mec": "#1F6F9F"}


def _circles(axes: Axes, place: float, attempts: Any, highest: float, widest: float) -> None:
    look, width = _circle(), max(1.0, highest / _BINS)
    heights, counts = np.unique(np.round(attempts / width) * width, return_counts=True)
    axes.scatter(
        np.full(len(heights), place - 0.16), heights, s=widest**2 * counts / len(attempts),
        color=look["color"], alpha=look["alpha"], linewidths=0.5, edgecolors=look["mec"],
        zorder=2, clip_on=False,
    )  # fmt: skip


def _means(
    axes: Axes, place: float, row: Mapping[Any, Any], looks: Mapping[str, Mapping[str, Any]]
) -> None:
    """Draw the mean with its interval, those of references, and the ideal observer's line."""
    mean, low, high = (row[name] for name in ("attempts", "ci_low", "ci_high"))
    axes.plot([place + 0.14] * 2, [low, high], color="black", lw=1.4, zorder=3)
    axes.plot([place + 0.08, place + 0.2], [mean] * 2, color="black", lw=2, zorder=3)
    for number, (of, look) in enumerate(looks.items()):
        if row[f"{of}_attempts"] == row[f"{of}_attempts"]:
            axes.errorbar(
                place + 0.3 + 0.08 * number, row[f"{of}_attempts"], row[f"{of}_se"],
                ls="", elinewidth=1, capsize=2, zorder=3, **look,
            )  # fmt: skip
    if row["ideal_attempts"] == row["ideal_attempts"]:
        style.ideal_line(axes, row["ideal_attempts"], place - 0.38, place + 0.4)


def _scale(axes: Axes, conditions: Sequence[str], highest: float) -> None:
    """Axes with a place for each condition, and room for a circle at either end."""
    names = [style.label(name, 16) for name in conditions]
    axes.set_xlim(-0.6, len(names) - 0.4)
    turned = style.SLANTED if style.crowded(axes, range(len(names)), names) else {}
    axes.set_xticks(range(len(names)), names, **turned)
    axes.set_ylim(-0.07 * highest, 1.07 * highest)
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
