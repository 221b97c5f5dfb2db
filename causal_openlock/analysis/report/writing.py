"""The report of a record: counts become sections, sections become a page and its files.

``report.html`` is a single file: its style, its figures and its tables are inside it, and it
fetches nothing. Next to it is ``summary.csv``. On request, since they take longer than the page,
there are also the figures as PDF (``figures/``) and the tables as CSV and LaTeX
(``tables/``). Nothing in any of them depends on when or where the report was written.
"""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.plots.categories import counts_like_ddqn, plot_categories
from causal_openlock.analysis.plots.course import plot_course
from causal_openlock.analysis.plots.subjects import plot_subjects
from causal_openlock.analysis.report.described import described, in_words
from causal_openlock.analysis.report.page import write_page
from causal_openlock.analysis.report.warnings import about_people, not_applicable, warnings_of
from causal_openlock.analysis.results.by_condition import condition_tables
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.missing import missing_cells, unfinished, with_missing
from causal_openlock.analysis.statistics import beside_mean, sizes
from causal_openlock.analysis.table import Table, write_table
from causal_openlock.analysis.topic import (
    Section,
    SectionPlot,
    Topic,
    all_topics,
    drawn,
    sections_of,
)
from causal_openlock.analysis.topics.leaderboard import answers, leaderboard, leaderboard_tables
from causal_openlock.analysis.topics.pairwise import pairs
from causal_openlock.files.atomic import folder_at
from causal_openlock.storage.store import Store
from causal_openlock.wording import counted, file_names

CATEGORIES = {
    "baseline": (
        "Categories of baseline attempts",
        "in five successive blocks of the attempts of the baseline conditions; the first panel "
        "shows the paper's own DDQN (Figure 6)",
    ),
    "transfer": (
        "Categories of attempts in the transfer test",
        "among attempts of the test phase in the transfer conditions; the first panel shows the "
        "paper's own DDQN (Figure 7)",
    ),
}  #: by kind of conditions, the title of a figure and what it shows

HEIGHTS = (
    "Open 1, 2 and 3: the attempt opened the door with the first, second or third new solution of "
    "its trial (later ones count as the third, a repeated one as open 1); unlock: it unlocked the "
    "door but did not open it; else: neither. The height of a segment is log10 of its number of "
    "attempts, all subjects together, so one attempt has no height, panels of unequal totals "
    "differ in height, and a stack shrinks as one category takes over."
)


@dataclass(frozen=True)
class Report:
    """A report that is written; a notebook shows its page."""

    path: Path  #: its page, ``report.html``

    def open(self) -> None:
        """Open the page in a browser."""
        webbrowser.open(self.path.resolve().as_uri())


def make_report(
    material: Material,
    out_dir: Path | str,
    topics: Sequence[Topic] | None = None,
    begin: Callable[[str], None] = lambda _: None,
    figures: bool = False,
) -> Report:
    """Write the report of some results on these topics: ``report.html`` and ``summary.csv``.

    With ``figures``, figures and tables are also written as files, to ``figures/`` and ``tables/``.
    ``begin`` is called before each step with its name, such as ``describing survival``.

    Raises:
        OpenLockError: If a file cannot be written; those that were there stay whole.
    """
    folder = folder_at(out_dir)
    experiment = material.experiment
    missing = missing_cells(experiment)
    write_table(with_missing(material.summary, missing), folder / "summary.csv")
    begin("computing leaderboard")
    ranked = material.once(leaderboard)
    if figures:
        write_table(ranked, folder / "tables" / "leaderboard.csv")
    about = {spec.name: spec.origin.about for spec in experiment.learners}
    first = leaderboard_tables(ranked, about)
    topics = all_topics() if topics is None else topics
    found = sections_of(material, topics, lambda name: begin(f"describing {name}"))
    opening = answers(ranked, material.once(pairs)).items()
    sentences = {protocol: [" ".join(own)] for protocol, own in opening}
    for protocol in [*first][:1]:
        sentences[protocol] += [one.answer for one in found if one.answer]
    begin("drawing")
    course = Section("figures", "Course and categories", plots=tuple(figures_of(material)))
    run = _what_was_run(material)
    sections = [_conditions(material), *found, course, learner_pages(material), run]
    pictures = [plot for one in found for plot in one.plots if plot.opening]
    write_page(
        folder / "report.html",
        "report.html.j2",
        [one for one in sections if one.tables or one.plots or one in found],
        figures,
        Store(material.folders[0]).digest() if material.folders else "",
        title=experiment.title or experiment.name,
        opening=[f"Experiment {experiment.name}, seed {experiment.seed}."],
        missing=missing,
        unfinished=unfinished(missing),
        first=first,
        answers=sentences,
        figure=pictures[0] if pictures else None,
        not_applicable=not_applicable(experiment.reasons),
        alpha=ALPHA,
        warnings=[*warnings_of(material)],
    )
    return Report(folder / "report.html")


