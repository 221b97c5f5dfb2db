"""Attempts by condition: a row for each learner, a column for each condition.

References such as people, and the ideal observer, have rows of their own above the learners. A mean
that unsolved trials are in is a lower bound, since they count as the limit, and is marked as that.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Reference
from causal_openlock.analysis.statistics import beside_mean, sizes
from causal_openlock.analysis.table import Table, number, share
from causal_openlock.wording import file_names


def condition_tables(results: Material) -> list[Table]:
    """The headline of results as tables, one for each protocol."""
    headline = results.headline
    names = file_names(map(str, headline["protocol"].unique()))
    groups = headline.groupby("protocol", observed=True)
    return [_table(results, str(protocol), names[str(protocol)], rows) for protocol, rows in groups]


def _table(results: Material, protocol: str, name: str, rows: pd.DataFrame) -> Table:
    conditions = ordered(rows["condition"], results.conditions)
    of = {name: rows[rows["condition"] == name] for name in conditions}
    lines: list[tuple[str, str, list[str]]] = []  # a row's look, its head, its cells
    for one in results.references:
        texts = [_of_reference(one, *played) for played in of.items() if len(one.points)]
        if {*texts} - {"–"}:
            about = ", ".join(filter(None, [one.detail, sizes(one.points)]))
            lines.append(("published", f"{one.title}\n{about}", texts))
    bounds = [own["ideal_attempts"].unique() for own in of.values()]
    ideal = [known[0] if len(known) == 1 else np.nan for known in bounds]
    if any(known > 0 for known in ideal):
        texts = [f"{known:.2f}" if known > 0 else "–" for known in ideal]
        lines.append(("ideal", "Ideal observer\nschema known", texts))
    asked = [spec.name for spec in results.experiment.learners if spec.protocol.name == protocol]
    reasons = results.experiment.not_applicable  # of a learner that plays nothing, one for each
    absent = [
        one for one in asked if len(reasons.get(one, ())) == len(results.experiment.conditions)
    ]
    for learner in ordered([*rows["learner"], *absent], results.learners):
        own = rows[rows["learner"] == learner]
        cells = {row["condition"]: _in_cell(row) for row in own.to_dict("records")}
        about = sizes(own) if len(own) else "not applicable"
        look = "published" if learner in results.people else ""
        lines.append((look, f"{learner}\n{about}", [cells.get(one, "–") for one in conditions]))
    heads = [f"{name}\n{' or '.join(own['measured'].unique())}" for name, own in of.items()]
    frame = pd.DataFrame([[head, *texts] for _, head, texts in lines], columns=["Learner", *heads])
    return Table(
        f"attempts_by_condition_{name}", f"Protocol {protocol}", frame,
        dict.fromkeys(heads, "s"), verbatim=True,
        looks={number: look for number, (look, *_) in enumerate(lines) if look},
    )  # fmt: skip


def _in_cell(row: Mapping[str, Any]) -> str:
    """A learner's mean in a condition, and its interval or else what was not solved below it."""
    mean, solved = number(row["attempts"]), row["share_solved"]
    if solved == 0:
        return f"not within {row['attempts']:g}"
    ends = row["ci_low"], row["ci_high"]
    small = beside_mean(*ends, row["subjects"], row["mode"], row["at_mode"])
    small = small or (f"{share(solved)} solved" if solved < 1 else "")
    return "\n".join(filter(None, (mean if solved == 1 else f"≥ {mean}", small)))


def _of_reference(one: Reference, condition: str, rows: pd.DataFrame) -> str:
    """The mean of a reference with its standard error, where all learners have the same trial."""
    means, error = rows[f"{one.prefix}_attempts"].unique(), rows[f"{one.prefix}_se"].iloc[0]
    if len(means) > 1 or rows["measured"].nunique() > 1 or np.isnan(means[0]):
        return "–"
    least = "≥ " if one.in_leaderboard and one.solved(condition) != 1 else ""
    return f"{least}{means[0]:.2f}" + ("" if np.isnan(error) else f"\n± {error:.2f}")
