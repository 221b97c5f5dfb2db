"""The figure of a design: two confusion matrices, and attribution by the number of subjects."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter

from causal_openlock.analysis.plots import style
from causal_openlock.design.telling import confusion


def draw_confusion(sizes: pd.DataFrame) -> Figure:
    """Draw who is attributed to whom, by :func:`~causal_openlock.design.telling.by_size`."""
    with style.settings():
        figure = Figure(figsize=(3 * 4.2, 4.6), layout="constrained")
        single, groups, by_size = figure.subplots(1, 3)
        _matrix(single, confusion(sizes), "single subjects")
        largest = sizes["subjects"].max()
        _matrix(groups, confusion(sizes, of_groups=True), f"groups of {largest}")
        _by_size(by_size, sizes)
        return figure


def _matrix(axes: Axes, table: pd.DataFrame, title: str) -> None:
    axes.imshow(table.to_numpy(float), cmap="Blues", vmin=0, vmax=1)
    names = [style.label(str(name), 20) for name in table.columns]
    axes.set_xticks(range(len(names)), names, rotation=45, ha="right", fontsize="small")
    axes.set_yticks(range(len(names)), names, fontsize="small")
    for (row, column), share in np.ndenumerate(table.to_numpy(float)):
        if share >= 0.005:
            axes.text(column, row, f"{share:.2f}".lstrip("0"), ha="center", va="center",
                      color="white" if share > 0.6 else "black", fontsize="x-small")  # fmt: skip
    axes.set(title=title, xlabel="attributed to", ylabel="made by")
    axes.grid(visible=False)


def _by_size(axes: Axes, sizes: pd.DataFrame) -> None:
    numbers, lowest = sorted(sizes["subjects"].unique().tolist()), 0.9
    for name in sizes.columns[3:]:
        right = sizes[sizes["learner"] == name].groupby("subjects")[name].mean()
        lowest = min(lowest, float(right.min()))
        axes.plot(right.index, right, marker="o", markersize=3, label=style.label(str(name), 20))
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(FixedLocator(numbers))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xticklabels([str(size) for size in numbers])
    axes.set(title="groups of any size", xlabel="subjects in a group")
    axes.set(ylabel="share attributed right", ylim=(lowest - 0.03, 1.01))
    axes.legend(fontsize="x-small")
