"""The first table of the report and of the terminal: how every learner stands, as texts.

A value that the limit of attempts has cut off is marked: "≥" where it is a lower bound, and "not
within 30" where nothing was solved.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import pandas as pd

from causal_openlock.analysis.results.scores import PEOPLE
from causal_openlock.analysis.results.verdict import records, share

MEANING = (
    "Solved, found: of trials and of solutions. Median: attempts where solved. Score: 0 as at "
    "random, 1 ideal. Then attempts more than the best learner and than people, with 95% intervals; "
    "≥ and *: trials not solved count as the limit."
)
"""What the columns mean, where there is no room for more."""

SHOWN_PEOPLE = "people (published)"

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
    """

    protocol: str
    limit: int
    conditions: int
    heads: tuple[str, ...]
    short_heads: tuple[str, ...]
    rows: Mapping[str, tuple[Cell, ...]]

    @property
    def measured(self) -> str:
        """What is counted, in words."""
        of = f", {self.conditions} conditions together" if self.conditions > 1 else ""
        return f"new rooms, at most {self.limit} attempts each{of}"


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
        yield FirstTable(
            protocol=str(protocol),
            limit=int(rows["limit"].iloc[0]),
            conditions=int(rows["conditions"].max()),
            heads=("Learner", *(column[0] for column in kept.values())),
            short_heads=("", *(column[1] for column in kept.values())),
            rows={
                _name(row["learner"]): tuple(_cell(name, row, cut_off.get(best, False))
                                             for name in kept)
                for row in records(rows)
            },
        )  # fmt: skip


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
        return f"{_short(value)} of {_short(row['solutions'])}", ""
    if column in ("n", "median"):
        return f"{value:g}", ""
    if column == "score":
        return f"{value + 0.0:.2f}".replace("-0.00", "0.00").replace("-", "−"), ""
    cut_off = row["solved"] is not None and row["solved"] < 1
    both = cut_off and column == "to_best" and best_cut_off
    low, high = row[f"{column}_low"], row[f"{column}_high"]
    small = "in every subject" if low is None else f"{_signed(low)} to {_signed(high)}"
    return f"{'≥ ' if cut_off and not both else ''}{_signed(value)}{'*' if both else ''}", small


def _short(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def _signed(value: float) -> str:
    text = f"{value + 0.0:+.2f}" if abs(value) < 10 else f"{value:+,.1f}"
    return "0.00" if text in ("+0.00", "-0.00") else text.replace("-", "−")
