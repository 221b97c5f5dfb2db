"""What each learner is, how much its subjects vary, and every trial that they played.

A mean hides whether all subjects did alike or half of them never solved a trial. So next to its
numbers each learner has a figure in which every subject counts: a circle is as large as the share
of subjects that needed that number of attempts.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import sizes
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, drawn
from causal_openlock.wording import file_names


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
            tables.append(_trials(rows, f"{label}_{file}", title))
    text = (
        "Figures: how subjects vary. Tables: a row is one trial number of one condition; where a "
        "protocol goes through its trials in loops, each subject’s visits are averaged first. se "
        "is the standard error (population SD / √n), ci the 95% interval, mode the most common "
        "value (at mode: how many have it), share solved that of visits in which every solution "
        "was found, ideal what the ideal observer needs, which knows the schema, and difference "
        "that from a reference. The same numbers, with more digits, are in summary.csv.",
    )
    return Section("learners", "Learners, and every trial", text, tuple(tables), tuple(plots))


def _trials(rows: pd.DataFrame, name: str, title: str) -> Table:
    """Rows of a summary as a table, without columns that say nothing."""
    frame = rows.drop(columns=["learner", "protocol"]).dropna(axis="columns", how="all")
    frame = frame.reset_index(drop=True)
    formats = dict.fromkeys(frame.select_dtypes("float"), ".2f") | {"share_solved": ".1%"}
    formats |= {column: "+.2f" for column in frame if column.endswith("difference")}
    starts = np.flatnonzero(frame["condition"] != frame["condition"].shift()).tolist()
    return Table(name, title, frame, formats, looks=dict.fromkeys(starts, "first"))
