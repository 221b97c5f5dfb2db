"""What subjects took the structure of rooms to be when they left them, apart from solving."""

from __future__ import annotations

import pandas as pd

from causal_openlock.analysis.plots.understanding import draw_understanding
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.understanding import ASKED, understanding, understood

COLUMNS = ("actions",)
"""Columns of the record that are read for this section."""

MOST = 100_000
"""Records of more attempts than this are not played again."""

_PROSE = Prose("understanding")
_FORMATS = {
    **dict.fromkeys(("first room", "last room", "low", "high", "F1", "Brier"), ".2f"),
    **{"subjects": ",", "rooms": ","},
}


def section(material: Material) -> Section | None:
    """Edges that subjects had wrong; None where nobody says what they take the structure to be."""
    record = material.record
    if not 0 < record.num_rows <= MOST or "actions" not in record.column_names:
        return None
    table = understanding(material, subjects=ASKED)
    if table.empty:
        return None
    rows = _first_and_last(understood(table))
    call = "results.plot.understanding()"
    plot = _PROSE.plot("understanding", draw_understanding, material, {"table": table}, call=call)
    return _PROSE.section(
        "understanding",
        [_PROSE.table("understanding", rows, _FORMATS)],
        [plot],
        learners=list(dict.fromkeys(rows["learner"])),
        most=ASKED,
    )


def _first_and_last(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each learner in a condition: its first room, and its last."""
    by = ["learner", "condition", "protocol"]
    first, last = (
        getattr(table.groupby(by, observed=True, sort=False), at)() for at in ("first", "last")
    )
    rows = pd.DataFrame(
        {
            "subjects": last["subjects"], "rooms": last["visit"], "first room": first["shd"],
            "last room": last["shd"], "low": last["ci_low"], "high": last["ci_high"],
            "F1": last["f1"], "Brier": last["brier"],
        }
    ).reset_index()  # fmt: skip
    return rows.drop(columns="protocol") if rows["protocol"].nunique() == 1 else rows
