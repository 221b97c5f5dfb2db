"""The report of a record: counts become sections, sections become a page and its files.

``report.html`` is a single file: its style, its figures and its tables are inside it, and it
fetches nothing. Next to it is ``summary.csv``. On request, since they take longer than the page,
there are also the figures as PDF (``figures/``) and the tables as CSV and LaTeX
(``tables/``). Nothing in any of them depends on when or where the report was written.
"""

from __future__ import annotations

import webbrowser
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.report.about_people import about_people
from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.report.described import described, in_words
from causal_openlock.analysis.report.learner_pages import learner_pages
from causal_openlock.analysis.report.page import Written
from causal_openlock.analysis.report.warnings import not_applicable, warnings_of
from causal_openlock.analysis.results.by_condition import condition_tables
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.missing import missing_cells, with_missing
from causal_openlock.analysis.results.references import Beside, difference_from
from causal_openlock.analysis.statistics import beside_mean
from causal_openlock.analysis.table import Table, percent, write_table
from causal_openlock.analysis.topic import Topic, all_topics, sections_of
from causal_openlock.analysis.topics.leaderboard import (
    answers,
    leaderboard,
    leaderboard_tables,
)
from causal_openlock.analysis.topics.pairwise import all_pairs
from causal_openlock.files.atomic import folder_at
from causal_openlock.storage.store import Store


@dataclass(frozen=True)
class Report:
    """A report that is written; a notebook shows its page.

    Attributes:
        path: Its page, ``report.html``.
        answers: The sentences that it opens with, by protocol.
        leaderboard: Its first table, from
            :func:`~causal_openlock.analysis.topics.leaderboard.leaderboard`.
        removed: A sentence on files of an earlier report that were removed; empty without any.
    """

    path: Path
    answers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    leaderboard: pd.DataFrame = field(default_factory=pd.DataFrame, repr=False, compare=False)
    removed: str = ""

    def open(self) -> None:
        """Open the page in a browser."""
        webbrowser.open(self.path.resolve().as_uri())


def make_report(
    material: Material,
    out_dir: Path | str,
    topics: Sequence[Topic] | None = None,
    begin: Callable[[str], None] | None = None,
    figures: bool = False,
) -> Report:
    """Write the report of some results.

    Args:
        material: The results.
        out_dir: The folder to write ``report.html`` and ``summary.csv`` to; it is made if it does
            not exist. Figures and tables of an earlier report that this one does not write are
            removed; other files stay.
        topics: What it is about; by default :func:`~causal_openlock.analysis.topic.all_topics`.
        begin: Called before each step with its name, such as ``drawing survival``.
        figures: Whether figures and tables are also written as files, to ``figures/`` and
            ``tables/``.

    Raises:
        OpenLockError: If a file cannot be written; those that were there stay whole.
    """
    folder = folder_at(out_dir)
    experiment = material.experiment
    trials, learners, summary = material.counts.trials, material.learners, material.summary
    missing = missing_cells(experiment)
    write_table(with_missing(summary, missing), folder / "summary.csv")
    begin = begin or (lambda _: None)
    written = Written(folder / "report.html", figures, lambda name: begin(f"drawing {name}"))
    plots, pages = figures_of(material), learner_pages(material)
    topics = all_topics() if topics is None else topics
    begin("computing leaderboard")
    ranked = leaderboard(material)
    written.table("leaderboard", ranked)
    opening = answers(ranked, material.once(all_pairs))
    sections = sections_of(material, topics, lambda name: begin(f"describing {name}"))
    opening_figures = [plot for one in sections for plot in one.plots if plot.opening]
    written.page(
        "report.html.j2",
        title=experiment.title or experiment.name,
        record=Store(material.folders[0]).digest() if material.folders else "",
        experiment=experiment,
        attempts=material.record.num_rows,
        trials=len(trials),
        missing=[cell.text for cell in missing],
        failed=sum(cell.failed for cell in missing),
        first=leaderboard_tables(
            ranked, {spec.name: spec.origin.about for spec in experiment.learners}
        ),
        answers=opening,
        openings=tuple(one.answer for one in sections if one.answer),
        figure=written.plot(opening_figures[0]) if opening_figures else None,
        headline={
            one.protocol: one
            for one in condition_tables(
                material.headline,
                learners,
                material.conditions,
                material.references,
                experiment.without_any,
            )
        },
        details={
            one.reference: f"{one.reference.detail}, {style.sizes(one.reference.points)}"
            for one in material.references
            if len(one.reference.points)
        },
        sizes={
            key: style.sizes(rows)
            for key, rows in material.headline.groupby(["protocol", "learner"], observed=True)
        },
        figures=[written.plot(plot) for plot in plots],
        sections=[written.section(one) for one in sections],
        alpha=ALPHA,
        learners=[written.section(one) for one in pages],
        summary=_summary_blocks(summary, learners, material.references),
        people=about_people(material),
        described=[
            Table("", title, frame, verbatim=True)
            for title, frame in described(experiment, trials).items()
            if len(frame)
        ],
        versions=[f"{name} {in_words(one)}" for name, one in experiment.versions.items()],
        not_applicable=not_applicable(experiment.reasons),
        warnings=[*warnings_of(material)],
        given=material.given,
    )
    return Report(written.path, opening, ranked, written.removed)


