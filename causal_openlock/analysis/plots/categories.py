"""The paper's Figures 6 and 7: outcomes of attempts, in the baselines and in the transfer test.

Each segment's *height* is log10 of its count, and segments are stacked: the form that the paper
chose. So a stack is a sum of logarithms; it shrinks as one category takes over. The paper's own
DDQN is the first panel, from its published counts, with any other reference that has counts; then
come the learners under protocols with many attempts in a trial, that is, all but ``human``.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import sizes
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.wording import nearest

KINDS = {"baseline": (BASELINES, "train"), "transfer": (TRANSFERS, "test")}
_NAMES = ("else", "unlock", "open 1", "open 2", "open 3")
_OUTLINES = {"CE4": ":", "CC4": "-"}  # left to right, as in the paper's Figure 6


def counts_like_ddqn(
    results: Material, kind: str, learners: Names = None, conditions: Names = None
) -> pd.DataFrame:
    """The counted ``blocks`` that can be compared with those of the paper's DDQN; perhaps none.

    Raises:
        OpenLockError: If there is no such kind, or a learner or a condition is not in the results.
    """
    if str(kind) not in KINDS:
        raise OpenLockError(f"no categories of kind {kind}; {nearest(str(kind), KINDS)}")
    names, phase = KINDS[kind]
    alike = {one.name for one in results.experiment.conditions if one.is_of_paper} & {*names}
    counts = rows_of(results, results.blocks, learners, conditions)
    return counts[
        (counts["protocol"] != HUMAN_PROTOCOL)
        & counts["condition"].isin(alike)
        & (counts["phase"] == phase)
    ]


def plot_categories(
    results: Material,
    kind: Literal["baseline", "transfer"] = "baseline",
    *,
    learners: Names = None,
    conditions: Names = None,
    published: bool = True,
    ax: Any = None,
) -> Any:
    """Draw the outcomes of attempts: the paper's Figure 6 (``baseline``) or 7 (``transfer``).

    >>> axes = plot_categories(trained, "transfer", published=False)
    >>> axes.get_title(loc="left")
    'random'

    A learner has a panel for each protocol other than ``human``. Arguments, what is returned and
    errors are those of :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`;
    ``published`` is about references.
    """
    counts = counts_like_ddqn(results, kind, learners, conditions)
    if counts.empty:
        raise NothingToDrawError(
            f"no such learner played a {kind} condition of the paper under a protocol with many "
            "attempts in a trial, such as rl"
        )
    names, phase = KINDS[kind]
    shown = []
    for one in results.references if published else ():
        known = one.categories
        if known is not None and one.stands(counts).any():
            rows = known[(known["phase"] == phase) & known["condition"].isin(names)]
            shown.append((one.title, one.detail, rows))
    played = ordered(counts["learner"], results.learners)
    for name in played:
        for protocol, rows in counts[counts["learner"] == name].groupby("protocol", observed=True):
            shown.append((name, f"{protocol}, {sizes(rows)}", rows))
    looks = zip(_NAMES, style.current().categories, strict=True)
    keys = [Patch(fc=colour, ec="black", lw=0.6, label=text) for text, colour in looks]
    if kind == "baseline":
        keys += [
            Patch(fc="white", ec="black", lw=1.1, ls=line, label=f"{name} ({side})")
            for (name, line), side in zip(_OUTLINES.items(), ("left", "right"), strict=True)
        ]
    with panels(ax, len(shown), in_rows(len(shown), 2, 2.7)) as at:
        for axes, (name, detail, rows) in zip(at.axes, shown, strict=True):
            if kind == "baseline":
                _draw_blocks(axes, rows)
                axes.set_xlabel("Attempts of each subject" if name in played else "Attempts")
            else:
                _draw_tests(axes, rows)
            style.panel_title(axes, name, detail)
        at.label_y(r"$\log_{10}$ of attempts, stacked")
        at.legend(keys)
    return at.returned


def _draw_blocks(axes: Axes, rows: pd.DataFrame) -> None:
    for side, (condition, outline) in enumerate(_OUTLINES.items()):
        for block, part in rows[rows["condition"] == condition].groupby("block"):
            _stack(axes, block - 1 + 0.4 * side - 0.2, part, 0.38, outline)
    names = _ranges(rows.groupby("block")["until"].max().to_numpy())
    axes.set_xticks(range(len(names)), names, fontsize="small")
    axes.set_xlim(-0.6, len(names) - 0.4)


def _draw_tests(axes: Axes, rows: pd.DataFrame) -> None:
    for place, condition in enumerate(TRANSFERS):
        _stack(axes, place, rows[rows["condition"] == condition], 0.6)
    axes.set_xticks(range(len(TRANSFERS)), TRANSFERS)
    axes.set(xlim=(-0.6, len(TRANSFERS) - 0.4), xlabel="Training and test")


def _stack(axes: Axes, x: float, rows: pd.DataFrame, width: float, outline: str = "-") -> None:
    counts = rows.groupby("category", observed=True)["count"].sum()
    heights = np.log10([max(1, counts.get(name, 1)) for name in CATEGORIES])
    bottoms = np.cumsum(heights) - heights
    for height, bottom, colour in zip(heights, bottoms, style.current().categories, strict=True):
        if height:
            axes.bar(x, height, width, bottom, color=colour, ec="black", lw=1.0, ls=outline)


def _ranges(until: Sequence[float]) -> list[str]:
    """Names of blocks: ``0–0.6k``, ``0.6–1.2k``, ... as the paper's ``0–30k``; few in full."""
    thousands = until[-1] >= 1000
    ends = [f"{round(value / 1000, 2):g}" if thousands else f"{value:.0f}" for value in (0, *until)]
    return [f"{low}–{high}{'k' if thousands else ''}" for low, high in pairwise(ends)]
