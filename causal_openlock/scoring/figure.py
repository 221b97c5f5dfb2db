"""Figure of learners' scores over trials, in bits per action: means, and a line a subject."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import in_rows, panels
from causal_openlock.analysis.statistics import sizes
from causal_openlock.scoring.recorded import GROUP

_NOTHING: Any = {"color": "#666666", "lw": 1.0, "ls": (0, (1, 1.5))}


def draw_scores(
    table: pd.DataFrame,
    each: pd.DataFrame,
    names: Sequence[str],
    choices: Mapping[str, int],
    ax: Any = None,
) -> Any:
    """Draw a panel for each condition, as :meth:`~causal_openlock.scoring.scores.Scores.plot`.

    Behind the means of ``table`` are the subjects in ``each``; ``names`` are the learners in the
    order of the legend. What a learner that knows nothing needs is drawn where the number of
    ``choices`` in a condition is known.
    """
    table, each = (one[one["scored"].isin(names)].replace(np.inf, np.nan) for one in (table, each))
    levels = {name: float(np.log2(count)) for name, count in choices.items()}
    levels = {name: levels[name] for name in table["condition"].unique() if name in levels}
    drawn = table[["bits", "ci_high"]].max(axis=None), each["bits"].max(), *levels.values()
    top = 1.04 * float(np.nanmax(drawn))
    conditions = ordered(table["condition"].unique())
    looks = {name: style.current().line(number, name) for number, name in enumerate(names)}
    with panels(ax, len(conditions), in_rows(len(conditions), 3, 2.2)) as at:
        for axes, condition in zip(at.axes, conditions, strict=True):
            here = table[table["condition"] == condition]
            if condition in levels:
                axes.axhline(levels[condition], label="knows nothing", zorder=1.5, **_NOTHING)
            for name in names:
                rows, look = here[here["scored"] == name], looks[name]
                own = each[(each["condition"] == condition) & (each["scored"] == name)]
                by_trial = own.set_index([*GROUP, "subject", "trial"])["bits"].unstack()
                lines = [np.column_stack([by_trial.columns, bits]) for bits in by_trial.to_numpy()]
                axes.add_collection(
                    LineCollection(lines, colors=look["color"], lw=0.6, alpha=0.3, zorder=1)
                )
                axes.plot(rows["trial"], rows["bits"], marker="o", ms=3, label=name, **look)
                if len(names) <= style.MOST_BANDS:
                    ends = rows["ci_low"], rows["ci_high"]
                    axes.fill_between(rows["trial"], *ends, color=look["color"], alpha=0.15, lw=0)
            style.panel_title(axes, condition, sizes(here))
            axes.set(xlabel="Trial", ylim=(0, top))
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        at.label_y("Bits per action")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name]) for name in names]
        if levels:
            shown = {f"{level:.2f}" for level in levels.values()}
            label = f"knows nothing ({' or '.join(sorted(shown))})"
            keys.append(Line2D([], [], label=label, **_NOTHING))
        at.legend(keys, columns=min(len(keys), 4))
    return at.returned
