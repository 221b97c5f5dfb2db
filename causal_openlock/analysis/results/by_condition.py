"""Attempts by condition: a row for each learner, a column for each condition.

References such as people, and the ideal observer, have rows of their own above the learners, where
the learners played what these are known for. A mean that unsolved trials are in is a lower bound,
since they count as the limit, and is marked as that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.references import Beside, Reference
from causal_openlock.analysis.statistics import beside_mean
from causal_openlock.analysis.table import Table, number, share
from causal_openlock.experiment.declare import PAPER_CONDITIONS

Row = Mapping[str, Any]
"""A row of :func:`~causal_openlock.analysis.results.summary.headline`; None: no value."""

Known = tuple[float, float | None, float]
"""Values of a reference: its mean, the standard error, and the share of trials solved."""


@dataclass(frozen=True)
class ConditionTable:
    """The results of one protocol.

    Attributes:
        protocol: Its name.
        columns: The conditions, and what each was judged by, such as ``trial 5`` or ``test``.
        references: By reference that is comparable with a learner, by column, its mean
            attempts, their standard error or None, and the share of trials that are solved; None
            where it does not.
        ideal: By column, attempts of the ideal observer, or None; empty if none are known.
        rows: By learner, by column, its row or None; people come first.
        people: Who of them are people that the others are compared with.
    """

    protocol: str
    columns: tuple[tuple[str, str], ...]
    references: Mapping[Reference, tuple[Known | None, ...]]
    ideal: tuple[float | None, ...]
    rows: Mapping[str, tuple[Row | None, ...]]
    people: tuple[str, ...] = ()

    @property
    def beside(self) -> dict[str, tuple[float | None, ...]]:
        """Attempts of references and of the ideal observer, where known."""
        found: dict[str, tuple[float | None, ...]] = {
            one.name: tuple(None if cell is None else cell[0] for cell in cells)
            for one, cells in self.references.items()
        }
        return {**found, "ideal observer": self.ideal} if self.ideal else found

    def table(
        self, sizes: Mapping[tuple[str, str], str], details: Mapping[Reference, str]
    ) -> Table:
        """Return it as it is shown, references and the ideal observer above the learners.

        Args:
            sizes: By protocol and learner, how many subjects it is of, in words.
            details: What references are, in words.
        """
        rows: list[list[str]] = []
        looks: dict[int, str] = {}
        for one, cells in self.references.items():
            looks[len(rows)] = "published"
            rows.append([f"{one.title}\n{details[one]}", *map(_of_reference, cells)])
        if self.ideal:
            looks[len(rows)] = "ideal"
            least = ["–" if attempts is None else f"{attempts:.2f}" for attempts in self.ideal]
            rows.append(["Ideal observer\nschema known", *least])
        for learner, own in self.rows.items():
            if learner in self.people:
                looks[len(rows)] = "published"
            texts = ["\n".join(in_cell(row)[:2]) for row in own]
            size = sizes.get((self.protocol, learner), "not applicable")
            rows.append([f"{learner}\n{size}", *texts])
        heads = ["Learner", *(f"{name}\n{measured}" for name, measured in self.columns)]
        frame = pd.DataFrame(rows, columns=heads)
        return Table(
            "attempts_by_condition", "Attempts in each condition", frame,
            dict.fromkeys(heads[1:], "s"), looks=looks, verbatim=True,
        )  # fmt: skip


def _of_reference(cell: Known | None) -> str:
    """The mean of a reference with its standard error."""
    if cell is None:
        return "–"
    mean, error, solved = cell
    least = "≥ " if solved < 1 else ""
    return f"{least}{mean:.2f}" if error is None else f"{least}{mean:.2f}\n± {error:.2f}"


def condition_tables(
    headline: pd.DataFrame,
    learners: Sequence[str] = (),
    conditions: Sequence[str] = (),
    references: Sequence[Beside] = (),
    without_any: Callable[[str], Sequence[str]] = lambda _: (),
    people: tuple[str, ...] = (),
) -> list[ConditionTable]:
    """The headline as tables, one for each protocol.

    Args:
        headline: From :func:`~causal_openlock.analysis.results.summary.headline`.
        learners: The order of the rows; others follow.
        conditions: The order of the columns; others follow.
        references: Whose columns the headline has.
        without_any: Learners under a protocol that can play none of the conditions.
        people: Labels of people.
    """
    tables = []
    for protocol, rows in headline.groupby("protocol", observed=True):
        cells = {(str(cell["learner"]), str(cell["condition"])): cell for cell in records(rows)}
        names = ordered(rows["condition"], conditions or PAPER_CONDITIONS)
        columns, ideal = [], []
        known: dict[Beside, list[Known | None]] = {
            one: [] for one in references if len(one.reference.points)
        }
        for condition in names:
            of = [cell for (_, played), cell in cells.items() if played == condition]
            columns.append((condition, " or ".join(dict.fromkeys(c["measured"] for c in of))))
            for one, found in known.items():
                prefix = one.reference.prefix
                ends = {(cell["measured"], cell[f"{prefix}_attempts"]) for cell in of}
                mean, se = (of[0][f"{prefix}_{name}"] for name in ("attempts", "se"))
                share = one.solved(condition)
                found.append((mean, se, share) if len(ends) == 1 and mean is not None else None)
            bounds = {cell["ideal_attempts"] for cell in of}
            ideal.append(bounds.pop() if len(bounds) == 1 else None)
        tables.append(
            ConditionTable(
                protocol=str(protocol),
                columns=tuple(columns),
                references={
                    one.reference: tuple(cells) for one, cells in known.items() if any(cells)
                },
                ideal=tuple(ideal) if any(ideal) else (),
                rows={
                    name: tuple(cells.get((name, condition)) for condition in names)
                    for name in ordered([*rows["learner"], *without_any(str(protocol))], learners)
                },
                people=people,
            )
        )
    return tables


def in_cell(row: Row | None) -> list[str]:
    """A learner's result in a condition as lines: the mean, its interval, and what was not solved.

    >>> row = {"attempts": 28.0, "ci_low": 24.8, "ci_high": 31.2, "subjects": 20, "mode": 30.0}
    >>> in_cell(row | {"at_mode": 14, "share_solved": 0.1})
    ['≥ 28.00', '24.80–31.20', '10% solved']
    """
    if row is None:
        return ["–"]
    mean = number(row["attempts"])
    if row["share_solved"] == 0:
        return [f"not within {row['attempts']:g}"]
    found = [mean if row["share_solved"] == 1 else f"≥ {mean}"]
    low, high = (np.nan if row[end] is None else row[end] for end in ("ci_low", "ci_high"))
    found.append(beside_mean(low, high, row["subjects"], row["mode"], row["at_mode"]))
    if row["share_solved"] < 1:
        found.append(f"{share(row['share_solved'])} solved")
    return [text for text in found if text]


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as mappings, with None for what does not exist."""
    return table.astype(object).where(table.notna(), None).to_dict("records")
