"""Learners against learners: by how many attempts they differ, each pair once."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots.comparisons import plot_pairs
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionPlot, SectionTable
from causal_openlock.analysis.results.decisions import Decisions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.pairwise import outcomes, pairwise_table
from causal_openlock.wording import file_names

_PROSE = Prose("pairwise")
_NAMES = {
    **{"ci_low": "low", "ci_high": "high"},
    **{"p_corrected": "p corrected", "probability": "P(fewer)"},
}
_FORMATS = {
    **dict.fromkeys(("difference", "low", "high"), "+.2f"),
    **dict.fromkeys(("p", "p corrected"), ".2g"),
    **{"P(fewer)": ".3f", "pairs": ","},
}


def compute(material: Material) -> dict[str, pd.DataFrame]:
    """All pairs of learners, by protocol."""
    protocols = ordered(material.trials["protocol"].unique(), ("human",))
    tables = {one: pairwise_table(outcomes(material.trials, one)) for one in protocols}
    return {protocol: table for protocol, table in tables.items() if len(table)}


def tests(computed: Mapping[str, pd.DataFrame]) -> dict[Hashable, float]:
    """The p of every pair, by protocol and names."""
    return {
        (protocol, row.learner, row.other): row.p
        for protocol, table in computed.items()
        for row in table.itertuples()
    }


def section(material: Material, decisions: Decisions) -> Section | None:
    """Comparisons of all learners under each protocol; None if nowhere two of them can compare."""
    found: dict[str, pd.DataFrame] = decisions.computed("pairwise")
    protocols: list[dict[str, Any]] = []
    tables: list[SectionTable] = []
    plots: list[SectionPlot] = []
    for protocol, part in file_names(found).items():
        rows = found[protocol].itertuples()
        corrected = [decisions.p("pairwise", (protocol, r.learner, r.other)) for r in rows]
        table = found[protocol].assign(p_corrected=corrected)
        differ = table["p_corrected"] < ALPHA
        alike = table[~differ].to_dict("records")
        about = {"total": len(table), "differ": int(differ.sum()), "alike": alike}
        protocols.append({"protocol": protocol, **about})
        name, options = f"pairwise_{part}", {"protocol": protocol}
        shown = table.rename(columns=_NAMES)
        tables.append(_PROSE.table("pairwise", shown, _FORMATS, name, protocol=protocol))
        if len(table) > 1:
            plots.append(_PROSE.plot("pairwise", plot_pairs, material, options, name, **options))
    if not protocols:
        return None
    return _PROSE.section("pairwise", tables, plots, protocols=protocols)