def _conditions(material: Material) -> Section:
    """The result of each learner in each condition."""
    tables = tuple(condition_tables(material))
    text = (
        "Means over n subjects, with Student’s 95% intervals (≈: approximate, of fewer than ten; "
        "none of fewer than five). Where 90% of subjects have one value: how many, with the "
        "interval of their share. Differences from references are under Learners.",
    )
    return Section("conditions", "Attempts in each condition", text, tables, is_open=True)


def figures_of(material: Material) -> list[SectionPlot]:
    """Figures of the categories of attempts and of the course of trials, where there are any."""
    plots = []
    for kind, (title, what) in CATEGORIES.items():
        if len(counts_like_ddqn(material, kind)):
            caption = f"Frequency of each category {what}. {HEIGHTS}"
            name = f"{kind}_categories"
            plots.append(drawn(name, plot_categories, material, title, caption, kind=kind))
    for protocol, part in file_names(material.trials["protocol"].unique()).items():
        caption = (
            "Mean attempts to solve each trial, in the order in which trials were played; a point "
            "of a long course is the mean of several in a row. Shaded or with bars: ± 1 standard "
            "error (population SD / √n). Right of the upright line, if there is one: the test."
        )
        name, title = f"attempts_by_trial_{part}", f"Trial by trial, protocol {protocol}"
        plots.append(drawn(name, plot_course, material, title, caption, protocol=protocol))
    return [replace(plot, folded=True) for plot in plots]


def learner_pages(material: Material) -> Section:
    """A figure for each learner, in their order, and a table for each of its protocols.

    A mean hides whether all subjects did alike or half of them never solved a trial: in the figure
    every subject counts.
    """
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
        "is the standard error (population SD / √n), share solved that of visits in which every "
        "solution was found, ideal what the ideal observer needs, which knows the schema, and "
        "difference that from a reference. The same numbers, with more digits, are in summary.csv.",
    )
    return Section("learners", "Learners, and every trial", text, tuple(tables), tuple(plots))


def _trials(rows: pd.DataFrame, name: str, title: str) -> Table:
    """Rows of a summary as a table, without columns that say nothing."""
    beside = ["ci_low", "ci_high", "subjects", "mode", "at_mode"]
    interval = [beside_mean(*of) or "–" for of in rows[beside].itertuples(index=False, name=None)]
    frame = rows.drop(columns=["learner", "protocol", "ci_high", "mode", "at_mode"])
    frame = frame.assign(ci_low=interval).rename(columns={"ci_low": "95% interval"})
    frame = frame.dropna(axis="columns", how="all").reset_index(drop=True)
    formats = {column: "+.2f" for column in frame if column.endswith("difference")}
    formats["share_solved"] = ".1%"
    starts = np.flatnonzero(frame["condition"] != frame["condition"].shift()).tolist()
    return Table(name, title, frame, formats, looks=dict.fromkeys(starts, "first"))


def _what_was_run(material: Material) -> Section:
    """The experiment, and how to run it again."""
    experiment, trials = material.experiment, material.all_trials
    versions = [f"{name} {in_words(one)}" for name, one in experiment.versions.items()]
    command = experiment.command or "causal-openlock compare EXPERIMENT.yaml --out DIR"
    text = (
        f"{counted(material.record.num_rows, 'attempt')} in {counted(len(trials), 'trial')}.",
        about_people(material),
        f"Versions: {'; '.join(versions)}." if versions else "",
        f"A unit of work has at most {counted(experiment.cell_size, 'subject')}.",
        f"To run it again: {command}",
        "A path is the one of the experiment file at the time. The experiment with every default "
        "filled in is in experiment.json. The report is written anew by causal-openlock report "
        "DIR, with --figures also every figure as PDF (figures/) and every table as CSV and LaTeX "
        "(tables/).",
        "L0 -> L1 says that L1 can be moved while L0 is pushed (| while any of these is, & while "
        "all are), and L0 -> door that the door is unlocked then; a number in brackets is the "
        "probability that an enabled push takes effect, if it is not 1.",
    )
    told = described(experiment, trials).items()
    tables = tuple(Table("", title, frame, verbatim=True) for title, frame in told)
    return Section("run", "What was run", tuple(filter(None, text)), tables)
