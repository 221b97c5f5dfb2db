"""Where learners agree with the paper's DDQN: its Figures 6 and 7, point by point."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pandas as pd

from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionTable
from causal_openlock.analysis.results.deep.agreement import (
    AGREES,
    DISAGREES,
    MARGIN,
    UNDECIDED,
    baseline_course,
    baseline_points,
    transfer_order,
    transfer_points,
)
from causal_openlock.analysis.results.deep.visits import (
    FINDS_ALL,
    OPENS,
    PARTS,
    going_on,
    shares,
)
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.people.published import paper_conditions
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Protocol

_PROSE = Prose("agreement")
_SIZES = [
    field.name
    for field in fields(Protocol)
    if field.name.endswith(("attempt_limit", "_loops", "_trials"))
]
_POINTS = dict.fromkeys(("ours", "ci_low", "ci_high", "paper", "margin"), ".3f")
_COURSE = {**{f"block{number}": ".1%" for number in range(1, PARTS + 1)}, "attempts": ",.0f"}
_ORDER = dict.fromkeys(("ours", "ci_low", "ci_high", "paper"), "+.3f")


def section(material: Material) -> Section | None:
    """Ours against the paper's counts: Figures 6 and 7, point by point.

    Returns:
        None if no learner played what they are about, or baselines alone and those under a shorter
        protocol, which have no course to compare.
    """
    visited = going_on(material.trials, material.experiment)
    going = set(visited["protocol"])
    visited = visited[
        visited["condition"].isin(list(paper_conditions(material.experiment)))
        & ~visited["learner"].isin(material.experiment.random_learners)
    ]
    if visited.empty:
        return None
    tested = shares(visited[visited["phase"] == "test"], parts=1)
    trained = shares(visited[visited["phase"] == "train"])
    points = transfer_points(tested)
    order = transfer_order(tested)
    course = baseline_course(trained)
    growth = baseline_points(trained)
    if points.empty and (growth.empty or all(_short(material.experiment, going).values())):
        return None
    short = _short(material.experiment, going & set(visited["protocol"]))
    tables: list[SectionTable] = []
    if len(growth):
        tables.append(_PROSE.table("figure6_course", course, _COURSE, parts=PARTS))
        tables.append(_PROSE.table("figure6_agreement", growth, _POINTS, margin=MARGIN))
    if len(points):
        tables.append(_PROSE.table("figure7_agreement", points, _POINTS, margin=MARGIN))
    if len(points) and len(order):
        tables.append(_PROSE.table("figure7_order", order, _ORDER, margin=MARGIN))
    return _PROSE.section(
        "agreement",
        tables,
        learners=findings(points, order, growth),
        short=[name for name, less in short.items() if less],
    )


def findings(
    points: pd.DataFrame, order: pd.DataFrame, growth: pd.DataFrame
) -> list[dict[str, Any]]:
    """What agrees and what does not, of each learner under each protocol.

    Returns:
        ``learner``, ``protocol``; of each condition whether “else” ``grows``, with its ``first``
        and ``last`` block; the points of each ``measure`` by verdict; Kendall's ``tau`` of the
        order, if it is known, and how many ``pairs`` have each verdict.
    """
    key = ["learner", "protocol"]
    found = []
    for learner, protocol in (
        pd.concat([growth[key], points[key]]).drop_duplicates().itertuples(index=False)
    ):
        mine, at, ranks = (
            table[(table["learner"] == learner) & (table["protocol"] == protocol)]
            for table in (growth, points, order)
        )
        by_point = {(row["point"], row.get("condition")): row for row in mine.to_dict("records")}
        grows = [
            {
                **row,
                "first": by_point["else, block 1", condition],
                "last": by_point[f"else, block {PARTS}", condition],
            }
            for (point, condition), row in by_point.items()
            if point == "else grows"
        ]
        verdicts = (AGREES, DISAGREES, UNDECIDED)
        measures = {
            measure: {name: rows[rows["verdict"] == name].to_dict("records") for name in verdicts}
            for measure in (OPENS, FINDS_ALL)
            for rows in [at[at["point"] == measure]]
        }
        tau = ranks[ranks["pair"] == "tau"].to_dict("records")
        pairs = ranks.loc[ranks["pair"] != "tau", "verdict"].value_counts().to_dict()
        about = {"learner": learner, "protocol": protocol, "grows": grows, "measures": measures}
        found.append({**about, "tau": tau[0] if tau else None, "pairs": pairs})
    return found


def _short(experiment: Experiment, protocols: set[str]) -> dict[str, bool]:
    """Of each protocol, whether some budget of it is below the paper's."""
    return {
        one.name: any(getattr(one, size) < getattr(PROTOCOLS["rl"], size) for size in _SIZES)
        for one in sorted(experiment.protocols, key=lambda one: one.name)
        if one.name in protocols
    }
