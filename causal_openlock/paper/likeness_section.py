"""Section on each learner's likeness to people, where people's means are published."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section, SectionPlot, drawn
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic
from causal_openlock.paper.likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    distance,
    effects_of,
    points_of_people,
    published_points,
)
from causal_openlock.paper.likeness_figure import MOST_TOGETHER, likeness_of, plot_likeness
from causal_openlock.paper.noise_ceiling import (
    beside_null_models,
    misfit,
    noise_ceiling,
    null_curves,
)
from causal_openlock.wording import joined


def section(material: Material) -> Section | None:
    """Section on learners that played all six conditions as people did; None without any."""
    like = material.once(likeness_of)
    if like is None:
        return None
    table, found = like.table, like.effects
    order = ["people", *table["learner"]]
    tests = {"people": effects_of(points_of_people()), **found}
    each = pd.concat([tests[name].assign(learner=name) for name in order], ignore_index=True)
    published = table["learner"] == PUBLISHED_MODEL
    beside = beside_null_models(like, material.trials)
    nearest = table[~published].iloc[0]
    name = nearest["learner"]
    ceiling = noise_ceiling(points_of_people())
    fit = misfit(like.points[name])
    answer = (
        f"Nearest to people is {name}: its means at their fourteen points are "
        f"{nearest['rmse']:.2f} attempts away (root mean square; the published model: "
        f"{table[published].iloc[0]['rmse']:.2f}; a perfect model: about {ceiling.people:.2f}). "
        f"Sampling error {'explains' if fit.p >= ALPHA else 'does not explain'} that "
        f"({fit.in_words}). {nearest['shown']} of {len(EFFECTS)} effects have people's sign."
    )
    curves = [
        f"a {curve} is {distance(fitted.points)[0]:.2f} away"
        for curve, fitted in null_curves().items()
    ]
    text = (
        f"A perfect model would be about {ceiling.people:.2f} attempts away ({ceiling.low:.2f} to "
        f"{ceiling.high:.2f} in 95 of 100 such studies), because 40 people are a sample; "
        f"{len(published_points())} means cannot rank models that are nearer. Fitted to these "
        f"means, {joined(curves)}."
    )
    # Those that come out no farther than the nearest one beyond people's sampling error.
    if alike := beside.loc[beside["verdict"] == "not ranked", "learner"].tolist():
        text += (
            f" Not distinguishable from {name} (the 95% interval of the difference includes 0): "
            f"{joined(alike)}."
        )
    return Section(
        "human_likeness",
        "Likeness to people",
        (text,),
        _tables(_shown(beside), _differences(table), each[_TESTED]),
        _plots(material),
        answer,
        is_open=True,
    )


def _tables(
    distances: pd.DataFrame, effects: pd.DataFrame, tests: pd.DataFrame
) -> tuple[Table, ...]:
    of_distances = (
        "RMSE: root mean square of the deviations from people's means at the fourteen points, in "
        "attempts. Misfit: deviations squared, each divided by the sum of both squared standard "
        "errors; p is the probability of as much for a perfect model, with trials taken as "
        "independent, so a small one rejects the learner. It takes no setting of a learner as "
        "fitted to these means; each that was takes away a degree of freedom. Perfect: the RMSE of "
        "a perfect model with the same number of subjects; of curves, also with as many fitted "
        "numbers. Training: deviation in three-lever rooms (CogSci 2019), of attempts until both "
        "solutions are found; none of our learners was fitted to these. Difference: of RMSE to the "
        "nearest learner, with a 95% interval over other samples of people and of subjects; nearer "
        "and farther where it excludes zero. The curves are exponential in the number of rooms "
        "played, fitted to the fourteen means: the first knows no schema, the second adds one "
        "number for common effect rooms and for training with the other structure."
    )
    of_effects = (
        "Signs: how many effects have people's sign, which is not a test. Then each difference, in "
        "attempts, with a tick if its sign is people's. "
        + " ".join(f"{effect.name}: {effect.claim}." for effect in EFFECTS)
    )
    of_tests = (
        "Two-sided t-tests of each difference against zero. Of learners, learning is tested within "
        "subjects; of people and of the published model only means and error bars are known, so "
        "that their trials are compared as if different subjects had played each of them, which "
        "finds too little rather than too much."
    )
    return (
        Table(
            "human_likeness_distances", "Distance from people, and what it is worth", distances,
            _FORMATS, of_distances,
        ),
        Table("human_likeness", "People's effects", effects, _FORMATS, of_effects),
        Table("human_likeness_tests", "The effects, tested", tests, _FORMATS, of_tests),
    )  # fmt: skip


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


_TESTED = ["learner", "effect", "difference", "t", "df", "p"]
_HEADS = {
    "learner": "learner",
    "rmse": "RMSE",
    "misfit": "misfit",
    "ceiling": "perfect",
    "difference": "difference",
    "low": "low",
    "high": "high",
    "verdict": "verdict",
    "all": "training",
    "misfit_all": "misfit, training",
}
_FORMATS: Mapping[str, str] = {
    **{_HEADS[name]: ".2f" for name in ("rmse", "all", "ceiling")},
    **{"difference": "+.2f", "low": "+.2f", "high": "+.2f", "t": ".2f", "p": ".3f"},
}


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """The distances, without those of parts of the points."""
    return table[list(_HEADS)].rename(columns=_HEADS)


def _differences(table: pd.DataFrame) -> pd.DataFrame:
    """Differences as they are, with a tick or a cross, the nearest learner first."""
    ticks = {
        effect.name: [
            "" if np.isnan(value) else f"{'✓' if value > 0 else '✗'} {value:+.1f}"
            for value in table[effect.name]
        ]
        for effect in EFFECTS
    }
    frame = table.assign(**ticks).rename(columns={"shown": "signs"})
    return frame.drop(columns=["points", "rmse"])


TOPIC = Topic("human_likeness", 20, section)
