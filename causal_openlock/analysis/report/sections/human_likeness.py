"""The section of the report that says how like people every learner is, with a table and a figure.

What is measured is in :mod:`~causal_openlock.analysis.results.people.human_likeness`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from causal_openlock.analysis.measures import TRANSFERS
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.results.people.human_likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    distance,
    effects_of,
    likeness_table,
    points_of,
    points_of_model,
    points_of_people,
    published_points,
)
from causal_openlock.analysis.results.people.published import did_what_people_did

CLEAR = 0.05
"""An effect is clear of chance if its sign is people's and its p is below this."""

MOST_DRAWN = 5
"""So many learners are drawn beside people and the published model: those nearest to people."""


def section(material: Material) -> Section | None:
    """How like people every learner is that did what people did, at all fourteen points.

    Args:
        material: What the report is made of.

    Returns:
        The section, or None if no learner played all six conditions as people did.
    """
    trials = material.trials[did_what_people_did(material.trials, material.pairs)]
    if trials.empty:
        return None
    points = points_of(trials)
    count = len(published_points())
    complete = [name for name in material.learners if (points["learner"] == name).sum() == count]
    if not complete:
        return None
    own = {name: points[points["learner"] == name] for name in complete}
    found = {name: effects_of(own[name], trials[trials["learner"] == name]) for name in complete}
    own[PUBLISHED_MODEL] = points_of_model()
    found[PUBLISHED_MODEL] = effects_of(own[PUBLISHED_MODEL])
    table = likeness_table(list(own.values()), list(found.values()))
    everyone = {"people": effects_of(points_of_people()), **found}
    order = ["people", *table["learner"]]
    return Section(
        name="human_likeness",
        title="Likeness to people",
        text=_text(table, found),
        tables=(_shown(table, found), _tests(everyone, order)),
        drawings=(draw_points([own[name] for name in table["learner"]], effects=found),),
    )


def signs(effects: pd.DataFrame) -> str:
    """How many effects have people's sign, and how many of these are clear of chance.

    Args:
        effects: Of one learner, from :func:`effects_of`.
    """
    like = int(effects["like_people"].sum())
    return f"{like} of {len(effects)} signs, {_clear(effects)} at p < .05"


def _clear(effects: pd.DataFrame) -> int:
    return int((effects["like_people"] & (effects["p"] < CLEAR)).sum())


def _text(table: pd.DataFrame, found: Mapping[str, pd.DataFrame]) -> tuple[str, ...]:
    learners = table[table["learner"] != PUBLISHED_MODEL]
    published = table[table["learner"] == PUBLISHED_MODEL].iloc[0]
    nearest = learners.iloc[0]
    nearer = "nearer to people than" if nearest["rmse"] < published["rmse"] else "no nearer than"
    total = len(EFFECTS)
    return (
        f"People's means are known at {len(published_points())} points. The nearest learner is "
        f"{nearest['learner']}: its means are {nearest['rmse']:.2f} attempts away from people's "
        f"(root mean square; {nearest['rmse_se']:.1f} of people's standard errors), and "
        f"{int(nearest['shown'])} of {total} effects have people's sign, "
        f"{_clear(found[nearest['learner']])} of them clear of chance (p < .05). It is {nearer} "
        f"the published model, which is {published['rmse']:.2f} attempts away, with people's sign "
        f"in {int(published['shown'])} effects, {_clear(found[PUBLISHED_MODEL])} of them clear of "
        "chance.",
    )


def _shown(table: pd.DataFrame, found: Mapping[str, pd.DataFrame]) -> Table:
    """Differences as they are, the nearest learner first."""
    names = {"rmse": "RMSE", "rmse_se": "RMSE (SE)", "shown": "signs"}
    ticks = {
        effect.name: [
            "" if np.isnan(value) else f"{'✓' if value > 0 else '✗'} {value:+.1f}"
            for value in table[effect.name]
        ]
        for effect in EFFECTS
    }
    frame = table.assign(**ticks).rename(columns=names)
    clear = [_clear(found[name]) for name in table["learner"]]
    frame.insert(frame.columns.get_loc("signs") + 1, "p < .05", clear)
    return Table(
        name="human_likeness",
        title="Distance from people, and their effects",
        frame=frame,
        formats={"RMSE": ".2f", "RMSE (SE)": ".2f"},
        caption=(
            "RMSE: root mean square of the deviations from people's means, in attempts and in "
            "people's standard errors. Signs: how many effects have people's sign, which is no "
            "test; p < .05: how many of these are clear of chance. Then each difference, in "
            "attempts, with a tick if its sign is people's. "
            + " ".join(f"{e.name}: {e.claim}." for e in EFFECTS)
        ),
    )


