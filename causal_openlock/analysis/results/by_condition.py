"""Attempts by condition: a row for each learner, a column for each condition.

References such as people, and the ideal observer, have rows of their own above the learners. A mean
that unsolved trials are in is a lower bound, since they count as the limit, and is marked as that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference
from causal_openlock.analysis.statistics import beside_mean, sizes
from causal_openlock.analysis.table import Table, number, records, share
from causal_openlock.wording import file_names


def condition_tables(results: Material) -> list[Table]:
    """The headline of results as tables, one for each protocol."""
    headline = results.headline
    names = file_names(map(str, headline["protocol"].unique()))
    groups = headline.groupby("protocol", observed=True)
    return [_table(results, str(protocol), names[str(protocol)], rows) for protocol, rows in groups]


def _table(results: Material, protocol: str, name: str, rows: pd.DataFrame) -> Table:
    conditions = ordered(rows["condition"], results.conditions)
    cells = {(str(row["learner"]), str(row["condition"])): row for row in records(rows)}
    of = {name: [row for (_, one), row in cells.items() if one == name] for name in conditions}
    lines: list[tuple[str, str, list[str]]] = []  # a row's look, its head, its cells
    for one in results.references:
        if one.points.empty:
            continue
        texts = [_of_reference(one, *played) for played in of.items()]
        if set(texts) != {"–"}:
            about = ", ".join(filter(None, [one.detail, sizes(one.points)]))
            lines.append(("published", f"{one.title}\n{about}", texts))
    bounds = [{row["ideal_attempts"] for row in played} for played in of.values()]
    ideal = [None if len(known) > 1 else known.pop() for known in bounds]
    if any(ideal):
        texts = ["–" if attempts is None else f"{attempts:.2f}" for attempts in ideal]
        lines.append(("ideal", "Ideal observer\nschema known", texts))
    asked = [spec.name for spec in results.experiment.learners if spec.protocol.name == protocol]
    reasons = results.experiment.not_applicable  # of a learner that plays nothing, one for each
    absent = [
        one for one in asked if len(reasons.get(one, ())) == len(results.experiment.conditions)
    ]
    for learner in ordered([*rows["learner"], *absent], results.learners):
        own = rows[rows["learner"] == learner]
        about = sizes(own) if len(own) else "not applicable"
        texts = [_in_cell(cells.get((learner, condition))) for condition in conditions]
        look = "published" if learner in results.people else ""
        lines.append((look, f"{learner}\n{about}", texts))
    measured = [" or ".join(dict.fromkeys(row["measured"] for row in of[c])) for c in conditions]
    heads = ["Learner", *map("\n".join, zip(conditions, measured, strict=True))]
    frame = pd.DataFrame([[head, *texts] for _, head, texts in lines], columns=heads)
    return Table(
        f"attempts_by_condition_{name}", f"Protocol {protocol}", frame,
        dict.fromkeys(heads[1:], "s"), verbatim=True,
        looks={number: look for number, (look, *_) in enumerate(lines) if look},
    )  # fmt: skip


def _in_cell(row: Mapping[str, Any] | None) -> str:
    """A learner's mean in a condition, and its interval or else what was not solved below it."""
    if row is None:
        return "–"
    mean, solved = number(row["attempts"]), row["share_solved"]
    if solved == 0:
        return f"not within {row['attempts']:g}"
    low, high = (np.nan if row[end] is None else row[end] for end in ("ci_low", "ci_high"))
    small = beside_mean(low, high, row["subjects"], row["mode"], row["at_mode"])
    small = small or (f"{share(solved)} solved" if solved < 1 else "")
    return "\n".join(filter(None, (mean if solved == 1 else f"≥ {mean}", small)))


def _of_reference(one: Reference, condition: str, cells: Sequence[Mapping[str, Any]]) -> str:
    """The mean of a reference with its standard error, where all learners have the same trial."""
    mean, error = (cells[0][f"{one.prefix}_{name}"] for name in ("attempts", "se"))
    same = {(cell["measured"], cell[f"{one.prefix}_attempts"]) for cell in cells}
    if mean is None or len(same) > 1:
        return "–"
    least = "≥ " if one.in_leaderboard and one.solved(condition) != 1 else ""
    return f"{least}{mean:.2f}" + ("" if error is None else f"\n± {error:.2f}")
