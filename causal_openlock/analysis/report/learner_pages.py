"""A page for each learner: what it is, its results, and how much its subjects vary.

A mean hides whether all subjects did alike or half of them never solved a trial. So next to its
numbers each learner has a figure in which every subject counts: a circle is as large as the share
of subjects that needed that number of attempts.
"""

from __future__ import annotations

from dataclasses import replace

from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.report.means import means
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import sizes
from causal_openlock.analysis.topic import Section, drawn
from causal_openlock.wording import file_names, joined


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
            size = f"protocol {protocols[0]}, {sizes(own)}"
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
        caption = "Mean attempts to solve the trial that the condition is judged by."
        title = f"{name} in every condition"
        tables.append(means(own, material.references, title, name=label, caption=caption))
    text = ("What each learner is, its results, and how its subjects vary.",) if plots else ()
    return Section("learners", "Learners", text, tuple(tables), tuple(plots))
