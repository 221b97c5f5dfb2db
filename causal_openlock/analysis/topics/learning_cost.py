"""Cost of learning: attempts until a subject solves a new room about as well as possible.

Two learners that do equally well in the end may have needed ten attempts or a million to get there.
So every attempt counts here, those of all trials of training too, up to the first new room that is
solved within some multiple of what the ideal observer needs
(:mod:`~causal_openlock.analysis.results.bounds`).

What a learner was trained with before the experiment, such as the meta-training of ``rl2``, counts
as well: a learner declares it (``Learner.prior_attempts``), and it is kept with the experiment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import median_interval
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic, drawn, of_all_conditions
from causal_openlock.errors import NothingToDrawError

WITHIN = 1.5  #: a room is solved well in at most this multiple of the ideal observer's attempts


def costs_by_learner(each: pd.DataFrame) -> pd.DataFrame:
    """How many attempts each learner needs, of subjects as :func:`subject_costs` returns them.

    >>> table = costs_by_learner(subject_costs(results, results.trials))
    >>> table[["learner", "before", "attempts", "reached"]].values.tolist()
    [['random', 0, inf, 0.0], ['oracle', 0, 2.0, 1.0]]

    Returns:
        A row for each ``learner`` and ``protocol``, of all conditions in which the attempts of the
        ideal observer are known: ``subjects`` (in all of them); ``before``, the attempts of its
        training before the experiment; the share of subjects that ``reached`` it; ``attempts``,
        the median of subjects, ``before`` included, with its 95% interval ``ci_low`` and
        ``ci_high``, inf where it is beyond what was played; and ``asked``, the most attempts that
        one of its subjects had, ``before`` included.
    """
    grouped = each.groupby(["learner", "protocol"], observed=True)
    table = grouped.agg(subjects=("cost", "size"), before=("before", "first"))
    cost = grouped["cost"]
    table["reached"] = cost.agg(lambda own: np.isfinite(own).mean())
    table["attempts"] = cost.median()  # inf: half never came so far
    ends = [median_interval(own.to_numpy(float)) for _, own in cost]
    table[["ci_low", "ci_high"]] = np.reshape(ends, (-1, 2))
    return table.assign(asked=grouped["asked"].max().astype(int)).reset_index()


def subject_costs(results: Material, trials: pd.DataFrame, within: float = WITHIN) -> pd.DataFrame:
    """Number of attempts of each subject until it first solved a new room well.

    A room is new if the subject has not met its schema with its layout; where a protocol goes
    through the same layouts over and over, only the first visits are new.

    Returns:
        Of these rows of ``results.trials``, a row for each subject of each ``learner``,
        ``condition`` and ``protocol`` in which a bound is known:
        :data:`~causal_openlock.analysis.measures.SUBJECT`; ``before``, attempts of training before
        the experiment, which the following count; ``cost``, all its attempts up to the one that
        solves that room, inf if there is none; and ``asked``, all its attempts up to the end of the
        last room that could have been.
    """
    rooms = trials[["condition", "protocol", "phase"]]
    bound = pd.Series(dict(results.bounds), dtype=float)
    rows = trials.assign(bound=bound.reindex(pd.MultiIndex.from_frame(rooms.astype(str))).array)
    rows = rows.sort_values([*CELL, *SUBJECT, *VISIT], kind="stable")
    made = rows.groupby([*CELL, *SUBJECT], observed=True, sort=False)["last_attempt"].cumsum()
    counts = rows["bound"].notna() & ~rows.duplicated([*CELL, *SUBJECT, "schema", "layout"])
    solved = counts & rows["solved"] & (rows["attempts"] <= within * rows["bound"])
    until = made - rows["last_attempt"] + rows["attempts"]
    rows = rows.assign(cost=until.where(solved, np.inf), asked=made.where(counts))
    found = rows.groupby([*CELL, *SUBJECT], observed=True, sort=True)[["cost", "asked"]]
    table = found.agg({"cost": "min", "asked": "max"}).dropna().reset_index()
    trained = table["learner"].astype(str).map(lambda name: results.trained_before.get(name, 0))
    added = table[["cost", "asked"]].add(trained.fillna(0).astype(float), axis=0)
    return table.assign(before=trained, **added)


def plot_cost(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    within: float = WITHIN,
    ax: Any = None,
) -> Any:
    """How many attempts, all training counted, until a new room is first solved well.

    Well is within ``within`` times the attempts of the ideal observer; see
    :func:`~causal_openlock.analysis.topics.learning_cost.subject_costs`. A row for each learner, a
    dot for each subject of all conditions, on a logarithmic axis; black: the median with its 95%
    interval. On the right is how many subjects never came so far, and the most attempts that one of
    them made. What a learner was trained with before the experiment, such as the meta-training of
    ``rl2``, counts.

    >>> axes = plot_cost(results, conditions=["CC4"])
    >>> [label.get_text() for label in axes.get_yticklabels()]
    ['random', 'oracle']

    The other arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    trials = rows_of(results, results.trials, learners, conditions)
    table = subject_costs(results, trials, within)
    if table.empty:
        raise NothingToDrawError(
            "no such learner played a condition of which the attempts of the ideal observer are "
            "known"
        )
    return draw_costs(table, results.learners, ax)


