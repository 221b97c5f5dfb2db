"""Section on each learner's distance from people, published or one's own, and from any reference.

Of the paper's people the fourteen means are judged next to null models, and with the effects that
people show (:mod:`~causal_openlock.paper.likeness`), and drawn; of other references the distance
alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.measures import BASELINES, TRANSFERS
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, SectionPlot, Topic, drawn
from causal_openlock.errors import NothingToDrawError
from causal_openlock.paper.likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    Likeness,
    distance,
    effects_of,
    likeness,
    points_of,
    points_of_model,
    points_of_people,
)
from causal_openlock.paper.noise_ceiling import (
    CURVE,
    beside_null_models,
    misfit,
    noise_ceiling,
    null_curve,
)
from causal_openlock.paper.references import PEOPLE, people_beside
from causal_openlock.paper.significance import p_in_words
from causal_openlock.wording import file_names, joined

MOST_DRAWN = 5
"""Learners that have a panel next to the published model's: those nearest to people."""

MOST_TOGETHER = 4
"""Learners that are drawn in one panel: those nearest to people."""

_STARTS = dict(zip((*BASELINES, *TRANSFERS), (0.0, 5.8, 11.3, 13.1, 15.5, 17.3), strict=True))
"""Where the trials of a condition begin on the x axis."""
_GREY = "#777777"
_HEADS = {"rmse": "RMSE", "ceiling": "perfect", "all": "training", "misfit_all": "misfit, training"}
_COLUMNS = ["learner", "rmse", "misfit", "ceiling", "difference", "low", "high", "verdict"]
_FORMATS = {
    **dict.fromkeys(("RMSE", "training", "perfect"), ".2f"),
    **dict.fromkeys(("difference", "low", "high"), "+.2f"),
}


def section(material: Material) -> Section | None:
    """Section on learners that did what people, or another reference, did; None without any."""
    others = tuple(_other_references(material))
    like = material.once(likeness_of)
    if like is None:
        title = "Distance from references"
        return Section("human_likeness", title, tables=others) if others else None
    beside = beside_null_models(like, material.trials)
    rmse = beside.set_index("learner")["rmse"]
    nearest = next(name for name in like.points if name != PUBLISHED_MODEL)
    ceiling, fit = noise_ceiling(points_of_people()), misfit(like.points[nearest])
    shown = like.effects[nearest]["like_people"].sum()
    answer = (
        f"Nearest to people is {nearest}: its means at their fourteen points are "
        f"{rmse[nearest]:.2f} attempts away (root mean square; the published model: "
        f"{rmse[PUBLISHED_MODEL]:.2f}; a perfect model: about {ceiling.people:.2f}). "
        f"Sampling error {'explains' if fit.p >= ALPHA else 'does not explain'} that "
        f"({fit.in_words}). {shown} of {len(EFFECTS)} effects have people's sign."
    )
    text = (
        f"A perfect model would be about {ceiling.people:.2f} attempts away ({ceiling.low:.2f} to "
        f"{ceiling.high:.2f} in 95 of 100 such studies), because 40 people are a sample; fourteen "
        f"means cannot rank models that are nearer. A {CURVE}, fitted to these means, is "
        f"{distance(null_curve())[0]:.2f} away."
    )
    # Those that come out no farther than the nearest one beyond people's sampling error.
    if alike := beside.loc[beside["verdict"] == "not ranked", "learner"].tolist():
        text += (
            f" Not distinguishable from {nearest} (the 95% interval of the difference includes 0): "
            f"{joined(alike)}."
        )
    tables = _distances(beside), _effects(like), *others
    title = "Likeness to people"
    plots = _plots(material)
    return Section("human_likeness", title, (text,), tables, plots, answer, is_open=True)


