"""Learners against learners: their order, and which of them is surely better than which."""

from __future__ import annotations

from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots.comparisons import plot_pairs
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionPlot, SectionTable
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.pairwise import decided, ranking_of
from causal_openlock.wording import file_names

_PROSE = Prose("pairwise")
_NAMES = {
    "iqm": "IQM",
    "ci_low": "low",
    "ci_high": "high",
    "better_than_next": "better than next",
    "next_low": "next low",
    "next_high": "next high",
}
_RANKS = {**dict.fromkeys([*_NAMES.values(), "normalised"], ".2f"), "subjects": ","}
_PAIRS = dict.fromkeys(["probability", "ci_low", "ci_high"], ".3f")


def section(material: Material) -> Section | None:
    """Comparisons of all learners under each protocol; None if nowhere two of them can compare."""
    protocols: list[dict[str, Any]] = []
    tables: list[SectionTable] = []
    plots: list[SectionPlot] = []
    names = ordered(material.trials["protocol"].unique(), ("human",))
    for protocol, part in file_names(names).items():
        found = ranking_of(material, protocol)
        if found is None:
            continue
        protocols.append({"protocol": protocol, **compared(*found)})
        known = bool(found.ranks["normalised"].notna().any())
        shown = found.ranks if known else found.ranks.drop(columns="normalised")
        tables += [
            _PROSE.table(
                "ranking", shown.rename(columns=_NAMES), _RANKS, f"ranking_{part}",
                protocol=protocol, normalised=known,
            ),
            _PROSE.table("pairwise", found.pairs, _PAIRS, f"pairwise_{part}", protocol=protocol),
        ]  # fmt: skip
        options = {"protocol": protocol}
        plots.append(
            _PROSE.plot("pairwise", plot_pairs, material, options, f"pairwise_{part}", **options)
        )
    if not protocols:
        return None
    return _PROSE.section("pairwise", tables, plots, protocols=protocols)


def compared(ranks: pd.DataFrame, pairs: pd.DataFrame) -> dict[str, Any]:
    """Which learner leads, and which comparisons do not follow the order.

    Returns:
        ``first`` and ``last`` of the ranks; ``total``, how many comparisons there are of more than
        one subject each; those in which the later learner is better (``against``), and those that
        are not decided (``even``), as pairs of names, the one that ranks first at first.
    """
    order = {name: number for number, name in enumerate(ranks["learner"])}
    ahead = pairs["learner"].map(order) < pairs["other"].map(order)
    each = pairs[ahead & pairs["ci_low"].notna()]
    sure = decided(each)
    behind = sure & (each["probability"] < 0.5).to_numpy()
    return {
        "first": ranks.iloc[0],
        "last": ranks.iloc[-1],
        "total": len(each),
        "against": each.loc[behind, ["learner", "other"]].to_numpy().tolist(),
        "even": each.loc[~sure, ["learner", "other"]].to_numpy().tolist(),
    }
