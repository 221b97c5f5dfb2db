"""A page for each learner: what it is, its results, and how much its subjects vary.

A mean hides whether all subjects did alike or half of them never solved a trial. So next to its
numbers each learner has a figure in which every subject counts: a circle is as large as the share
of subjects that needed that number of attempts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pandas as pd

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Beside, difference_from
from causal_openlock.analysis.section import Section, drawn
from causal_openlock.analysis.table import Table
from causal_openlock.wording import file_names, joined

_RENAMED = {"share_solved": "solved", "ideal_attempts": "ideal"}


def learner_pages(material: Material) -> Section:
    """A figure and a table for each learner, in their order."""
    about = {spec.name: spec.origin.about for spec in material.experiment.learners}
    headline = material.headline
    played = [name for name in material.learners if (headline["learner"] == name).any()]
    plots, tables = [], []
    for name, part in file_names(played).items():
        own = headline[headline["learner"] == name]
        protocols = own["protocol"].unique()
        size = "a panel for each protocol"
        if len(protocols) == 1:
            size = f"protocol {protocols[0]}, {style.sizes(own)}"
        known = [
            one.reference.name
            for one in material.leading
            if own[f"{one.reference.prefix}_attempts"].notna().any()
        ]
        beside = f"; next to it, mean ± standard error: {joined(known)}" if known else ""
        ideal = "; dashed: the ideal observer" if own["ideal_attempts"].notna().any() else ""
        caption = (
            f"{about.get(name, '')} Attempts of its subjects in the trial that each condition is "
            f"judged by ({size}). The area of a circle is the share of subjects; black: their mean "
            f"with its 95% interval{beside}{ideal}. A trial that was not solved counts "
            "as the limit."
        ).strip()
        label, title = f"learner_{part}", f"Subjects of {name}"
        plot = drawn(label, plot_subjects, material, title, caption, learners=[name])
        plots.append(replace(plot, folded=True))
        tables.append(
            Table(
                label,
                f"{name} in every condition",
                _shown(own, material.references),
                _formats(material.references),
                "Mean attempts to solve the trial that the condition is judged by, with the 95% "
                "interval over subjects.",
            )
        )
    text = ("What each learner is, its results, and how its subjects vary.",) if plots else ()
    return Section("learners", "Learners", text, tuple(tables), tuple(plots))


def _shown(own: pd.DataFrame, references: Sequence[Beside]) -> pd.DataFrame:
    """The headline of a learner, without columns that say nothing."""
    names = {f"{one.reference.prefix}_attempts": one.reference.name for one in references}
    errors = {f"{one.reference.prefix}_se" for one in references} & {*own.columns}
    frame = own.drop(columns=["learner", *errors]).rename(columns=names | _RENAMED)
    if frame["protocol"].nunique() == 1:
        frame = frame.drop(columns="protocol")
    return frame.dropna(axis="columns", how="all").reset_index(drop=True)


def _formats(references: Sequence[Beside]) -> dict[str, str]:
    """How the columns of :func:`_shown` are printed."""
    differences = [difference_from(one.reference, references) for one in references]
    return {
        "subjects": ",",
        **dict.fromkeys(("attempts", "ci_low", "ci_high", "ideal"), ".2f"),
        **{one.reference.name: ".2f" for one in references},
        **{name: "+.2f" for name in differences if name},
        "solved": ".1%",
    }