def _distances(beside: pd.DataFrame) -> Table:
    caption = (
        "RMSE: root mean square of the deviations from people's means at the fourteen points, in "
        "attempts. Misfit: deviations squared, each divided by the sum of both squared standard "
        "errors; p is the probability of as much for a perfect model, with trials taken as "
        "independent, so a small one rejects the learner. It takes no setting of a learner as "
        "fitted to these means; each that was takes away a degree of freedom. Perfect: the RMSE of "
        "a perfect model with the same number of subjects; of the curve, also with as many "
        "fitted numbers. Difference: of RMSE to the nearest learner, with a 95% interval over "
        "other samples of people and of subjects; nearer and farther where it excludes zero. "
        "Training: deviation in three-lever rooms (CogSci 2019), of attempts until both solutions "
        "are found; none of our learners was fitted to these. The curve is exponential in the "
        "number of rooms played, with one number more for common effect rooms and for training "
        "with the other structure."
    )
    frame = beside[[*_COLUMNS, "all", "misfit_all"]].rename(columns=_HEADS)
    title = "Distance from people, and what it is worth"
    return Table("human_likeness_distances", title, frame, _FORMATS, caption)


def _effects(like: Likeness) -> Table:
    """A row for people and each learner: its effects, with p."""
    effects = {"people": effects_of(points_of_people()), **like.effects}
    rows = []
    for name in ("people", *like.points):
        row = {"learner": name, "signs": effects[name]["like_people"].sum()}
        for found in effects[name].to_dict("records"):
            p = "" if pd.isna(found["p"]) else f"\n{p_in_words(found['p'])}"
            row[found["effect"]] = f"{found['difference'] + 0.0:+.2f}{p}".replace("-", "−")
        rows.append(row)
    caption = (
        "Differences in attempts, positive where people show the effect, with p of a two-sided "
        "t-test against zero. Signs: how many effects have people's sign, which is not a test. "
        "Learning of a learner is tested within subjects; of people and of the published model "
        "only means and error bars are known, so that trials are compared as if different "
        "subjects had played each, which finds too little rather than too much. "
        + " ".join(f"{effect.name}: {effect.claim}." for effect in EFFECTS)
    )
    return Table("human_likeness", "People's effects", pd.DataFrame(rows), caption=caption)


def _other_references(material: Material) -> Iterator[Table]:
    """Distances from each reference but the paper's people, of learners that did what it did."""
    files = file_names(one.prefix for one in material.leading)
    for reference in material.leading:
        trials = material.trials[reference.stands(material.trials)]
        if reference.name == PEOPLE or trials.empty:
            continue
        points = points_of(trials, reference.points)
        rows = [
            (name, len(own), *distance(own), misfit(own).in_words, noise_ceiling(own).both)
            for name, own in points.groupby("learner")
        ]
        heads = ["learner", "points", "RMSE", "in standard errors", "misfit", "perfect"]
        frame = pd.DataFrame(rows, columns=heads).sort_values("RMSE", ignore_index=True)
        caption = (
            f"Root mean square distance of mean attempts from {reference.name} over the trials "
            "that both played, in attempts and in the reference's standard errors. Misfit: the sum "
            "of squared deviations in standard errors of both, and the probability of as much for "
            "a perfect model. Perfect: the distance of a perfect model, since all means have "
            "sampling error."
        )
        formats = {**_FORMATS, "in standard errors": ".2f"}
        file, title = f"distance_from_{files[reference.prefix]}", f"Distance from {reference.name}"
        if len(frame):
            yield Table(file, title, frame, formats, caption)


def _plots(material: Material) -> tuple[SectionPlot, ...]:
    together = (
        "Mean attempts to solve ± 1 standard error: the five trials of each baseline, and the test "
        "of each transfer condition, named after the schema of its training. Right: the "
        f"{MOST_TOGETHER} learners nearest to people, without those that are given the schema or "
        "the room."
    )
    each = (
        "Mean attempts to solve, of people (grey circles, the same in every panel) and of the "
        "learner that the panel is named after (diamonds). Left: the five trials of each baseline; "
        "right: the test of each transfer condition, named after the schema that was trained. "
        "Error bars: ± 1 standard error (population SD / √n). RMSE in attempts, and that of a "
        "perfect model with the same number of subjects; effects: how many have people's sign."
    )
    title = "People and learners at the fourteen published points"
    first = drawn("fourteen_points", plot_likeness, material, title, together, together=True)
    title = "People's points next to each learner's"
    second = drawn("human_likeness", plot_likeness, material, title, each)
    return replace(first, opening=True), replace(second, folded=True)


