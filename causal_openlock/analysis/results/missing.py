"""Cells that are missing from the results of a folder, and why.

Cells may not have been played yet, or have failed. All numbers are without them, so every place
that gives numbers names them: the page, the terminal and ``summary.csv``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import pandas as pd

from causal_openlock.storage.store import StoredExperiment

_CELL = re.compile(r"(.+)_(\d+)-(\d+)_[0-9a-f]{12}")


class Missing(NamedTuple):
    """A cell that is missing, and what it is of, as far as the name of its file says.

    ``text`` is which it is and why it is missing, in a line; ``failed`` is whether it was played.
    """

    learner: str
    condition: str
    protocol: str
    subjects: int
    text: str
    failed: bool


def missing_cells(experiment: StoredExperiment) -> list[Missing]:
    """The cells that are missing."""
    known = beginnings(experiment)
    found = []
    for name in experiment.missing:
        where, cell, subjects = name, ("", "", ""), 0
        if (parts := _CELL.fullmatch(name)) and parts[1] in known:
            cell, subjects = known[parts[1]], int(parts[3]) - int(parts[2]) + 1
            where = f"{cell[0]} in {cell[1]}, subjects {parts[2]}-{parts[3]}"
        why = experiment.failures.get(name)
        found.append(Missing(*cell, subjects, why or f"{where}: not played yet", bool(why)))
    return found


def unfinished(missing: Sequence[Missing]) -> str:
    """Say how many cells are missing."""
    failed = sum(cell.failed for cell in missing)
    return (
        f"This comparison is unfinished: {len(missing)} of its cells "
        f"{'is' if len(missing) == 1 else 'are'} missing from every number and figure"
        f"{f'; {failed} of them failed' if failed else ''}. Run compare again to complete it."
    )


def beginnings(experiment: StoredExperiment) -> dict[str, tuple[str, str, str]]:
    """A cell's learner, condition and protocol, by how its name begins, as in ``bayes_CC4``."""
    return {
        f"{spec.name}_{condition.name}": (spec.name, condition.name, spec.protocol.name)
        for spec, condition in product(experiment.learners, experiment.conditions)
    }


def with_missing(summary: pd.DataFrame, missing: Sequence[Missing]) -> pd.DataFrame:
    """A summary with what is missing: two more columns, and rows for what has none at all.

    It stays as it is if nothing is missing; otherwise it has ``missing``, how many subjects of the
    learner in the condition are, and ``why``, in a row for each of those that failed or have not
    been played.
    """
    if not missing:
        return summary
    keys = ["learner", "condition", "protocol"]
    cells = pd.DataFrame(missing).groupby(keys, sort=False)
    absent = cells.agg(
        missing=("subjects", "sum"), why=("text", lambda texts: "; ".join(dict.fromkeys(texts)))
    )
    there = summary.astype(dict.fromkeys(keys, str))
    table = there.merge(absent.reset_index(), on=keys, how="left").fillna({"missing": 0})
    nothing = ~absent.index.isin(pd.MultiIndex.from_frame(there[keys]))
    rest = absent[nothing].reset_index().assign(subjects=0)
    return pd.concat([table, rest], ignore_index=True)
