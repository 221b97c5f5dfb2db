"""The first answer of the report and of the terminal: how every learner stands, as texts.

A few sentences answer first, of the best learner that is given neither the schema nor the room.
The table below them has people and the learners that are given these apart, as references.
A value that the limit of attempts has cut off is marked: "≥" where it is a lower bound, and "not
within 30" where nothing was solved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from causal_openlock.analysis.report.cautions import FEW_SUBJECTS
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import printed
from causal_openlock.analysis.results.decisions import Decisions
from causal_openlock.analysis.results.scores import PEOPLE
from causal_openlock.analysis.results.verdict import number, records, share
from causal_openlock.wording import counted

SHOWN_PEOPLE = "people"

Cell = tuple[str, str]
"""A value, and its interval or what else stands beside it in small type."""

_PROSE = Prose("first_screen")
_NARROW = ("attempts", "to_people", "to_best", "score", "solved", "found", "n")
"""The columns of the narrow table."""


@dataclass(frozen=True)
class FirstTable:
    """The standing of every learner under a protocol.

    Attributes:
        protocol: Its name.
        limit: The most attempts of a trial.
        conditions: How many were played.
        best: The best learner that is given neither the schema nor the room; None where there is
            none.
        references: Names of the rows that are no competitors: people, and learners that are given
            the schema or the room. They stand first.
        marks: Which marks its values have: ``≥``, ``≤``, ``*`` and ``all``.
        few: Warns of few subjects; empty where there are enough.
        uneven: Whether rows are of different numbers of conditions.
        columns: What the columns are, those on the left mattering most.
        heads: Over the columns, in words; the first is over the names.
        short_heads: The same for a narrow table.
        rows: By learner, what is in the other columns; :data:`SHOWN_PEOPLE` stand first.
        short_rows: The same for a narrow table, a text each.
        above: Whether a score is shown as above 1, that of the ideal observer.
    """

    protocol: str
    limit: int
    conditions: int
    best: str | None
    references: tuple[str, ...]
    few: str
    uneven: bool
    columns: tuple[str, ...]
    heads: tuple[str, ...]
    short_heads: tuple[str, ...]
    rows: Mapping[str, tuple[Cell, ...]]
    short_rows: Mapping[str, tuple[str, ...]]
    marks: frozenset[str]
    above: bool

    @property
    def measured(self) -> str:
        """What is counted, in words."""
        of = f", {self.conditions} conditions together" if self.conditions > 1 else ""
        of += " at most: each row is of those that it has" * self.uneven
        return f"at most {counted(self.limit, 'attempt')} in a room{of}"


def first_tables(standings: pd.DataFrame) -> Iterator[FirstTable]:
    """A table for each protocol.

    Args:
        standings: From :func:`~causal_openlock.analysis.results.standing.standings`.
    """
    for protocol, rows in standings.groupby("protocol", sort=False):
        best = next((name for name in rows["best"] if isinstance(name, str)), None)
        own = rows[rows["learner"] != PEOPLE]
        columns = {
            "attempts": ("Attempts (mean)", "attempts", True),
            "to_people": (
                "Attempts more than people", "− people", bool(own["to_people"].notna().any())
            ),
            "to_best": (f"Attempts more than {best}", f"− {best}", best is not None),
            "score": ("Score, 0 random to 1 ideal", "score", bool(rows["score"].notna().any())),
            "solved": ("Trials solved", "solved", True),
            "found": ("Solutions found", "found", True),
            "median": ("Attempts where solved (median)", "median", True),
            "n": ("n", "n", True),
        }  # fmt: skip
        kept = {name: column for name, column in columns.items() if column[2]}
        narrow = [name for name in _NARROW if name in kept]
        # References come first, people before all others; the rest stay in their order.
        given = {row["learner"]: bool(row["informed"]) for row in records(rows)}
        asked = sorted(
            records(rows), key=lambda row: (row["learner"] != PEOPLE, not given[row["learner"]])
        )
        cut_off = {row["learner"]: (row["solved"] or 1) < 1 for row in asked}
        beside = cut_off.get(best, False)
        wide = {
            _name(row["learner"]): tuple(_cell(name, row, beside) for name in kept) for row in asked
        }
        yield FirstTable(
            protocol=str(protocol),
            limit=int(rows["limit"].iloc[0]),
            conditions=int(rows["conditions"].max()),
            best=best,
            references=tuple(
                _name(row["learner"])
                for row in asked
                if row["learner"] == PEOPLE or given[row["learner"]]
            ),
            few=_few(own),
            uneven=rows["conditions"].nunique() > 1,
            columns=tuple(kept),
            heads=("Learner", *(column[0] for column in kept.values())),
            short_heads=("", *(kept[name][1] for name in narrow)),
            rows=wide,
            short_rows={
                _name(row["learner"]): tuple(_short_cell(name, row, beside) for name in narrow)
                for row in asked
            },
            marks=frozenset(
                mark
                for mark, text in (("≥", "≥"), ("≤", "≤"), ("*", "*"), ("all", "in every subject"))
                if any(text in part for cells in wide.values() for cell in cells for part in cell)
            ),
            above=bool((rows["score"].astype(float).round(2) > 1).any()),
        )


def legend(tables: Sequence[FirstTable], narrow: bool = False) -> str:
    """What the columns and marks of tables mean, of those that occur.

    Args:
        tables: From :func:`first_tables`.
        narrow: Whether it is below the narrow tables, whose heads are shorter.
    """
    return _PROSE.sentence(
        "legend",
        narrow=narrow,
        columns={name for table in tables for name in table.columns},
        marks=frozenset().union(*(table.marks for table in tables)),
        given=any(set(table.references) - {SHOWN_PEOPLE} for table in tables),
        above=any(table.above for table in tables),
    )


def answers(standings: pd.DataFrame, decisions: Decisions) -> dict[str, tuple[str, ...]]:
    """What was found, in a few sentences, by protocol.

    Which learner needs the fewest attempts and how that compares with people, which ones cannot be
    distinguished from it, and which solved no trial that counts.

    Args:
        standings: From :func:`~causal_openlock.analysis.results.standing.standings`.
        decisions: From :func:`~causal_openlock.analysis.report.sections.decisions_of`.
    """
    found = {}
    for protocol, rows in standings.groupby("protocol", sort=False):
        own = {row["learner"]: row for row in records(rows) if row["learner"] != PEOPLE}
        best = next((name for name in rows["best"] if isinstance(name, str)), None)
        alike = [name for name in own if best and _alike(decisions, str(protocol), best, name)]
        tested = best is not None and decisions.has("standing", (protocol, best))
        found[str(protocol)] = _PROSE.paragraphs(
            "answer",
            best=own.get(best),
            several=sum(not row["informed"] for row in own.values()) > 1,
            people=tested,
            found=tested and decisions.found("standing", (protocol, best)),
            alike=alike,
            unsolved=[name for name, row in own.items() if row["solved"] == 0],
        )
    return found


def _alike(decisions: Decisions, protocol: str, best: str, other: str) -> bool:
    """Whether a learner was compared with the best and no difference was found."""
    keys = ((protocol, best, other), (protocol, other, best))
    tested = [key for key in keys if decisions.has("pairwise", key)]
    return any(not decisions.found("pairwise", key) for key in tested)


def _few(rows: pd.DataFrame) -> str:
    few = {row["learner"]: row["subjects"] for row in records(rows)}
    few = {name: size for name, size in few.items() if size < FEW_SUBJECTS}
    sizes = set(few.values())
    return _PROSE.sentence(
        "few", few=few, all=len(few) == len(rows), sizes=sorted(sizes), least=FEW_SUBJECTS
    )


def _name(learner: str) -> str:
    return SHOWN_PEOPLE if learner == PEOPLE else str(learner)


def _cell(column: str, row: Mapping[str, Any], best_cut_off: bool) -> Cell:
    value = row["subjects" if column == "n" else column]
    if column == "attempts" and None not in (row["solved"], value):
        if row["solved"] == 0:
            return f"> {row['limit']}", ""
        return ("≥ " if row["solved"] < 1 else "") + number(value), ""
    if column == "median" and row["solved"] is not None and value is None:
        return f"not within {row['limit']}", ""
    if value is None:
        return ("best", "") if column == "to_best" and row["learner"] == row["best"] else ("–", "")
    if column == "attempts":
        return number(value), ""
    if column == "solved":
        return share(value), ""
    if column == "found":
        return f"{_plain(value)} of {_plain(row['solutions'])}", ""
    if column in ("n", "median"):
        return f"{value:g}", ""
    if column == "score":
        return printed(float(value), ".2f"), ""
    low, high = row[f"{column}_low"], row[f"{column}_high"]
    before, after = _marks(column, row, best_cut_off)
    small = _without_interval(column, row)
    if low is not None:
        small = f"{printed(float(low), '+.2f')} to {printed(float(high), '+.2f')}"
    return f"{before}{printed(float(value), '+.2f')}{after}", small


_EVERY = "in every subject"
_EVERY_OF_A_CONDITION = "the same in every subject of a condition"


def _without_interval(column: str, row: Mapping[str, Any]) -> str:
    """Why there is no interval: too few subjects, or all of them differ by the same."""
    if column != "to_best" or row["subjects"] < 2:
        return "no interval"
    return _EVERY if row["conditions"] == 1 else _EVERY_OF_A_CONDITION


def _short_cell(column: str, row: Mapping[str, Any], best_cut_off: bool) -> str:
    main, small = _cell(column, row, best_cut_off)
    if not small:
        return main.replace("not within ", "> ")
    low, value, high = row[f"{column}_low"], row[column], row[f"{column}_high"]
    before, after = _marks(column, row, best_cut_off)
    interval = "all" if small in (_EVERY, _EVERY_OF_A_CONDITION) else "–"
    if low is not None:
        interval = f"{_narrow(low)}, {_narrow(high)}"
    return f"{before}{_narrow(value)}{after} [{interval}]"


def _marks(column: str, row: Mapping[str, Any], best_cut_off: bool) -> tuple[str, str]:
    """What is before and after a difference that the limit of attempts has cut off."""
    if row["solved"] is None or row["solved"] == 1:
        return ("≤ " if column == "to_best" and best_cut_off else ""), ""
    return ("", "*") if column == "to_best" and best_cut_off else ("≥ ", "")


def _narrow(value: float) -> str:
    return printed(float(value), ".2f" if abs(value) < 10 else ".1f")


def _plain(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")
