"""Which share of trials is not solved yet after so many attempts."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import chosen, in_rows, panels, protocol_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.survival import unsolved_after
from causal_openlock.errors import NothingToDrawError

MOST_BANDS = 4
"""With more learners than this their bands would cover each other, and are not drawn."""


def plot_survival(
    results: Material,
    *,
    learners: Collection[str] | None = None,
    conditions: Collection[str] | None = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Any:
    """The share of trials that are not solved yet after so many attempts (Kaplan-Meier).

    They are the trials that a condition is judged by: its test, or the last trial of a baseline. A
    trial that was not solved is censored at its limit: a line that does not reach 0 is the share
    that never was. A panel for each condition, a line for each learner; with at most four learners
    a band is the 95% bootstrap interval over subjects.

    >>> import causal_openlock as ol
    >>> axes = ol.plot_survival(results, conditions=["CC4"])
    >>> [line.get_label() for line in axes.lines]
    ['random', 'oracle']

    Args:
        results: What was played.
        learners: Labels of the learners to draw; by default all.
        conditions: Conditions to draw; by default all.
        protocol: By default ``human``, or else the first one by alphabet.
        ax: Axes, as many as there are panels, or an empty figure; by default a new figure of
            pyplot.

    Returns:
        ``[P]`` the axes of the panels; of a single panel its axes.

    Raises:
        NothingToDrawError: If none of the learners played one of the conditions under it.
        OpenLockError: If a learner, a condition or the protocol is not in the results, or ``ax``
            does not fit.
    """
    asked, trials = chosen(results, learners, conditions), results.trials
    protocol = protocol_of(results, protocol)
    trials = trials[trials["protocol"] == protocol]
    for column, kept in asked.items():
        trials = trials[trials[column].isin(kept)]
    if trials.empty:
        raise NothingToDrawError(
            f"no such learner played such a condition under the protocol {protocol}"
        )
    table = unsolved_after(trials)
    names = ordered(table["learner"].unique(), results.learners)
    # The first lines are broad and the next ones narrow: where they coincide, both are still seen.
    looks = {
        name: {**style.current().line(number), "lw": max(1.2, 3.2 - 0.5 * number)}
        for number, name in enumerate(names)
    }
    shown = ordered(table["condition"].unique())
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.2)) as at:
        for axes, condition in zip(at.axes, shown, strict=True):
            here = table[table["condition"] == condition]
            for name in names:
                own = here[here["learner"] == name]
                if own.empty:
                    continue
                x, line = own["attempts"], looks[name]
                axes.step(x, own["unsolved"], where="post", label=name, **line)
                if len(names) <= MOST_BANDS:
                    axes.fill_between(
                        x, own["ci_low"], own["ci_high"], step="post", color=line["color"],
                        alpha=0.15, lw=0,
                    )  # fmt: skip
            style.panel_title(axes, condition, style.sizes(here))
            axes.set(xlim=(0, float(table["attempts"].max())), ylim=(0, 1.02), xlabel="Attempts")
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True, steps=[1, 2, 5, 10]))
            axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        at.label_y("Trials not solved yet")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name])
                for name in names]  # fmt: skip
        at.legend(keys, columns=min(len(names), 4))
    return at.returned
