"""How the subjects of a learner vary: a circle is as large as their share."""

from __future__ import annotations

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
from causal_openlock.analysis.statistics import sizes
from causal_openlock.errors import NothingToDrawError

_BINS = 30  # heights that circles can have
_WIDEST = 16.0  # diameter of a circle that is all subjects, in points


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
    references = {
        one.reference.name: (one.reference.prefix, marker)
        for one, marker in zip(results.leading, cycle("Ds^v"), strict=False)
        if table[f"{one.reference.prefix}_attempts"].notna().any()
    }
    points: dict[str, Any] = {"color": style.current().other(2), "ls": "", "ms": 4.5}
    keys = [
        Line2D([], [], **_circle(""), marker="o", ls="", ms=7, label="subjects"),
        Line2D([], [], color="black", lw=2, label="mean, 95% interval"),
        *(Line2D([], [], **points, marker=marker, label=name)
          for name, (_, marker) in references.items()),
    ]  # fmt: skip
    if table["ideal_attempts"].notna().any():
        keys.append(style.ideal_key())
    values, headline = results.once(_attempts_of_subjects), results.headline
    columns = 3 if max(len(own) for _, _, own in shown) <= 4 else 2
    rows = in_rows(len(shown), columns, 2.6, common=len(protocols) == 1, above=0.7)
    with panels(ax, len(shown), rows) as at:
        for axes, (name, protocol, own) in zip(at.axes, shown, strict=True):
            played, means = (one[one["protocol"] == protocol] for one in (values, headline))
            known = [means[f"{of}_attempts"] + means[f"{of}_se"] for of, _ in references.values()]
            drawn = (played["attempts"], means["ideal_attempts"], *known)
            highest = np.nanmax([column.max() for column in drawn])
            names = ordered(own["condition"], results.conditions)
            axes.set(xlim=(-0.6, len(names) - 0.4), ylim=(-0.07 * highest, 1.07 * highest))
            style.name_places(axes, range(len(names)), [style.label(one, 16) for one in names])
            axes.yaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
            played = played[played["learner"] == name]
            for row in own.to_dict("records"):
                place = names.index(row["condition"])
                mine = played.loc[played["condition"] == row["condition"], "attempts"]
                _draw_circles(axes, place, mine, max(1.0, highest / _BINS), _circle(name))
                ends = [row["ci_low"], row["ci_high"]]
                axes.plot([place + 0.14] * 2, ends, color="black", lw=1.4, zorder=3)
                mean = [row["attempts"]] * 2
                axes.plot([place + 0.08, place + 0.2], mean, color="black", lw=2, zorder=3)
                for number, (of, marker) in enumerate(references.values()):
                    axes.errorbar(
                        place + 0.3 + 0.08 * number, row[f"{of}_attempts"], row[f"{of}_se"],
                        elinewidth=1, capsize=2, zorder=3, marker=marker, **points,
                    )  # fmt: skip
                style.ideal_line(axes, row["ideal_attempts"], place - 0.38, place + 0.4)
            if len(shown) > 1:
                title = protocol if table["learner"].nunique() == 1 else name
                under = f"{protocol}, " if len(protocols) > 1 and title != protocol else ""
                style.panel_title(axes, title, under + sizes(own))
        at.label_y("Attempts")
        at.legend(keys, columns=2)
    return at.returned


def _attempts_of_subjects(results: Material) -> pd.DataFrame:
    return by_subject(judged(results.trials), ["phase"])


def _circle(name: str) -> dict[str, Any]:
    colour = style.current().colors.get(name, style.current().other(3))
    return {"color": colour, "alpha": 0.75, "mec": "#1F6F9F"}


def _draw_circles(
    axes: Axes, place: float, attempts: pd.Series, width: float, look: dict[str, Any]
) -> None:
    """Draw a circle for the subjects of each interval of attempts, as large as their share."""
    heights, counts = np.unique(np.round(attempts / width) * width, return_counts=True)
    axes.scatter(
        np.full(len(heights), place - 0.16), heights, s=_WIDEST**2 * counts / len(attempts),
        color=look["color"], alpha=look["alpha"], linewidths=0.5, edgecolors=look["mec"],
        zorder=2, clip_on=False,
    )  # fmt: skip