# -- the figure -----------------------------------------------------------------------------------


def plot_likeness(
    results: Material, *, learners: Names = None, together: bool = False, ax: Any = None
) -> Any:
    """Draw people's means at the fourteen points, and one learner's in each panel.

    The nearest to people stands first, the published model last. Above a panel: the distance
    (RMSE), that of a perfect model with as many subjects, whether sampling error explains it
    (:func:`~causal_openlock.paper.noise_ceiling.misfit`), and how many effects have people's sign.

    >>> [axes.get_title(loc="left") for axes in plot_likeness(results, learners=["random"])]
    ['random', 'published model']

    With ``together`` there are two panels: people with the published model, and the learners that
    are given neither the schema nor the room. By default the nearest :data:`MOST_DRAWN` are drawn.
    Arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    found = results.once(likeness_of)
    if learners is not None:
        trials = rows_of(results, results.trials, learners)
        found = likeness(trials, people_beside(results), results.learners)
    if found is None:
        raise NothingToDrawError(
            "no such learner played all six conditions of the paper as people did, in its rooms "
            "under the protocol human"
        )
    own = {name: points for name, points in found.points.items() if name != PUBLISHED_MODEL}
    names = list(own) if learners is not None else list(own)[:MOST_DRAWN]
    if together:
        given = {spec.name for spec in results.experiment.learners if spec.origin.informed}
        if learners is None and not given.issuperset(own):
            names = [name for name in own if name not in given][:MOST_TOGETHER]
        return draw_together({name: own[name] for name in names}, ax)
    drawn = {name: found.points[name] for name in [*names, PUBLISHED_MODEL]}
    return draw_points(drawn, found.effects, ax)


def likeness_of(results: Material) -> Likeness | None:
    """Compare all learners of some results with people; None where none can be compared."""
    return likeness(results.trials, people_beside(results), results.learners)


def draw_points(
    points: Mapping[str, pd.DataFrame],
    effects: Mapping[str, pd.DataFrame],
    ax: Any = None,
    fitted: Mapping[str, int] = MappingProxyType({}),
) -> Any:
    """Draw the panels from points, effects that were tested and numbers that were fitted."""
    people: Any = {"marker": "o", "ms": 3.5, "color": _GREY, "lw": 0.8, "ls": "-"}
    colours = {schema: style.current().trained(schema) for schema in BASELINES}
    highest = max(float(own[["mean", "people_mean"]].max().max()) for own in points.values())
    with panels(ax, len(points), in_rows(len(points), 2, 2.5)) as at:
        for axes, (name, own) in zip(at.axes, points.items(), strict=True):
            number = fitted.get(name, 0)
            detail = (
                f"RMSE {distance(own)[0]:.2f} (perfect {noise_ceiling(own, number).both:.2f}), "
                f"{misfit(own, number).in_words}\n{with_peoples_sign(effects[name])}"
            )
            _draw_line(axes, own, people, -0.13, "people_")
            for schema, colour in colours.items():
                look = {**people, "marker": "D", "ms": 3.8, "color": colour, "lw": 1.1}
                _draw_line(axes, own[own["condition"].str.endswith(schema)], look, 0.13)
            style.panel_title(axes, name, detail)
            _points_axis(axes, 19.2, 1.2 * highest)  # all panels have the same scale
        at.label_y("Attempts to solve")
        keys = [Line2D([], [], marker="o", ms=4, ls="", color=_GREY, label="people")]
        keys += [
            Line2D([], [], marker="D", ms=4.5, ls="", color=colour, label=f"on {schema}")
            for schema, colour in colours.items()
        ]
        at.legend(keys)
    return at.returned


def draw_together(learners: Mapping[str, pd.DataFrame], ax: Any = None) -> Any:
    """Draw people with the published model in one panel, and points of learners in another."""
    people = {"people": points_of_people(), "published model": points_of_model()}
    greys = ({"color": "black", "ls": "-"}, {"color": _GREY, "ls": ":"})
    looks = [style.current().line(number) for number in range(len(learners))]
    shown = [*people.values(), *learners.values()]
    highest = max(float((own["mean"] + own["se"].fillna(0)).max()) for own in shown)
    with panels(ax, 2, in_rows(2, 2, 1.8)) as at:
        for axes, title, group, lines in zip(
            at.axes, ("People", "Learners"), (people, learners), (greys, looks), strict=True
        ):
            for own, look in zip(group.values(), lines, strict=True):
                _draw_line(axes, own, {**look, "marker": "o", "ms": 3.2, "lw": 1.2})
            style.panel_title(axes, title)
            _points_axis(axes, 26.5, 1.08 * highest)
            _name_lines(axes, group, [look["color"] for look in lines], 0.075 * highest)
        at.label_y("Attempts to solve")
    return at.returned


def _draw_line(
    axes: Axes, points: pd.DataFrame, look: Mapping[str, Any], shift: float = 0, whose: str = ""
) -> None:
    """Draw means and standard errors: baselines as lines, tests as dots."""
    for condition, rows in points.groupby("condition", sort=False):
        start = _STARTS[str(condition)]
        line = {**look, "ls": "" if str(condition) in TRANSFERS else look["ls"]}
        x = start + rows["trial"].to_numpy(float) + shift
        axes.errorbar(x, rows[f"{whose}mean"], rows[f"{whose}se"], elinewidth=0.9, **line)


def _name_lines(
    axes: Axes, learners: Mapping[str, pd.DataFrame], colours: Sequence[str], gap: float
) -> None:
    """Write names right of the last points, at least ``gap`` apart, in the order of the points."""
    height = -np.inf
    ends = [float(own["mean"].iloc[-1]) for own in learners.values()]
    for value, name, colour in sorted(zip(ends, learners, colours, strict=True)):
        height = max(value, height + gap)
        axes.annotate(
            style.label(name, 18), (19.2, height), va="center", fontsize="small", color=colour
        )


def signs(effects: pd.DataFrame) -> str:
    """Numbers of a learner's effects with people's sign, and of those significant, in words."""
    significant = int((effects["like_people"] & (effects["p"] < ALPHA)).sum())
    return f"{with_peoples_sign(effects)}, {significant} at p < {ALPHA:g}"


def with_peoples_sign(effects: pd.DataFrame) -> str:
    """Number of one learner's effects that have people's sign, in words."""
    return f"{int(effects['like_people'].sum())} of {len(effects)} effects with people's sign"


def _points_axis(axes: Axes, right: float, top: float) -> None:
    """Name the fourteen points on the x axis, and set the limits of both axes."""
    ticks = {_STARTS[name] + trial: str(trial) for name in BASELINES for trial in range(1, 6)}
    ticks |= {_STARTS[name] + 1: name.split("-")[0] for name in TRANSFERS}
    axes.set_xticks([*ticks], [*ticks.values()], fontsize="small")
    for at, text in ((3.0, "CC4"), (8.8, "CE4"), (13.2, "→ CC4"), (17.4, "→ CE4")):
        axes.annotate(
            text, (at, 0), xytext=(0, -18), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", va="top", fontsize="medium", fontweight="bold",
        )  # fmt: skip
    axes.set(xlim=(0.3, right), ylim=(0, top))


TOPIC = Topic("human_likeness", 20, section)