def _summary_blocks(
    summary: pd.DataFrame, learners: Sequence[str], references: Sequence[Beside]
) -> list[dict[str, Any]]:
    """The summary by learner and protocol, as tables in which conditions are set apart."""
    blocks = []
    for learner in learners:
        own = summary[summary["learner"] == learner]
        for protocol, part in own.groupby("protocol", observed=True):
            blocks.append(
                {
                    "learner": learner,
                    "protocol": protocol,
                    "size": style.sizes(part),
                    "table": _every_trial(part, references),
                }
            )
    return blocks


def _every_trial(part: pd.DataFrame, references: Sequence[Beside]) -> Table:
    columns: list[tuple[str, Any, str]] = [
        ("Condition", part["condition"].astype(str), ""),
        ("Phase", part["phase"].astype(str), ""),
        *((head, part[name], "d") for head, name in _COUNTS.items()),
        ("Attempts", part["attempts"], ".2f"),
        ("SE", part["se"].where(part["subjects"] > 1), ".2f"),
        ("95% interval", [*map(_interval, *(part[name] for name in _INTERVAL))], "s"),
        ("Solved", part["share_solved"].map(percent), "s"),
    ]
    for one in references:
        reference = one.reference
        if reference.points.empty or part[f"{reference.prefix}_attempts"].isna().all():
            continue
        columns.append((reference.title, part[f"{reference.prefix}_attempts"], ".2f"))
        columns.append(("SE", part[f"{reference.prefix}_se"], ".2f"))
        if name := difference_from(reference, references):
            columns.append(("Difference", part[name], "+.2f"))
    if part["ideal_attempts"].notna().any():
        columns.append(("Ideal", part["ideal_attempts"], ".2f"))
    frame = pd.concat([pd.Series(values, part.index) for _, values, _ in columns], axis=1)
    frame.columns = pd.Index([head for head, _, _ in columns])
    starts = (part["condition"] != part["condition"].shift()).to_numpy()
    return Table(
        "every_trial", "Every trial", frame, {head: form for head, _, form in columns if form},
        looks={int(row): "first" for row in np.flatnonzero(starts)}, verbatim=True,
    )  # fmt: skip


_COUNTS = {"Trial": "trial", "Loops": "loops", "n": "subjects"}


_INTERVAL = ("ci_low", "ci_high", "subjects", "mode", "at_mode")


def _interval(*values: Any) -> str:
    return beside_mean(*values) or "–"
