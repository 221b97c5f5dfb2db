"""A parameter as an axis: how many attempts learners need at each of its values.

Learners that differ in the parameter alone are one *series*, as those of a sweep are
(:mod:`causal_openlock.experiment.declare`); one that has the default is also a point of the series.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of, trials_under
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import sizes
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.wording import joined, nearest

LOGARITHMIC = 100  #: positive values that span this factor are on a logarithmic axis
MOST_NAMED = 6  #: more numbers than these are not each named at the axis


def sweep_table(results: Material, parameter: str | None = None) -> pd.DataFrame:
    """The result of each learner in each condition, by the value of a parameter.

    >>> from causal_openlock import compare, sweep
    >>> halves = sweep("theory_based", top_down=[False, True])
    >>> results = compare("CC3", halves, subjects=2, workers=0)
    >>> sweep_table(results)[["parameter", "value", "series"]].values.tolist()
    [['top_down', False, 'theory_based'], ['top_down', True, 'theory_based']]

    The parameter is by default the only one in which learners of the same kind differ.

    Returns:
        The rows of ``results.headline`` of learners that have it, in the order of its values, after
        the columns ``parameter``, ``value``, and ``series``: the learner, with whatever else
        differs between learners of its kind.

    Raises:
        NothingToDrawError: If no parameter is named, and none differs or several do.
        OpenLockError: If no learner has it; the message has the nearest name.
    """
    specs = results.experiment.learners
    settings = {spec.name: {**spec.parameters, "reward": spec.reward.name} for spec in specs}
    differ: dict[str, list[str]] = {}
    for spec in specs:
        alike = [settings[other.name] for other in specs if other.learner == spec.learner]
        own = settings[spec.name]
        differ[spec.name] = [key for key in own if any(one.get(key) != own[key] for one in alike)]
    if parameter is None:
        swept = sorted({key for keys in differ.values() for key in keys} - {"reward"})
        if len(swept) != 1:
            found = f"{joined(swept)} differ" if swept else "no parameter differs"
            raise NothingToDrawError(
                f"{found} between learners of the same kind; name one, as in plot.sweep('lapse')"
            )
        (parameter,) = swept
    having = [spec for spec in specs if parameter in spec.parameters]
    if not having:
        known = {key for spec in specs for key in spec.parameters}
        raise OpenLockError(
            f"no learner of these results has a parameter {parameter}; "
            f"{nearest(str(parameter), known)}"
        )
    values = [spec.parameters[parameter] for spec in having]
    order = sorted(values) if _are_numbers(values) else values
    rows = []
    for spec, value in zip(having, values, strict=True):
        own = settings[spec.name]
        others = [f"{key} {own[key]}" for key in differ[spec.name] if key != parameter]
        series = ", ".join([spec.learner.rpartition(":")[2], *others])
        rows.append((spec.name, parameter, series, order.index(value)))
    about = pd.DataFrame(rows, columns=["learner", "parameter", "series", "place"])
    about["value"] = pd.Series(values, dtype=object)  # 1 and None stay what they are
    headline = results.headline
    table = headline.merge(about.astype({"learner": headline["learner"].dtype}), on="learner")
    table = table.sort_values(["condition", "protocol", "series", "place"], ignore_index=True)
    return table[["parameter", "value", "series", *headline.columns]]


def _are_numbers(values: list[Any]) -> bool:
    return all(isinstance(one, int | float) and not isinstance(one, bool) for one in values)


def plot_sweep(
    results: Material,
    parameter: str | None = None,
    *,
    learners: Names = None,
    conditions: Names = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Any:
    """Attempts in the trials that a condition is judged by, by the value of a parameter.

    A panel for each condition, a line for each series of learners that differ in the parameter
    alone, with 95% intervals. A mean that unsolved trials are in is a lower bound, and
    its marker is empty. The numbers are those of :func:`sweep_table`.

    >>> from causal_openlock import compare, sweep
    >>> halves = sweep("theory_based", top_down=[False, True])
    >>> results = compare("CC3", halves, subjects=2, workers=0)
    >>> axes = plot_sweep(results, "top_down")
    >>> axes.get_xlabel(), [label.get_text() for label in axes.get_xticklabels()]
    ('top_down', ['False', 'True'])

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    protocol, _ = trials_under(results, protocol, learners, conditions)
    table = rows_of(results, sweep_table(results, parameter), learners, conditions)
    table = table[table["protocol"] == protocol]
    if table.empty:
        raise NothingToDrawError(
            f"no such learner has the parameter {parameter} under the protocol {protocol}"
        )
    numbers = sorted({*table["value"]}) if _are_numbers(list(table["value"])) else []
    words = list(dict.fromkeys(map(str, table["value"])))
    table["x"] = [value if numbers else words.index(str(value)) for value in table["value"]]
    looks: dict[str, dict[str, Any]] = {
        name: {**style.current().line(number, name), "marker": "os^D"[number % 4], "ms": 5}
        for number, name in enumerate(dict.fromkeys(table["series"]))
    }
    keys = [Line2D([], [], label=style.label(name, 30), **look) for name, look in looks.items()]
    if (table["share_solved"] < 1).any():
        look: dict[str, Any] = {"ls": "", "marker": "o", "mfc": "white", "color": "#666666"}
        keys.append(Line2D([], [], label="lower bound: not all solved", **look))
    if table["ideal_attempts"].notna().any():
        keys.append(style.ideal_key())
    shown = ordered(table["condition"].unique(), results.conditions)
    wide = in_rows(len(shown), 3, 2.2, style.WIDTH)  # of a single panel too: the legend needs it
    with panels(ax, len(shown), wide) as at:
        for axes, condition in zip(at.axes, shown, strict=True):
            here = table[table["condition"] == condition]
            for name, rows in here.groupby("series", sort=False):
                look, mean = looks[str(name)], rows["attempts"]
                ends = np.nan_to_num([mean - rows["ci_low"], rows["ci_high"] - mean])
                axes.errorbar(rows["x"], mean, ends.clip(min=0), elinewidth=1, capsize=2, **look)
                least = rows[rows["share_solved"] < 1]
                empty = {**look, "ls": "", "mfc": "white"}
                axes.plot(least["x"], least["attempts"], **empty, zorder=3)
            if numbers and numbers[0] > 0 and numbers[-1] >= LOGARITHMIC * numbers[0]:
                axes.set_xscale("log")
            if not numbers:
                axes.set_xlim(-0.4, len(words) - 0.6)
                style.name_places(axes, range(len(words)), [style.label(one, 24) for one in words])
            elif len(numbers) <= MOST_NAMED:
                axes.set_xticks(numbers, [f"{one:g}" for one in numbers])
                axes.minorticks_off()
            for attempts in here["ideal_attempts"].dropna().unique():
                style.ideal_line(axes, attempts, *axes.get_xlim())
            style.panel_title(axes, condition, sizes(here))
            axes.set(xlabel=str(table["parameter"].iloc[0]))
            axes.set_ylim(0, 1.05 * float(table[["attempts", "ci_high"]].max(axis=None)))
        at.label_y("Attempts")
        at.legend(keys, columns=min(len(keys), 3))
    return at.returned
