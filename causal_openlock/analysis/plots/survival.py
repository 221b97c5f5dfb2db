"""Which share of trials is not solved yet after so many attempts."""

from __future__ import annotations

from typing import Any

from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, trials_under
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.survival import unsolved_after

MOST_BANDS = 4
"""With more learners than this their bands would cover each other, and are not drawn."""


def plot_survival(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
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

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    table = unsolved_after(trials_under(results, protocol, learners, conditions)[1])
    names = ordered(table["learner"].unique(), results.learners)
    # The first lines are broad and the next ones narrow: where they coincide, both are still seen.
    looks = {
        name: {**style.current().line(number), "lw": max(1.2, 3.2 - 0.5 * number)}
        for number, name in enumerate(names)
    }
    shown = ordered(table["condition"].unique(), results.conditions)
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
