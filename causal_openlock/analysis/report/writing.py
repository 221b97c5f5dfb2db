"""The report of a record: counts become sections, sections become a page and files beside it.

``report.html`` is a single file: its style, its figures and its tables are inside it, and it
fetches nothing. Beside it lie ``summary.csv``, the figures as PNG, SVG and PDF (``figures/``) and
the tables of its sections as CSV and LaTeX (``tables/``). Nothing in any of them depends on when or
where the report was written.
"""

from __future__ import annotations

import re
import webbrowser
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.report.cautions import warnings_of
from causal_openlock.analysis.report.first_screen import answers, first_tables, legend
from causal_openlock.analysis.report.learner_pages import learner_pages
from causal_openlock.analysis.report.missing import missing_cells, with_missing
from causal_openlock.analysis.report.page import Written, render
from causal_openlock.analysis.report.sections import ORDER, decisions_of, sections_of
from causal_openlock.analysis.report.what_was_run import trials_played, what_was_run
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.people.published import model, people
from causal_openlock.analysis.results.standing import standings
from causal_openlock.analysis.results.summary import write_table
from causal_openlock.analysis.results.verdict import in_cell, records, verdict_tables
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_text
from causal_openlock.storage.stored import StoredExperiment

if TYPE_CHECKING:
    import pyarrow as pa

_FILES = re.compile(r'<meta name="files" content="([^"]*)">')
_FILE = re.compile(r"figures/\w[\w.-]*\.(png|svg|pdf)|tables/\w[\w.-]*\.(csv|tex)", re.ASCII)


@dataclass(frozen=True)
class Report:
    """A report that is written; a notebook shows its page.

    Attributes:
        path: Its page, ``report.html``.
        answers: The sentences that it opens with, by protocol.
        standings: Its first table, from
            :func:`~causal_openlock.analysis.results.standing.standings`.
    """

    path: Path
    answers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    standings: pd.DataFrame = field(default_factory=pd.DataFrame, repr=False, compare=False)

    def open(self) -> None:
        """Open the page in a browser."""
        webbrowser.open(self.path.resolve().as_uri())


def write_report(
    record: pa.Table,
    out_dir: Path | str,
    experiment: StoredExperiment,
    sections: Sequence[str] = ORDER,
) -> Path:
    """Write the report of a record.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        out_dir: The folder to write ``report.html``, ``summary.csv``, ``figures/`` and ``tables/``
            to; it is made if it does not exist. Figures and tables of an earlier report that this
            one does not have are removed; other files stay.
        experiment: What was run, as :meth:`causal_openlock.storage.store.Store.record` gives it
            beside the record. Learners appear in its order; the page opens with the cells that are
            missing. Published results are shown beside learners that did what people did; see
            :mod:`~causal_openlock.analysis.results.people.published`.
        sections: The modules that make its sections; see
            :mod:`~causal_openlock.analysis.report.sections`.

    Returns:
        The path of ``report.html``.

    Raises:
        StoreError: If the record has attempts missing or twice.
        OpenLockError: If a file cannot be written; those that were there stay whole.
    """
    return make_report(Material.of(record, experiment), out_dir, sections).path


def make_report(material: Material, out_dir: Path | str, sections: Sequence[str] = ORDER) -> Report:
    """Write a report as :func:`write_report` does, of what is counted already."""
    folder = Path(out_dir)
    path = folder / "report.html"
    earlier = files_of(path)
    experiment = material.experiment
    trials, learners, summary = material.counts.trials, material.learners, material.summary
    missing = missing_cells(experiment)
    described = what_was_run(experiment)

    write_table(with_missing(summary, missing), folder / "summary.csv")
    written = Written(folder)
    plots, pages = figures_of(material), learner_pages(material, described["learners"])
    stand = standings(material)
    decisions = decisions_of(material, sections, stand)
    write_table(stand, folder / "tables" / "standings.csv")
    written.files.append("tables/standings.csv")
    first, opening = list(first_tables(stand)), answers(stand, decisions)
    page = render(
        "report.html.j2",
        title=experiment.title or experiment.name,
        experiment=experiment,
        attempts=material.record.num_rows,
        trials=len(trials),
        people_size=style.sizes(people()),
        model_size=style.sizes(model()),
        missing=[cell.text for cell in missing],
        failed=sum(cell.failed for cell in missing),
        first=first,
        answers=opening,
        legends={table.protocol: legend([table]) for table in first},
        headline={one.protocol: one for one in verdict_tables(material.headline, learners)},
        in_cell=in_cell,
        sizes={
            key: style.sizes(rows)
            for key, rows in material.headline.groupby(["protocol", "learner"], observed=True)
        },
        figures=[written.plot(plot) for plot in plots],
        sections=[written.section(one) for one in sections_of(material, sections, decisions)],
        tests=decisions.total,
        alpha=ALPHA,
        learners=[written.section(one) for one in pages],
        summary=_summary_blocks(summary, learners),
        described=described,
        played=trials_played(trials),
        warnings=warnings_of(trials, summary, experiment.versions, material.like_people),
        files=written.files,
    )
    write_text(path, page)
    _remove(folder, earlier - set(written.files))
    return Report(path, opening, stand)


def files_of(path: Path) -> set[str]:
    """The figures and tables that belong to a report that is there already."""
    with suppress(OSError, ValueError), path.open(encoding="utf-8") as page:
        if listed := _FILES.search(page.read(100_000)):
            return {name for name in listed[1].split() if _FILE.fullmatch(name)}
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


def _summary_blocks(summary: pd.DataFrame, learners: Sequence[str]) -> list[dict[str, Any]]:
    """The summary by learner and protocol; ``starts`` marks a row where a condition begins."""
    starts = summary["condition"] != summary["condition"].shift()
    blocks = []
    for learner in learners:
        own = summary.assign(starts=starts)[summary["learner"] == learner]
        for protocol, part in own.groupby("protocol", observed=True):
            blocks.append(
                {
                    "learner": learner,
                    "protocol": protocol,
                    "size": style.sizes(part),
                    "compared": bool(part["human_attempts"].notna().any()),
                    "bounded": bool(part["ideal_attempts"].notna().any()),
                    "rows": records(part),
                }
            )
    return blocks
