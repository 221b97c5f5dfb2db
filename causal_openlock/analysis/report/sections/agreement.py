"""The report's section on where learners agree with the paper's DDQN, in tables and sentences."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pandas as pd

from causal_openlock.analysis.report.section import Material, Section, Table
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
from causal_openlock.analysis.results.people.comparable import paper_conditions
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Protocol

_SIZES = [
    field.name
    for field in fields(Protocol)
    if field.name.endswith(("attempt_limit", "_loops", "_trials"))
]
_POINTS = {"ours": ".3f", "ci_low": ".3f", "ci_high": ".3f", "paper": ".3f", "margin": ".3f"}
_VERDICTS = (
    f"“{AGREES}”: the whole 95% interval over subjects lies within the margin of the "
    f"paper's number; “{DISAGREES}”: all of it lies outside; “{UNDECIDED}”: else, or too few "
    f"subjects. The margin is {MARGIN:g}, since the cases that the paper calls nearly the same "
    "differ by .017 and those it calls different by .118 at least; for shares of visits it is at "
    "least the 95% interval of as few visits as the paper's number is of. Intervals are "
    "bootstrapped over subjects; of visits they are at least Wilson's for so many visits."
)


def section(material: Material) -> Section | None:
    """Ours against the paper's counts: Figures 6 and 7, point by point.

    Returns:
        None if nobody played what they are about, or baselines alone and those under a shorter
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
    points = transfer_points(tested, material.learners)
    order = transfer_order(tested, material.learners)
    course = baseline_course(trained, material.learners)
    growth = baseline_points(trained, material.learners)
    if points.empty and (growth.empty or all(_short(material.experiment, going).values())):
        return None
    tables = []
    if len(growth):
        tables += _figure_6(course, growth)
    if len(points):
        tables += _figure_7(points, order)
    text = [
        *sentences(points, order, growth),
        *budgets(material.experiment, going & set(visited["protocol"])),
    ]
    return Section("agreement", "Agreement with the paper's DDQN", tuple(text), tuple(tables))


def sentences(points: pd.DataFrame, order: pd.DataFrame, growth: pd.DataFrame) -> list[str]:
    """What agrees and what does not, a paragraph for each learner and protocol.

    Args:
        points: From :func:`~causal_openlock.analysis.results.deep.agreement.transfer_points`.
        order: From :func:`~causal_openlock.analysis.results.deep.agreement.transfer_order`.
        growth: From :func:`~causal_openlock.analysis.results.deep.agreement.baseline_points`.
    """
    who = pd.concat([table[["learner", "protocol"]] for table in (growth, points)])
    said = []
    for learner, protocol in who.drop_duplicates().itertuples(index=False):
        parts = []
        for row in _of(growth, learner, protocol, "else grows"):
            first, last = (
                _of(growth, learner, protocol, f"else, block {block}", row["condition"])[0]
                for block in (1, PARTS)
            )
            moves = {
                AGREES: "grows as in the paper",
                DISAGREES: "does not grow as it does in the paper",
                UNDECIDED: "is undecided: it may grow or not",
            }[row["verdict"]]
            parts.append(
                f"“else” {moves} in {row['condition']}: {first['ours']:.0%} → {last['ours']:.0%} "
                f"of attempts from the first to the last block (paper: {first['paper']:.0%} → "
                f"{last['paper']:.0%})."
            )
        for measure, of in ((OPENS, "attempts with a solution"), (FINDS_ALL, "visits with all")):
            rows = _of(points, learner, protocol, measure)
            for verdict in (AGREES, DISAGREES, UNDECIDED):
                told = ", ".join(
                    f"{row['condition']} ({row['ours']:.3f}, paper {row['paper']:.3f})"
                    for row in rows
                    if row["verdict"] == verdict
                )
                is_it = f"is {verdict}" if verdict == UNDECIDED else verdict
                parts += [f"The share of {of} {is_it} in {told}."] if told else []
        ranks = order[(order["learner"] == learner) & (order["protocol"] == protocol)]
        if len(ranks):
            tau = ranks[ranks["pair"] == "tau"].iloc[0]
            pairs = ranks[ranks["pair"] != "tau"]["verdict"].value_counts()
            how = f"is {UNDECIDED}" if tau["verdict"] == UNDECIDED else tau["verdict"]
            parts.append(
                f"The order of the four cases {how}: Kendall's tau {_signed(tau['ours'])} "
                f"({_signed(tau['ci_low'])} to {_signed(tau['ci_high'])}); of six pairs "
                f"{pairs.get(AGREES, 0)} agree, {pairs.get(DISAGREES, 0)} disagree and "
                f"{pairs.get(UNDECIDED, 0)} are undecided."
            )
        said.append(f"{learner} ({protocol}). {' '.join(parts)}")
    return said


