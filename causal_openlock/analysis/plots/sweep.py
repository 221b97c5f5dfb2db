"""A parameter as an axis: how many attempts learners need at each of its values.

Learners that differ in the parameter alone are one *series*, as those of a sweep are
(:mod:`causal_openlock.experiment.declare`); one that has the default is also a point of the series.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import (
    Names,
    in_rows,
    panels,
    rows_of,
    trials_under,
)
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.wording import joined, nearest

LOGARITHMIC = 100
"""Positive values are on a logarithmic axis if the highest is this many times the lowest."""


def sweep_table(results: Material, parameter: str | None = None) -> pd.DataFrame:
    """The result of each learner in each condition, by the value of a parameter.

    >>> from causal_openlock import compare, sweep
    >>> halves = sweep("theory_based", top_down=[False, True])
    >>> results = compare("CC3", halves, subjects=2, workers=0)
    >>> sweep_table(results)[["parameter", "value", "series"]].values.tolist()
    [['top_down', False, 'theory_based'], ['top_down', True, 'theory_based']]

    Args:
        results: What was played.
        parameter: Name of a hyper-parameter; by default the only one in which learners of the same
            kind differ.

    Returns:
        The rows of ``results.headline`` of learners that have it, in the order of its values, after
        the columns ``parameter``, ``value``, and ``series``: the learner, with whatever else
        differs between learners of its kind.

    Raises:
        NothingToDrawError: If no parameter is named, and none differs or several do.
        OpenLockError: If no learner has it; the message has the nearest name.
    """
    specs = {spec.name: spec for spec in results.experiment.learners}
    given = {name: {**spec.parameters, "reward": spec.reward.name} for name, spec in specs.items()}
    differ: dict[str, list[str]] = {}
    for name, spec in specs.items():
        alike = [given[other] for other, one in specs.items() if one.learner == spec.learner]
        own = given[name]
        differ[name] = [key for key in own if any(one.get(key) != own[key] for one in alike)]
    if parameter is None:
        swept = sorted({key for keys in differ.values() for key in keys if key != "reward"})
        if len(swept) != 1:
            found = f"{joined(swept)} differ" if swept else "no parameter differs"
            raise NothingToDrawError(
                f"{found} between learners of the same kind; name one, as in plot.sweep('lapse')"
            )
        (parameter,) = swept
    parameter = str(parameter)
    values = {
        name: spec.parameters[parameter]
        for name, spec in specs.items()
        if parameter in spec.parameters
    }
    if not values:
        known = {key for spec in specs.values() for key in spec.parameters}
        raise OpenLockError(
            f"no learner of these results has a parameter {parameter}; {nearest(parameter, known)}"
        )
    series = {
        name: _series(specs[name].learner, given[name], [k for k in differ[name] if k != parameter])
        for name in values
    }
    order = list(values.values())
    if _are_numbers(order):
        order.sort()
    rows = results.headline[results.headline["learner"].isin(list(values))]
    names = rows["learner"].astype(str)
    table = pd.DataFrame(
        {
            "parameter": parameter,
            "value": pd.Series([values[name] for name in names], rows.index, object),
            "series": names.map(series),
        }
    )
    table = pd.concat([table, rows], axis=1)
    place = [order.index(value) for value in table["value"]]
    by = ["condition", "protocol", "series", "place"]
    return table.assign(place=place).sort_values(by, ignore_index=True).drop(columns="place")


def _series(learner: str, given: Mapping[str, Any], keys: list[str]) -> str:
    return ", ".join([learner.rpartition(":")[2], *(f"{key} {given[key]}" for key in keys)])


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
    alone, with 95% bootstrap intervals. A mean that unsolved trials are in is a lower bound, and
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
    places = table["value"].astype(float) if numbers else table["value"].map(str).map(words.index)
    table = table.assign(x=places)
    looks: dict[str, dict[str, Any]] = {
        name: {**style.current().line(number), "marker": "os^D"[number % 4], "ms": 5}
        for number, name in enumerate(dict.fromkeys(table["series"]))
    }
    shown = ordered(table["condition"].unique(), results.conditions)
    keys: list[Any] = [
        Line2D([], [], label=style.label(name, 30), **look) for name, look in looks.items()
    ]
    if (table["share_solved"] < 1).any():
        look: dict[str, Any] = {"ls": "", "marker": "o", "mfc": "white", "color": "#666666"}
        keys.append(Line2D([], [], label="lower bound: not all solved", **look))
    if table["ideal_attempts"].notna().any():
        keys.append(style.ideal_key())
    width = style.WIDTH / (0.62 if len(shown) == 1 else 1)  # the legend needs all of it
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.2, width)) as at:
        for axes, condition in zip(at.axes, shown, strict=True):
            here = table[table["condition"] == condition]
            for name, rows in here.groupby("series", sort=False):
                look, mean = looks[str(name)], rows["attempts"]
                ends = np.nan_to_num([mean - rows["ci_low"], rows["ci_high"] - mean])
                axes.errorbar(rows["x"], mean, ends.clip(min=0), elinewidth=1, capsize=2, **look)
                least = rows[rows["share_solved"] < 1]
                axes.plot(
                    least["x"], least["attempts"], **{**look, "ls": ""}, mfc="white", zorder=3
                )
            if numbers and numbers[0] > 0 and numbers[-1] >= LOGARITHMIC * numbers[0]:
                axes.set_xscale("log")
            if not numbers:
                axes.set_xlim(-0.4, len(words) - 0.6)
            places = numbers or range(len(words))
            texts = [f"{one:g}" for one in numbers] or [style.label(one, 24) for one in words]
            crowded = style.crowded(axes, places, texts)
            if not (numbers and crowded):
                axes.set_xticks(places, texts, **(style.SLANTED if crowded else {}))
                axes.minorticks_off()
            for attempts in here["ideal_attempts"].dropna().unique():
                style.ideal_line(axes, attempts, *axes.get_xlim())
            style.panel_title(axes, condition, style.sizes(here))
            axes.set(xlabel=str(table["parameter"].iloc[0]))
            axes.set_ylim(0, 1.05 * float(table[["attempts", "ci_high"]].max(axis=None)))
        at.label_y("Attempts")
        at.legend(keys, columns=min(len(keys), 3))
    return at.returned
