"""How well learners predict over trials: a line for each, in bits per action."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import in_rows, panels
from causal_openlock.analysis.plots.survival import MOST_BANDS
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.scoring.scores import Scores
from causal_openlock.wording import nearest


def plot_scores(
    scores: Scores,
    *,
    of: str | None = None,
    learners: Sequence[str] | None = None,
    ax: Any = None,
) -> Any:
    """Draw how many bits per action learners need in each trial to say what subjects did.

    The fewer, the better. A panel for each condition, a line for each learner that predicts, the
    one that predicts best first; with at most four a band is the 95% bootstrap interval over
    subjects. A trial in which somebody did what a learner takes for impossible has no point.

    Args:
        scores: The scores.
        of: Label of the learner whose subjects are predicted; by default the first.
        learners: Labels of those that predict; by default all.
        ax: As for :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.

    Raises:
        NothingToDrawError: If there are no scores.
        OpenLockError: If one is not in the scores.
    """
    actions = scores.actions
    if actions.empty:
        raise NothingToDrawError("nobody is scored")
    whose = str(actions["learner"].iloc[0]) if of is None else of
    for column, asked in (("learner", [whose]), ("scored", learners or ())):
        known = [str(name) for name in actions[column].unique()]
        for name in asked:
            if name not in known:
                raise OpenLockError(f"{name} is not in these scores; {nearest(name, known)}")
    own = scores.of(whose)
    names = [str(name) for name in own.ranking["scored"] if learners is None or name in learners]
    table = own.over("condition", "trial")
    table = table[table["scored"].isin(names)].replace(np.inf, np.nan)
    top = 1.04 * float(table[["bits", "ci_high"]].max(axis=None))
    conditions = ordered(actions.loc[actions["learner"] == whose, "condition"].unique())
    looks = {name: style.current().line(number) for number, name in enumerate(names)}
    with panels(ax, len(conditions), in_rows(len(conditions), 3, 2.2)) as at:
        for axes, condition in zip(at.axes, conditions, strict=True):
            here = table[table["condition"] == condition]
            for name in names:
                rows = here[here["scored"] == name]
                look = looks[name]
                axes.plot(rows["trial"], rows["bits"], marker="o", ms=3, label=name, **look)
                if len(names) <= MOST_BANDS:
                    ends = rows["ci_low"], rows["ci_high"]
                    axes.fill_between(rows["trial"], *ends, color=look["color"], alpha=0.15, lw=0)
            style.panel_title(axes, condition, style.sizes(here))
            axes.set(xlabel="Trial", ylim=(0, top))
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        at.label_y("Bits per action")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name]) for name in names]
        at.legend(keys, columns=min(len(names), 4))
    return at.returned
