"""The figure of a recovery: two confusion matrices, and recovery by the number of subjects."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from causal_openlock.analysis.plots import style
from causal_openlock.fitting.recovery import Recovery


def draw_recovery(found: Recovery) -> Figure:
    """Draw it; rows made the subjects, columns are what these are attributed to."""
    with style.settings():
        figure = Figure(figsize=(3 * 4.2, 4.6), layout="constrained")
        one, many, sizes = figure.subplots(1, 3)
        _matrix(one, found.single, "single subjects")
        _matrix(many, found.groups, f"groups of {found.subjects}")
        _by_size(sizes, found)
        return figure


def _matrix(axes: Axes, table: pd.DataFrame, title: str) -> None:
    axes.imshow(table.to_numpy(float), cmap="Blues", vmin=0, vmax=1)
    names = [style.label(str(name), 20) for name in table.columns]
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", fontsize="small")
    axes.set_yticks(range(len(names)), names, fontsize="small")
    for row, values in enumerate(table.to_numpy(float)):
        for column, share in enumerate(values):
            if share >= 0.005:
                colour = "white" if share > 0.6 else "black"
                axes.text(column, row, f"{share:.2f}".lstrip("0"), ha="center", va="center",
                          color=colour, fontsize="x-small")  # fmt: skip
    axes.set_title(title)
    axes.set_xlabel("attributed to")
    axes.set_ylabel("made by")
    axes.grid(visible=False)


def _by_size(axes: Axes, found: Recovery) -> None:
    whole = found.by_size[found.by_size["trials"] == found.by_size["trials"].max()]
    lowest = 0.9
    for name, own in whole.groupby("learner", sort=False):
        right = own.groupby("subjects")["right"].mean()
        lowest = min(lowest, float(right.min()))
        axes.plot(right.index, right, marker="o", markersize=3, label=style.label(str(name), 20))
    known = sorted(whole["subjects"].unique().tolist())
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(known))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xticklabels([str(size) for size in known])
    axes.set_ylim(lowest - 0.03, 1.01)
    axes.set_title("groups of any size")
    axes.set_xlabel("subjects in a group")
    axes.set_ylabel("share attributed right")
    axes.legend(fontsize="x-small")