def _tests(found: Mapping[str, pd.DataFrame], order: Sequence[str]) -> Table:
    rows = pd.concat([found[name].assign(learner=name) for name in order], ignore_index=True)
    frame = rows[["learner", "effect", "difference", "t", "df", "p"]]
    return Table(
        name="human_likeness_tests",
        title="The effects, tested",
        frame=frame,
        formats={"difference": "+.2f", "t": ".2f", "p": ".3f"},
        caption=(
            "Two-sided t-tests of each difference against zero. Of learners, learning is tested "
            "within subjects; of people and of the published model only means and error bars are "
            "known, so that their trials are compared as if others had played each of them, which "
            "finds too little rather than too much."
        ),
    )


def draw_points(
    shown: Sequence[pd.DataFrame],
    most: int = MOST_DRAWN,
    effects: Mapping[str, pd.DataFrame] | None = None,
) -> Drawing:
    """People's means at the fourteen points, and in each panel somebody's beside them.

    Args:
        shown: Points of whoever is drawn, as :func:`points_of` gives them, the nearest first.
        most: How many learners to draw at most, the published model aside.
        effects: From :func:`effects_of`, by learner; of others they come from the points alone.

    Returns:
        The drawing.
    """
    learners = [own for own in shown if own["learner"].iloc[0] != PUBLISHED_MODEL][:most]
    drawn = [*learners, *(own for own in shown if own["learner"].iloc[0] == PUBLISHED_MODEL)]
    with style.settings():
        figure, axes = style.panels(len(drawn), columns=2, height=2.5)
        for panel, own in zip(axes, drawn, strict=True):
            name = str(own["learner"].iloc[0])
            tested = (effects or {}).get(name)
            _draw(panel, own, effects_of(own) if tested is None else tested)
        highest = max(float(own[["mean", "people_mean"]].max().max()) for own in drawn)
        axes[0].set_ylim(0, 1.2 * highest)  # all panels have the same scale
        style.label_rows(axes, "Attempts to solve")
        keys = [
            Line2D([], [], marker="o", ms=4, ls="", color="#777777", label="people"),
            Line2D([], [], marker="D", ms=4.5, ls="", color=style.COMMON_CAUSE, label="on CC4"),
            Line2D([], [], marker="D", ms=4.5, ls="", color=style.COMMON_EFFECT, label="on CE4"),
        ]
        style.legend(figure, keys)
    return Drawing(
        "human_likeness",
        "People's fourteen points",
        "Mean attempts to solve, of people (grey circles, in every panel the same) and of whoever "
        "the panel is named after (diamonds). Left: the five trials of each baseline; right: the "
        "test of each transfer condition, named after the schema that was trained. Error bars: ± 1 "
        "standard error (population SD / √n). RMSE in attempts; signs of the effects: how many are "
        "people's, and how many of these are clear of chance.",
        figure,
    )


_GROUPS = (("CC4", 0.0), ("CE4", 5.8))
_TESTS = dict(zip(TRANSFERS, (12.3, 14.1, 16.5, 18.3), strict=True))


def _draw(panel: Axes, own: pd.DataFrame, effects: pd.DataFrame) -> None:
    starts = dict(_GROUPS)
    grey = "#777777"
    for condition, rows in own.groupby("condition", sort=False):
        on_test = condition in _TESTS
        x = (
            np.array([_TESTS[condition]])
            if on_test
            else starts[condition] + rows["trial"].to_numpy(float)
        )
        colour = style.COMMON_CAUSE if condition.endswith("CC4") else style.COMMON_EFFECT
        line = "" if on_test else "-"
        panel.errorbar(
            x - 0.13, rows["people_mean"], rows["people_se"],
            fmt=f"o{line}", ms=3.5, lw=0.8, color=grey, elinewidth=0.9,
        )  # fmt: skip
        panel.errorbar(
            x + 0.13, rows["mean"], rows["se"],
            fmt=f"D{line}", ms=3.8, lw=1.1, color=colour, elinewidth=0.9,
        )  # fmt: skip
    ticks = [start + trial for _, start in _GROUPS for trial in range(1, 6)]
    panel.set_xticks(
        [*ticks, *_TESTS.values()],
        [*(list("12345") * 2), *(name.split("-")[0] for name in _TESTS)],
        fontsize=7,
    )
    for at, text in ((3.0, "CC4"), (8.8, "CE4"), (13.2, "→ CC4"), (17.4, "→ CE4")):
        panel.annotate(
            text, (at, 0), xytext=(0, -18), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", va="top", fontsize=8, fontweight="bold",
        )  # fmt: skip
    panel.set_xlim(0.3, 19.2)
    attempts, _ = distance(own)
    style.panel_title(
        panel,
        str(own["learner"].iloc[0]),
        f"RMSE {attempts:.2f}; {signs(effects)}",
    )