def draw_costs(table: pd.DataFrame, learners: Sequence[str], ax: Any = None) -> Any:
    """Draw :func:`subject_costs` of these learners, in this order, as :func:`plot_cost` does."""
    several = table.groupby("learner", observed=True)["protocol"].transform("nunique") > 1
    learner, protocol = table["learner"].astype(str), table["protocol"].astype(str)
    table = table.assign(row=learner.where(~several, learner + " (" + protocol + ")"))
    names = [name for learner in learners
             for name in ordered(table.loc[table["learner"] == learner, "row"])]  # fmt: skip
    finite = table.loc[np.isfinite(table["cost"]), "cost"]
    low, high = (finite.min() / 1.5, finite.max() * 1.5) if len(finite) else (1.0, 10.0)
    dots: Any = {"ls": "", "marker": "o", "mec": "#1F6F9F"}
    line: Any = {"color": "black", "lw": 1.6}
    mark: Any = {"marker": "|", "ms": 9, "mew": 2}
    with panels(ax, 1, in_rows(1, 1, 0.27 * len(names) + 0.75, style.WIDTH)) as at:
        (axes,) = at.axes
        axes.set(xscale="log", xlim=(low, high), xlabel="Attempts, all training counted")
        subs = (1, 2, 5) if high < 1000 * low else (1,)
        axes.xaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
        axes.xaxis.set_major_formatter("{x:,.0f}")
        axes.xaxis.set_minor_formatter(NullFormatter())
        style.name_rows(axes, names)
        axes.grid(False, axis="y")
        for place, name in enumerate(names):
            own = table[table["row"] == name]
            cost = np.sort(own["cost"].to_numpy(float))
            reached = cost[np.isfinite(cost)]
            # Subjects stand a little above and below one another, the same ones in every drawing.
            y = place + 0.22 * np.sin(2.4 * np.arange(len(reached)))
            colour = style.current().colors.get(own["learner"].iloc[0], style.current().other(3))
            axes.plot(reached, y, **dots, ms=3.5, color=colour, mew=0.4, alpha=0.8, zorder=2)
            middle, ends = np.median(cost), median_interval(cost)
            if np.isfinite(ends[0]):
                axes.plot(np.minimum(ends, high), [place] * 2, **line, zorder=3)
            if np.isfinite(middle):
                axes.plot(middle, place, **line, **mark, zorder=3)
            if missed := len(cost) - len(reached):
                asked = int(own.loc[np.isinf(own["cost"]), "asked"].max())
                axes.annotate(
                    f"{missed} of {len(cost)} not within {asked:,}", (1, place), (5, 0),
                    axes.get_yaxis_transform(), "offset points", va="center",
                )  # fmt: skip
        at.legend(
            [
                Line2D([], [], color=style.current().other(3), **dots, ms=4, label="subjects"),
                Line2D([], [], label="median, 95% interval", **line, **mark),
            ]
        )
    return at.returned


def section(material: Material) -> Section | None:
    """The cost of learning; None where the ideal observer's attempts are known of no condition."""
    each = subject_costs(material, material.trials)
    table = costs_by_learner(each)
    if table.empty:
        return None
    able = int(np.isfinite(table["attempts"]).sum())
    text = (
        "How many attempts does a learner need, all of its training counted, until it first solves "
        f"a room that is new to it within {WITHIN} times the attempts of the ideal observer? That "
        "may be luck: it does not show that the next room will be solved as well. More than half "
        f"of the subjects reach it in {able} of {len(table)} learners."
    )
    caption = (
        f"n: subjects {of_all_conditions(material.trials, each)}, pooled; reached: the share of "
        "them that solved such a room; before the experiment: attempts of training that the "
        "learner declares, such as meta-training; attempts: the median, these included."
    )
    title = "Attempts until a new room is solved well"
    costs = Table("learning_cost", title, shown(table), {"reached": ".0%"}, caption)
    plot = drawn(
        "cost_of_learning", plot_cost, material, title,
        "A dot is a subject; the axis is logarithmic; black: the median with its 95% interval. On "
        "the right: subjects that never did, and the most attempts that one of them had.",
    )  # fmt: skip
    return Section("learning_cost", "The cost of learning", (text,), (costs,), (plot,))


def shown(table: pd.DataFrame) -> pd.DataFrame:
    """Costs as texts: what is beyond the attempts that were made is "not within" them."""
    median, interval = [], []
    for row in table.itertuples():
        known = np.isfinite(row.attempts)
        median.append(_printed(row.attempts) if known else f"not within {row.asked:,}")
        ends = [
            _printed(end) if np.isfinite(end) else "beyond" for end in (row.ci_low, row.ci_high)
        ]
        interval.append(" to ".join(ends) if known and not np.isnan(row.ci_low) else "")
    frame = table[["learner", "protocol", "subjects", "reached"]].rename(columns={"subjects": "n"})
    frame["before the experiment"] = [
        "unknown" if np.isnan(before) else _printed(before) if before else "none"
        for before in table["before"]
    ]
    frame = frame.assign(**{"attempts, median": median, "95% interval": interval})
    return frame.drop(columns="protocol") if frame["protocol"].nunique() == 1 else frame


def _printed(attempts: float) -> str:
    """Attempts; of a median between two whole numbers with its half."""
    return f"{attempts:,.1f}".removesuffix(".0")


TOPIC = Topic("learning_cost", 30, section)
