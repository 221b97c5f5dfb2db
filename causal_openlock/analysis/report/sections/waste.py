"""What attempts were worth, by what could be known when they were made."""

from __future__ import annotations

from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.waste import waste, wasted

COLUMNS = ("actions",)
"""Columns of the record that are read for this section."""

MOST = 400_000
"""Records of more attempts than this are not judged: it takes half a minute for each million."""

_PROSE = Prose("waste")
_FORMATS = {
    "subjects": ",",
    **dict.fromkeys(("regret", "ci_low", "ci_high", "information", "best"), ".2f"),
    "useless": ".0%",
}


def section(material: Material) -> Section | None:
    """Regret, information and useless actions; None where no attempt can be judged."""
    record = material.record
    if not 0 < record.num_rows <= MOST or "actions" not in record.column_names:
        return None
    table = wasted(waste(material))
    if table.empty:
        return None
    shown = table if table["protocol"].nunique() > 1 else table.drop(columns="protocol")
    return _PROSE.section(
        "waste", [_PROSE.table("waste", shown, _FORMATS)], rows=table.to_dict("records")
    )
