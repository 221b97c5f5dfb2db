"""What each learner is, how much its subjects vary, and every trial that they played.

A mean hides whether all subjects did alike or half of them never solved a trial. So next to its
numbers each learner has a figure in which every subject counts: a circle is as large as the share
of subjects that needed that number of attempts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Beside, difference_from
from causal_openlock.analysis.statistics import beside_mean, sizes
from causal_openlock.analysis.table import Table, share
from causal_openlock.analysis.topic import Section, drawn
from causal_openlock.wording import file_names

BESIDE_MEAN = ["ci_low", "ci_high", "subjects", "mode", "at_mode"]
"""Columns that say what stands next to a mean."""


def learner_pages(material: Material) -> Section:
    """A figure for each learner, in their order, and a table for each of its protocols."""
    about = {spec.name: spec.origin.about for spec in material.experiment.learners}
    headline, summary = material.headline, material.summary
    played = [name for name in material.learners if (headline["learner"] == name).any()]
    plots, tables = [], []
    for name, part in file_names(played).items():
        own = headline[headline["learner"] == name]
        protocols = own["protocol"].unique()
        size = "a panel for each protocol"
        if len(protocols) == 1:
            size = f"protocol {protocols[0]}, {sizes(own)}"
        caption = (
            f"{about.get(name, '')} Attempts of its subjects in the trial that each condition is "
            f"judged by ({size}). The area of a circle is the share of subjects."
        ).strip()
        label, title = f"learner_{part}", f"Subjects of {name}"
        plot = drawn(label, plot_subjects, material, title, caption, learners=[name])
        plots.append(replace(plot, folded=True))
        own = summary[summary["learner"] == name]
        for protocol, file in file_names(map(str, protocols)).items():
            rows = own[own["protocol"] == protocol]
            title = f"{name}, protocol {protocol}, {sizes(rows)}"
            tables.append(_trials(rows, material.references, f"{label}_{file}", title))
    text = (
        "Figures: how subjects vary. Tables: a row is one trial number of one condition; where a "
        "protocol goes through its trials in loops, each subject’s visits are averaged first. SE "
        "is the standard error (population SD / √n), “solved” the share of visits in which every "
        "solution was found, “ideal” what the ideal observer needs, which knows the schema, and "
        "“−” the difference from a reference. The same numbers, with more digits, are in "
        "summary.csv.",
    )
    return Section("learners", "Learners, and every trial", text, tuple(tables), tuple(plots))


def _trials(rows: pd.DataFrame, references: Sequence[Beside], name: str, title: str) -> Table:
    """Rows of a summary as a table, without columns that say nothing."""
    columns: dict[str, Any] = {
        **{"Condition": rows["condition"], "Phase": rows["phase"], "Trial": rows["trial"]},
        **{"Loops": rows["loops"], "n": rows["subjects"]},
        **{"Attempts": rows["attempts"], "SE": rows["se"]},
    }
    beside = rows[BESIDE_MEAN].itertuples(index=False, name=None)
    columns["95% interval"] = [beside_mean(*values) or "–" for values in beside]
    columns["Solved"] = rows["share_solved"].map(share)
    formats = {**dict.fromkeys(("Trial", "Loops", "n"), "d"), "Attempts": ".2f", "SE": ".2f"}
    formats |= {"95% interval": "s", "Solved": "s", "Ideal": ".2f"}
    for one in references:
        known = {
            one.reference.title: (f"{one.reference.prefix}_attempts", ".2f"),
            f"{one.reference.title} (SE)": (f"{one.reference.prefix}_se", ".2f"),
            f"− {one.reference.title}": (difference_from(one.reference, references), "+.2f"),
        }
        for head, (column, form) in known.items():
            if column in rows:
                columns[head], formats[head] = rows[column], form
    columns["Ideal"] = rows["ideal_attempts"]
    frame = pd.DataFrame(columns).dropna(axis="columns", how="all").reset_index(drop=True)
    starts = (frame["Condition"] != frame["Condition"].shift()).to_numpy()
    looks = {int(row): "first" for row in np.flatnonzero(starts)}
    return Table(name, title, frame, formats, looks=looks, verbatim=True)
