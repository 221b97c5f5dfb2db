"""Section on each learner's distance from people, published or one's own, and from any reference.

Of the paper's people the fourteen means are judged next to null models, and with the effects that
people show (:mod:`~causal_openlock.paper.likeness`); of other references the distance alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, SectionPlot, Topic, drawn
from causal_openlock.paper.likeness import (
    EFFECTS,
    PUBLISHED_MODEL,
    Likeness,
    distance,
    effects_of,
    points_of,
    points_of_people,
)
from causal_openlock.paper.likeness_figure import MOST_TOGETHER, likeness_of, plot_likeness
from causal_openlock.paper.noise_ceiling import (
    CURVE,
    beside_null_models,
    misfit,
    noise_ceiling,
    null_curve,
)
from causal_openlock.paper.references import PEOPLE
from causal_openlock.paper.significance import p_in_words
from causal_openlock.wording import file_names, joined

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


TOPIC = Topic("human_likeness", 20, section)
