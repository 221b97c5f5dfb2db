"""How the subjects of a learner vary: a circle is as large as their share."""

from __future__ import annotations

from collections.abc import Sequence
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
from causal_openlock.analysis.statistics import sizes
from causal_openlock.errors import NothingToDrawError

_BINS = 30  # heights that circles can have
_WIDEST = 16.0  # diameter of a circle that is all subjects, in points
_EDGE = "#1F6F9F"
_MARKERS = "Ds^v"  # of references
_MEAN: Any = {"color": "black", "zorder": 3}


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
    if table.empty:
        raise NothingToDrawError("no such learner played such a condition")
    protocols = ordered(table["protocol"], ("human",))
    shown = [
        (name, protocol, own)
        for name in ordered(table["learner"], results.learners)
        for protocol in protocols
        if len(own := table[(table["learner"] == name) & (table["protocol"] == protocol)])
    ]
    leading = [one for one in results.leading if table[f"{one.prefix}_attempts"].notna().any()]
    points: Any = {"color": style.current().other(2), "ls": "", "ms": 4.5, "zorder": 3}
    circle: Any = {"color": style.current().other(3), "alpha": 0.75, "mec": _EDGE, "ls": ""}
    keys = [
        Line2D([], [], **circle, marker="o", ms=7, label="subjects"),
        Line2D([], [], **_MEAN, lw=2, label="mean, 95% interval"),
        *(Line2D([], [], **points, marker=_MARKERS[number % 4], label=one.name)
          for number, one in enumerate(leading)),
    ]  # fmt: skip
    if table["ideal_attempts"].notna().any():
        keys.append(style.ideal_key())
    values, headline = results.once(_attempts_of_subjects), results.headline
    columns = 3 if max(len(own) for _, _, own in shown) <= 4 else 2
    rows = in_rows(len(shown), columns, 2.6, common=len(protocols) == 1, above=0.7)
    with panels(ax, len(shown), rows) as at:
        for axes, (name, protocol, own) in zip(at.axes, shown, strict=True):
            played, means = (one[one["protocol"] == protocol] for one in (values, headline))
            known = [means[f"{one.prefix}_attempts"] + means[f"{one.prefix}_se"] for one in leading]
            drawn = (played["attempts"], means["ideal_attempts"], *known)
            highest = np.nanmax([column.max() for column in drawn])
            names = ordered(own["condition"], results.conditions)
            axes.set(xlim=(-0.6, len(names) - 0.4), ylim=(-0.07 * highest, 1.07 * highest))
            style.name_places(axes, range(len(names)), [style.label(one, 16) for one in names])
            axes.yaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
            _draw_circles(axes, names, played[played["learner"] == name], highest, name)
            place = np.array([names.index(one) for one in own["condition"]], float)
            axes.vlines(place + 0.14, own["ci_low"], own["ci_high"], lw=1.4, **_MEAN)
            axes.hlines(own["attempts"], place + 0.08, place + 0.2, lw=2, **_MEAN)
            for number, one in enumerate(leading):
                axes.errorbar(
                    place + 0.3 + 0.08 * number, own[f"{one.prefix}_attempts"],
                    own[f"{one.prefix}_se"], elinewidth=1, capsize=2,
                    marker=_MARKERS[number % 4], **points,
                )  # fmt: skip
            for spot, attempts in zip(place, own["ideal_attempts"], strict=True):
                style.ideal_line(axes, attempts, spot - 0.38, spot + 0.4)
            if len(shown) > 1:
                title = protocol if table["learner"].nunique() == 1 else name
                under = f"{protocol}, " if len(protocols) > 1 and title != protocol else ""
                style.panel_title(axes, title, under + sizes(own))
        at.label_y("Attempts")
        at.legend(keys, columns=2)
    return at.returned


def _attempts_of_subjects(results: Material) -> pd.DataFrame:
    return by_subject(judged(results.trials), ["phase"])


def _draw_circles(
    axes: Axes, names: Sequence[str], played: pd.DataFrame, highest: float, name: str
) -> None:
    """Draw a circle for the subjects of each interval of attempts, as large as their share."""
    width = max(1.0, highest / _BINS)
    played = played[played["condition"].isin(names)]
    place = [names.index(one) for one in played["condition"]]
    height = np.round(played["attempts"].to_numpy() / width) * width
    circles, counts = np.unique([place, height], axis=1, return_counts=True)
    share = counts / np.bincount(place)[circles[0].astype(int)]
    axes.scatter(
        circles[0] - 0.16, circles[1], s=_WIDEST**2 * share, alpha=0.75, linewidths=0.5,
        color=style.current().colors.get(name, style.current().other(3)), edgecolors=_EDGE,
        zorder=2, clip_on=False,
    )  # fmt: skip
