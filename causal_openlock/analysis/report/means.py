"""Means of a learner as a table, next to those of references and of the ideal observer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.results.references import Beside, difference_from
from causal_openlock.analysis.statistics import beside_mean
from causal_openlock.analysis.table import Table, share

HEADS = {
    **{"protocol": "Protocol", "condition": "Condition", "phase": "Phase"},
    **{"measured": "Measured", "trial": "Trial", "loops": "Loops", "subjects": "n"},
    **{"attempts": "Attempts", "se": "SE"},
}
"""Columns of :func:`~.summary.summarise` and :func:`~.summary.headline`, as they are headed."""

BESIDE_MEAN = ["ci_low", "ci_high", "subjects", "mode", "at_mode"]
"""Columns that say what stands next to a mean."""


def means(
    rows: pd.DataFrame, references: Sequence[Beside], title: str, name: str = "", caption: str = ""
) -> Table:
    """Return rows of a summary or a headline as a table, without columns that say nothing.

    Args:
        rows: Of one learner.
        references: Whose columns the rows may have.
        title: Of the table.
        name: Of its files, if it has any.
        caption: What a reader needs to know.
    """
    columns: dict[str, Any] = {
        head: rows[column]
        for column, head in HEADS.items()
        if column in rows and (column != "protocol" or rows[column].nunique() > 1)
    }
    beside = rows[BESIDE_MEAN].itertuples(index=False, name=None)
    columns["95% interval"] = [beside_mean(*values) or "–" for values in beside]
    columns["Solved"] = rows["share_solved"].map(share)
    formats = {**dict.fromkeys(("Trial", "Loops", "n"), "d"), "Attempts": ".2f", "SE": ".2f"}
    formats |= {"95% interval": "s", "Solved": "s", "Ideal": ".2f"}
    for one in references:
        known = {
            one.reference.title: (f"{one.reference.prefix}_attempts", ".2f"),
            f"{one.reference.title} (SE)": (f"{one.reference.prefix}_se", ".2f"),
            f"− {one.reference.title}": (difference_from(one.reference, references), "+.2f"),
        }
        for head, (column, form) in known.items():
            if column in rows:
                columns[head], formats[head] = rows[column], form
    columns["Ideal"] = rows["ideal_attempts"]
    frame = pd.DataFrame(columns).dropna(axis="columns", how="all").reset_index(drop=True)
    starts = (frame["Condition"] != frame["Condition"].shift()).to_numpy()
    looks = {int(row): "first" for row in np.flatnonzero(starts)}
    return Table(name, title, frame, formats, caption, looks, verbatim=True)
