"""All of it in one page: the report of a record.

``report.html`` is a single file: its style, its figures and its tables are inside it, and it
fetches nothing. Beside it lie ``summary.csv`` and the figures as PNG and SVG. Nothing in any of
them depends on when or where the report was written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from causal_openlock.analysis import style
from causal_openlock.analysis.bounds import ideal_bounds
from causal_openlock.analysis.comparable import Pairs, comparable
from causal_openlock.analysis.description import describe, trials_played
from causal_openlock.analysis.figures import draw_all
from causal_openlock.analysis.measures import CELL, attempts_to_solve, ordered
from causal_openlock.analysis.published import did_what_people_did, model, people
from causal_openlock.analysis.style import Drawing
from causal_openlock.analysis.summary import headline, summarise, write_table
from causal_openlock.errors import OpenLockError
from causal_openlock.files import write_text
from causal_openlock.protocol import PAPER_CONDITIONS

if TYPE_CHECKING:
    import pyarrow as pa

FEW_SUBJECTS = 20
"""Groups of fewer subjects than this are warned about."""

FIGURE_NAME = re.compile(r"(baseline|transfer)_(attempts|categories)|attempts_by_trial_\w+")
"""Names of the figures that a report can have, without the ending."""

_SHOWN = 8  # groups named in a warning before "and n more"


def write_report(record: pa.Table, out_dir: Path | str, experiment: Mapping[str, Any]) -> Path:
    """Write the report of a record.

    Args:
        record: Columns as in :func:`causal_openlock.record.record_schema`, rows in any order.
        out_dir: The folder to write ``report.html``, ``summary.csv`` and ``figures/`` to; it is
            made if it does not exist. Figures that an earlier report left there and this one does
            not have are removed; files of other names stay.
        experiment: What was run, as plain data (mappings, lists, text, numbers); best as
            :meth:`causal_openlock.experiment.Experiment.as_dict` gives it. Everything in it is
            shown. ``name``, ``title`` and ``seed`` head the page; ``learners`` (a mapping by
            label, or a list of labels or of mappings with a ``label`` or ``name``) gives the order
            in which learners appear; ``versions`` maps packages to a version, or to a list of them
            if cells were run with several, which is warned about; ``missing_cells`` names what
            an unfinished folder lacks, and the page opens with that. Published results are shown
            beside whoever did what people did; see :mod:`~causal_openlock.analysis.comparable`.

    Returns:
        The path of ``report.html``.

    Raises:
        StoreError: If the record has attempts missing or twice.
        OpenLockError: If a file cannot be written; those that were there stay whole.
    """
    folder = Path(out_dir)
    trials = attempts_to_solve(record)
    learners = ordered(trials["learner"], _labels(experiment.get("learners", ())))
    pairs = comparable(experiment)
    bounds = ideal_bounds(experiment)
    summary = summarise(trials, pairs, bounds)
    write_table(summary, folder / "summary.csv")
    figures = [
        _inline(drawing, style.save(drawing.figure, folder / "figures" / drawing.name))
        for drawing in draw_all(record, learners, experiment)
    ]
    _remove_others(folder / "figures", {figure["name"] for figure in figures})

    described = describe(experiment)
    page = _template().render(
        title=experiment.get("title") or experiment.get("name") or "Report",
        name=experiment.get("name"),
        seed=experiment.get("seed"),
        command=experiment.get("command"),
        attempts=f"{record.num_rows:,}",
        trials=f"{len(trials):,}",
        people_size=style.sizes(people()),
        model_size=style.sizes(model()),
        missing=[str(name) for name in experiment.get("missing_cells") or ()],
        headline=_headline_blocks(
            headline(trials, pairs, bounds), learners, described["protocols"]
        ),
        figures=figures,
        summary=_summary_blocks(summary, learners),
        described=described if experiment else None,
        played=trials_played(trials),
        warnings=warnings_of(trials, summary, experiment.get("versions") or {}, pairs),
    )
    path = folder / "report.html"
    write_text(path, page)
    return path


def _remove_others(folder: Path, names: Collection[str]) -> None:
    """Remove figures of ours that this report does not have, and nothing else."""
    try:
        for path in folder.glob("*.*"):
            ours = path.suffix in (".png", ".svg") and FIGURE_NAME.fullmatch(path.stem)
            if ours and path.stem not in names:
                path.unlink()
    except OSError as error:
        raise OpenLockError(
            f"{folder}: the figures of an earlier report cannot be removed ({error.strerror}); "
            "remove them, or choose another folder"
        ) from None


def warnings_of(
    trials: pd.DataFrame,
    summary: pd.DataFrame,
    versions: Mapping[str, Any],
    pairs: Pairs | None = None,
) -> list[str]:
    """What a reader should know before believing the numbers, a sentence each.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        summary: From :func:`~causal_openlock.analysis.summary.summarise`.
        versions: Versions of packages; a list where cells were run with several.
        pairs: Whom people compare with; None if names decide.
    """
    found = []
    named = summary[did_what_people_did(summary) & summary["condition"].isin(PAPER_CONDITIONS)]
    others = named.loc[~did_what_people_did(named, pairs), CELL].drop_duplicates()
    if len(others):
        names = [_group(key) for key in others.itertuples(index=False)]
        found.append(
            "Some conditions are called like the paper's and have other rooms, trials or budgets, "
            f"so published results are not shown beside them ({_some(names)})."
        )
    grouped = summary.groupby(CELL, observed=True)["subjects"]
    who = ["learner", "protocol"]
    least = summary.groupby(who, observed=True)["subjects"].min().sort_values(kind="stable")
    few = least[least < FEW_SUBJECTS]
    if len(few):
        names = [f"{_group(key)}: {count}" for key, count in few.items()]
        found.append(
            f"Fewer than {FEW_SUBJECTS} subjects, so intervals are unreliable ({_some(names)})."
        )
    uneven = grouped.min()[grouped.min() != grouped.max()]
    if len(uneven):
        names = [_group(key) for key in uneven.index]
        found.append(
            "Not every subject played every trial, so means of different trials are about "
            f"different subjects ({_some(names)})."
        )
    solved = trials.groupby(who, observed=True)["solved"].mean().sort_values(kind="stable")
    if len(unsolved := solved[solved < 1]):
        names = [f"{_group(key)}: {_percent(1 - share)}" for key, share in unsolved.items()]
        found.append(
            "Some trials were not solved, so means there are lower than what solving them would "
            f"have taken (share of trials not solved: {_some(names)})."
        )
    for package, version in versions.items():
        several = _several(version)
        if len(several) > 1:
            found.append(
                f"Cells were run with different versions of {package} ({', '.join(several)})."
            )
    return found


def _several(version: Any) -> list[str]:
    if isinstance(version, str) or not isinstance(version, Iterable):
        return [str(version)]
    return sorted({str(one) for one in version})


def _group(key: Any) -> str:
    """``ddqn, CC4 (human)``: a learner, perhaps a condition, and a protocol."""
    *names, protocol = map(str, key)
    return f"{', '.join(names)} ({protocol})"


def _some(names: Sequence[str]) -> str:
    more = len(names) - _SHOWN
    shown = "; ".join(names[:_SHOWN])
    return f"{shown}; and {more} more" if more > 0 else shown


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


def _inline(drawing: Drawing, svg: str) -> dict[str, Any]:
    """A figure for inside the page: sized by it, and with names of its own."""
    from markupsafe import Markup, escape

    svg = re.sub(r"<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{drawing.name}-', svg)
    svg = re.sub(r'((?:xlink:)?href="|url\()#', rf"\1#{drawing.name}-", svg)
    box = re.search(r'viewBox="0 0 ([\d.]+) [\d.]+"', svg)
    assert box is not None
    wide = float(box[1]) / 12
    root = (
        f'<svg {box[0]} role="img" aria-label="{escape(drawing.title)}" '
        f'style="min-width: {min(wide, 34):.1f}rem; max-width: {wide:.1f}rem">'
    )
    return {
        "name": drawing.name,
        "title": drawing.title,
        "caption": drawing.caption,
        "svg": Markup(root + svg[svg.index(">") + 1 :]),  # matplotlib has escaped its text
    }


def _template() -> Any:
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("causal_openlock.analysis", "."),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        decimals=_decimals,
        signed=_signed,
        percent=_percent,
        interval=_interval,
        plain=_plain,
        some=_some,
    )
    return environment.get_template("report.html.j2")


def _decimals(value: float) -> str:
    return f"{value + 0.0:.2f}"


def _signed(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}".replace("-", "−")


def _percent(share: float) -> str:
    if 0 < share < 0.0005 or 0.9995 < share < 1:  # some is not none, and not all
        return "<0.1%" if share < 0.5 else ">99.9%"
    return f"{100 * share:.1f}%"


def _interval(row: Mapping[str, Any]) -> str:
    """The interval, or nothing where subjects do not differ or there is only one."""
    if row["ci_low"] is None or row["ci_low"] == row["ci_high"]:
        return ""
    return f"{_decimals(row['ci_low'])}–{_decimals(row['ci_high'])}"


def _plain(values: Iterable[Any]) -> bool:
    return all(value is None or isinstance(value, str | int | float) for value in values)


__all__ = ["FEW_SUBJECTS", "warnings_of", "write_report"]
