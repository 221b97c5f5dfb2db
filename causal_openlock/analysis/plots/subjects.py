"""How the subjects of one learner vary: a circle is as large as their share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Plot

_BINS = 30  # heights that circles can have
_AREA = 420.0  # of a circle that is all subjects, in square points
_CIRCLE: Any = {"color": "#56B4E9", "alpha": 0.75}
_RING, _PEOPLE = "#1F6F9F", "#D55E00"


def draw_subjects(values: pd.DataFrame, own: pd.DataFrame, limits: Mapping[str, float]) -> Plot:
    """Attempts of each subject of a learner in the trials that conditions are judged by.

    Args:
        values: ``protocol``, ``condition`` and ``attempts`` of its subjects.
        own: Its rows of the headline.
        limits: By protocol, the most attempts that a trial had: every learner has the same scale,
            so that pages can be laid side by side.
    """
    protocols = ordered(values["protocol"], ("human",))
    people = bool(own["human_attempts"].notna().any())
    ideal = bool(own["ideal_attempts"].notna().any())
    with style.settings():
        figure, panels = style.panels(len(protocols), columns=1, height=2.6)
        for axes, protocol in zip(panels, protocols, strict=True):
            rows = own[own["protocol"] == protocol]
            played = values[values["protocol"] == protocol]
            highest = (rows["human_attempts"] + rows["human_se"]).max()
            limit = float(np.nanmax([limits[protocol], highest]))
            for place, row in enumerate(rows.to_dict("records")):
                chosen = played.loc[played["condition"] == row["condition"], "attempts"]
                _circles(axes, place, chosen.to_numpy(float), limit)
                _means(axes, place, row)
            if len(protocols) > 1:
                style.panel_title(axes, protocol, style.sizes(rows))
            _scale(axes, list(rows["condition"]), limit)
        keys = [
            Line2D([], [], **_CIRCLE, marker="o", ls="", ms=7, mec=_RING, label="subjects"),
            Line2D([], [], color="black", lw=2, label="mean, 95% interval"),
        ]
        if people:
            keys.append(Line2D([], [], color=_PEOPLE, marker="D", ls="", ms=4.5, label="people"))
        style.legend(figure, [*keys, style.ideal_key()] if ideal else keys, columns=2)
        figure.set_figheight(figure.get_figheight() + 0.2)
    size = f"protocol {protocols[0]}, {style.sizes(own)}" if len(protocols) == 1 else ""
    return Plot("learner", figure, facts={"size": size, "people": people, "ideal": ideal})


def _circles(axes: Axes, place: float, attempts: Any, limit: float) -> None:
    width = max(1.0, limit / _BINS)
    heights, counts = np.unique(np.round(attempts / width) * width, return_counts=True)
    axes.scatter(
        np.full(len(heights), place - 0.12), heights, s=_AREA * counts / len(attempts), **_CIRCLE,
        linewidths=0.5, edgecolors=_RING, zorder=2, clip_on=False,
    )  # fmt: skip


def _means(axes: Axes, place: float, row: Mapping[Any, Any]) -> None:
    """The mean with its interval; people's beside it, and the ideal observer's across."""
    mean, low, high = (row[name] for name in ("attempts", "ci_low", "ci_high"))
    axes.plot([place + 0.14] * 2, [low, high], color="black", lw=1.4, zorder=3)
    axes.plot([place + 0.08, place + 0.2], [mean] * 2, color="black", lw=2, zorder=3)
    if row["human_attempts"] == row["human_attempts"]:
        axes.errorbar(
            place + 0.3, row["human_attempts"], row["human_se"],
            fmt="D", ms=4.5, color=_PEOPLE, elinewidth=1, capsize=2, zorder=3,
        )  # fmt: skip
    if row["ideal_attempts"] == row["ideal_attempts"]:
        style.ideal_line(axes, row["ideal_attempts"], place - 0.38, place + 0.4)


def _scale(axes: Axes, conditions: Sequence[str], limit: float) -> None:
    axes.set_xticks(range(len(conditions)), [style.label(name, 16) for name in conditions])
    axes.set_xlim(-0.6, len(conditions) - 0.4)
    axes.set_ylim(0, 1.03 * limit)
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
    axes.set_ylabel("Attempts")
