"""The first table of the report and of the terminal: how every learner stands, as texts.

A value that the limit of attempts has cut off is marked: "≥" where it is a lower bound, and "not
within 30" where nothing was solved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from causal_openlock.analysis.report.section import printed
from causal_openlock.analysis.results.scores import PEOPLE
from causal_openlock.analysis.results.verdict import records, share

MEANING = (
    "Solved: share of trials. Found: solutions, of those to be found. Median: attempts where "
    "solved. Score: 0 as at random, 1 ideal. Then attempts more than the best learner and than "
    "people, with 95% intervals ([all]: the same in every subject); unsolved trials count as the "
    "limit, so that ≥ marks a lower bound and * a value that may be off either way."
)
"""What the columns of the narrow table mean."""

SHOWN_PEOPLE = "people"

Cell = tuple[str, str]
"""A value, and its interval or what else stands beside it in small type."""


@dataclass(frozen=True)
class FirstTable:
    """The standing of every learner under a protocol.

    Attributes:
        protocol: Its name.
        limit: The most attempts of a trial.
        conditions: How many were played.
        heads: Over the columns, in words; the first is over the names.
        short_heads: The same for a narrow table.
        rows: By learner, what is in the other columns; :data:`SHOWN_PEOPLE` stand first.
        short_rows: The same for a narrow table, a text each.
    """

    protocol: str
    limit: int
    conditions: int
    heads: tuple[str, ...]
    short_heads: tuple[str, ...]
    rows: Mapping[str, tuple[Cell, ...]]
    short_rows: Mapping[str, tuple[str, ...]]

    @property
    def measured(self) -> str:
        """What is counted, in words."""
        of = f", {self.conditions} conditions together" if self.conditions > 1 else ""
        return f"at most {self.limit} attempts in a room{of}"


def first_tables(standings: pd.DataFrame) -> Iterator[FirstTable]:
    """A table for each protocol.

    Args:
        standings: From :func:`~causal_openlock.analysis.results.standing.standings`.
    """
    for protocol, rows in standings.groupby("protocol", sort=False):
        best = next((name for name in rows["best"] if isinstance(name, str)), None)
        own = rows[rows["learner"] != PEOPLE]
        columns = {
            "n": ("n", "n", True),
            "solved": ("Trials solved", "solved", True),
            "found": ("Solutions found", "found", True),
            "median": ("Attempts where solved (median)", "median", True),
            "score": ("Score, 0 random to 1 ideal", "score", bool(rows["score"].notna().any())),
            "to_best": (f"Attempts more than {best}, the best", f"− {best}", best is not None),
            "to_people": (
                "Attempts more than people", "− people", bool(own["to_people"].notna().any())
            ),
        }  # fmt: skip
        kept = {name: column for name, column in columns.items() if column[2]}
        cut_off = {row["learner"]: (row["solved"] or 1) < 1 for row in records(rows)}
        asked = [
            (_name(row["learner"]), [(name, row, cut_off.get(best, False)) for name in kept])
            for row in records(rows)
        ]
        yield FirstTable(
            protocol=str(protocol),
            limit=int(rows["limit"].iloc[0]),
            conditions=int(rows["conditions"].max()),
            heads=("Learner", *(column[0] for column in kept.values())),
            short_heads=("", *(column[1] for column in kept.values())),
            rows={name: tuple(_cell(*one) for one in cells) for name, cells in asked},
            short_rows={name: tuple(_short_cell(*one) for one in cells) for name, cells in asked},
        )


def _name(learner: str) -> str:
    return SHOWN_PEOPLE if learner == PEOPLE else str(learner)


def _cell(column: str, row: Mapping[str, Any], best_cut_off: bool) -> Cell:
    value = row["subjects" if column == "n" else column]
    if column == "median" and row["solved"] is not None and value is None:
        return f"not within {row['limit']}", ""
    if value is None:
        return ("best", "") if column == "to_best" and row["learner"] == row["best"] else ("–", "")
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
    small = (
        "in every subject"
        if low is None
        else f"{printed(float(low), '+.2f')} to {printed(float(high), '+.2f')}"
    )
    return f"{before}{printed(float(value), '+.2f')}{after}", small


def _short_cell(column: str, row: Mapping[str, Any], best_cut_off: bool) -> str:
    main, small = _cell(column, row, best_cut_off)
    if not small:
        return main.replace("not within ", "> ")
    low, value, high = row[f"{column}_low"], row[column], row[f"{column}_high"]
    before, after = _marks(column, row, best_cut_off)
    interval = "all" if low is None else f"{_narrow(low)}, {_narrow(high)}"
    return f"{before}{_narrow(value)}{after} [{interval}]"


def _marks(column: str, row: Mapping[str, Any], best_cut_off: bool) -> tuple[str, str]:
    """What is before and after a difference that the limit of attempts has cut off."""
    if row["solved"] is None or row["solved"] == 1:
        return "", ""
    return ("", "*") if column == "to_best" and best_cut_off else ("≥ ", "")


def _narrow(value: float) -> str:
    return printed(float(value), ".2f" if abs(value) < 10 else ".1f")


def _plain(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")
