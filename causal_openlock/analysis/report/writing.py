"""All of it in one page: the report of a record.

``report.html`` is a single file: its style, its figures and its tables are inside it, and it
fetches nothing. Beside it lie ``summary.csv``, the figures as PNG, SVG and PDF (``figures/``) and
the tables of its sections as CSV and LaTeX (``tables/``). Nothing in any of them depends on when or
where the report was written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.figures import draw_counted
from causal_openlock.analysis.report.cautions import warnings_of
from causal_openlock.analysis.report.page import Written, render
from causal_openlock.analysis.report.section import Material
from causal_openlock.analysis.report.section_registry import PROVIDERS, sections_of
from causal_openlock.analysis.report.sections.missing import missing_cells, with_missing
from causal_openlock.analysis.report.sections.per_learner import learner_pages
from causal_openlock.analysis.results.bounds import ideal_bounds
from causal_openlock.analysis.results.counting import count
from causal_openlock.analysis.results.description import describe, trials_played
from causal_openlock.analysis.results.people.comparable import Pairs, comparable
from causal_openlock.analysis.results.people.published import did_what_people_did, model, people
from causal_openlock.analysis.results.summary import headline, summarise, write_table
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_text
from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pyarrow as pa

_FILES = re.compile(r'<meta name="files" content="([^"]*)">')
_FILE = re.compile(r"figures/\w[\w.-]*\.(png|svg|pdf)|tables/\w[\w.-]*\.(csv|tex)", re.ASCII)


@dataclass(frozen=True)
class Report:
    """A report that is written.

    Attributes:
        path: The path of ``report.html``.
        headline: What it opens with, from
            :func:`~causal_openlock.analysis.results.summary.headline`.
    """

    path: Path
    headline: pd.DataFrame


def write_report(
    record: pa.Table,
    out_dir: Path | str,
    experiment: Mapping[str, Any],
    providers: Sequence[str] = PROVIDERS,
) -> Path:
    """Write the report of a record.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        out_dir: The folder to write ``report.html``, ``summary.csv``, ``figures/`` and ``tables/``
            to; it is made if it does not exist. Figures and tables of an earlier report that this
            one does not have are removed; other files stay.
        experiment: What was run, as plain data (mappings, lists, text, numbers); best as
            :meth:`causal_openlock.experiment.experiment.Experiment.as_dict` gives it. Everything in
            it is shown. ``name``, ``title`` and ``seed`` head the page; ``learners`` (a mapping by
            label, or a list of labels or of mappings with a ``label`` or ``name``) gives the order
            in which learners appear; ``versions`` maps packages to a version, or to a list of them
            if cells were run with several, which is warned about; ``missing_cells`` names what an
            unfinished folder lacks, ``failures`` why, and the page opens with that. Published
            results are shown beside whoever did what people did; see
            :mod:`~causal_openlock.analysis.results.people.comparable`.
        providers: What makes its sections; see
            :mod:`~causal_openlock.analysis.report.section_registry`.

    Returns:
        The path of ``report.html``.

    Raises:
        StoreError: If the record has attempts missing or twice.
        OpenLockError: If a file cannot be written; those that were there stay whole.
    """
    return make_report(record, out_dir, experiment, providers).path


def make_report(
    record: pa.Table,
    out_dir: Path | str,
    experiment: Mapping[str, Any],
    providers: Sequence[str] = PROVIDERS,
) -> Report:
    """Write the report of a record, as :func:`write_report` does, and tell what it opens with."""
    folder = Path(out_dir)
    counts = count(record)
    trials = counts.trials
    learners = ordered(trials["learner"], _labels(experiment.get("learners", ())))
    pairs = comparable(experiment)
    bounds = ideal_bounds(experiment)
    described = describe(experiment)
    summary = summarise(trials, pairs, bounds)
    heads = headline(trials, pairs, bounds)
    compared = _by_name(trials) if pairs is None else pairs
    material = Material(record, experiment, trials, learners, compared, bounds)
    path = folder / "report.html"
    earlier = files_of(path)
    written = Written(folder)

    missing = missing_cells(experiment)
    write_table(with_missing(summary, missing), folder / "summary.csv")
    figures = [written.drawing(one) for one in draw_counted(counts, learners, experiment)]
    sections = [written.section(one) for one in sections_of(material, providers)]
    pages = [
        written.section(one)
        for one in learner_pages(trials, heads, learners, described["learners"])
    ]
    page = render(
        "report.html.j2",
        title=experiment.get("title") or experiment.get("name") or "Report",
        name=experiment.get("name"),
        seed=experiment.get("seed"),
        command=experiment.get("command"),
        attempts=counted(record.num_rows, "attempt"),
        trials=counted(len(trials), "trial"),
        people_size=style.sizes(people()),
        model_size=style.sizes(model()),
        missing=[one.told for one in missing],
        failed=sum(one.failed for one in missing),
        headline=_headline_blocks(heads, learners, described["protocols"]),
        figures=figures,
        sections=sections,
        learners=pages,
        summary=_summary_blocks(summary, learners),
        described=described if experiment else None,
        played=trials_played(trials),
        warnings=warnings_of(trials, summary, experiment.get("versions") or {}, pairs),
        files=written.files,
    )
    write_text(path, page)
    _remove(folder, earlier - set(written.files))
    return Report(path, heads)


def _by_name(trials: pd.DataFrame) -> Pairs:
    """Who compares with people where nothing but names tells: whoever played as they did."""
    played = trials.loc[did_what_people_did(trials), ["learner", "condition"]].drop_duplicates()
    return frozenset((str(who), str(what)) for who, what in played.itertuples(index=False))


def files_of(path: Path) -> set[str]:
    """The figures and tables that belong to a report that is there already."""
    with suppress(OSError, ValueError), path.open(encoding="utf-8") as page:
        if told := _FILES.search(page.read(100_000)):
            return {name for name in told[1].split() if _FILE.fullmatch(name)}
    return set()


def _remove(folder: Path, files: Collection[str]) -> None:
    """Remove files of an earlier report."""
    try:
        for name in files:
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise OpenLockError(
            f"{folder}: the figures of an earlier report cannot be removed ({error.strerror}); "
            "remove them, or choose another folder"
        ) from None


def _labels(learners: Any) -> list[str]:
    """Labels of learners in the order in which the experiment lists them."""
    return [
        str(one.get("label", one.get("name"))) if isinstance(one, Mapping) else str(one)
        for one in learners
    ]


def _headline_blocks(
    table: pd.DataFrame, learners: Sequence[str], budgets: Mapping[str, str]
) -> list[dict[str, Any]]:
    """The headline by protocol: a row for each learner, a column for each condition."""
    blocks = []
    for protocol in ordered(table["protocol"], ("human",)):
        rows = table[table["protocol"] == protocol]
        cells = {(str(cell["learner"]), str(cell["condition"])): cell for cell in _records(rows)}
        conditions = ordered(rows["condition"])
        columns = [
            {
                "condition": condition,
                "measured": " or ".join(
                    dict.fromkeys(rows.loc[rows["condition"] == condition, "measured"])
                ),
            }
            for condition in conditions
        ]
        compared, ideal = [], []
        for condition in conditions:
            of = [cell for (_, name), cell in cells.items() if name == condition]
            same = len({(cell["measured"], cell["human_attempts"]) for cell in of}) == 1
            compared.append(of[0] if same and of[0]["human_attempts"] else None)
            bounds = {cell["ideal_attempts"] for cell in of}
            ideal.append(bounds.pop() if len(bounds) == 1 else None)
        blocks.append(
            {
                "protocol": protocol,
                "budgets": budgets.get(protocol),
                "columns": columns,
                "published": compared if any(compared) else None,
                "ideal": ideal if any(ideal) else None,
                "rows": [
                    {
                        "learner": name,
                        "size": style.sizes(rows[rows["learner"] == name]),
                        "cells": [cells.get((name, of)) for of in conditions],
                    }
                    for name in learners
                    if any((name, of) in cells for of in conditions)
                ],
            }
        )
    return blocks


def _summary_blocks(summary: pd.DataFrame, learners: Sequence[str]) -> list[dict[str, Any]]:
    """The summary by learner and protocol; ``starts`` marks a row where a condition begins."""
    blocks = []
    for learner in learners:
        own = summary[summary["learner"] == learner]
        for protocol in ordered(own["protocol"], ("human",)):
            part = own[own["protocol"] == protocol]
            rows = _records(part)
            before: Any = None
            for row in rows:
                row["starts"], before = row["condition"] != before, row["condition"]
            blocks.append(
                {
                    "learner": learner,
                    "protocol": protocol,
                    "size": style.sizes(part),
                    "compared": bool(part["human_attempts"].notna().any()),
                    "bounded": bool(part["ideal_attempts"].notna().any()),
                    "rows": rows,
                }
            )
    return blocks


def _records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as mappings, with None for what does not exist."""
    return [
        {
            str(name): None if isinstance(value, float) and math.isnan(value) else value
            for name, value in row.items()
        }
        for row in table.to_dict("records")
    ]