def budgets(experiment: Experiment, protocols: set[str]) -> list[str]:
    """Which protocols are shorter than the paper's, in a sentence; nothing if none is.

    Args:
        experiment: What was run.
        protocols: Names of those that are compared.
    """
    short = [name for name, less in _short(experiment, protocols).items() if less]
    if not short:
        return []
    return [
        f"Protocol {' and '.join(short)}: shorter than the paper's, so where numbers disagree it "
        "may be for that alone."
    ]


def _short(experiment: Experiment, protocols: set[str]) -> dict[str, bool]:
    """Of each protocol, whether some budget of it is below the paper's."""
    return {
        one.name: any(getattr(one, size) < getattr(PROTOCOLS["rl"], size) for size in _SIZES)
        for one in sorted(experiment.protocols, key=lambda one: one.name)
        if one.name in protocols
    }


def _signed(value: float) -> str:
    return f"{value:.2f}".replace("-", "−")


def _of(
    table: pd.DataFrame, learner: str, protocol: str, point: str, condition: str | None = None
) -> list[dict[str, Any]]:
    mine = (table["learner"] == learner) & (table["protocol"] == protocol)
    mine &= table["point"] == point
    if condition is not None:
        mine &= table["condition"] == condition
    rows: list[dict[str, Any]] = table[mine].to_dict("records")
    return rows


def _figure_6(course: pd.DataFrame, growth: pd.DataFrame) -> list[Table]:
    blocks = {f"block{number}": ".1%" for number in range(1, PARTS + 1)}
    return [
        Table(
            "figure6_course",
            "Figure 6 as shares",
            course,
            {**blocks, "attempts": ",.0f"},
            f"Means over subjects in {PARTS} blocks of each subject's visits; attempts are those "
            "of a subject, and the paper's are those of all its agents together. opens: share of "
            "attempts that open the door; finds_all: share of visits in which all three solutions "
            "are found; else: share of attempts that neither unlock nor open the door.",
        ),
        Table(
            "figure6_agreement",
            "Figure 6, point by point",
            growth,
            _POINTS,
            "“else grows” is the gain from the first block to the last: it agrees if it is surely "
            f"above 0 and at least {MARGIN:g}, and disagrees if surely less. Elsewhere {_VERDICTS}",
        ),
    ]


def _figure_7(points: pd.DataFrame, order: pd.DataFrame) -> list[Table]:
    tables = [
        Table(
            "figure7_agreement",
            "Figure 7, point by point",
            points,
            _POINTS,
            "opens: share of attempts in the test that open the door; finds_all: share of test "
            f"visits in which all three solutions are found. {_VERDICTS}",
        )
    ]
    if len(order):
        tables.append(
            Table(
                "figure7_order",
                "The order of the transfer cases",
                order,
                dict.fromkeys(("ours", "ci_low", "ci_high", "paper"), "+.3f"),
                "Differences in the share of attempts with a solution, and Kendall's tau of the "
                "four shares with the paper's (one order in 24 gives 1 by luck). A pair agrees if "
                "its difference surely has the sign of the paper's, or, where the paper's differ "
                f"by less than {MARGIN:g}, if ours surely do so too.",
            )
        )
    return tables
