"""Agreement of a learner with the paper's own DDQN, point by point (Figures 6 and 7).

The paper's counts are known for each category and block, but not how many agents they add up, so
they are taken as exact, and only the learner's subjects have uncertainty. Two shares *agree* if the
whole interval of ours lies within a margin of the paper's, they *disagree* if all of it
lies outside, and otherwise it is *undecided*. Of orders and of growth the sign is judged.

Figure 6 has five blocks of 30,000 attempts. The paper does not say whether one agent made them all,
in 100 loops, or ten made them in 10 loops each: ours are cut into five blocks in any case.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group as Sample
from causal_openlock.analysis.effects import weighted_difference
from causal_openlock.analysis.measures import BASELINES, SUBJECT, TRANSFERS
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.statistics import LEAST_UNITS, share_interval
from causal_openlock.analysis.table import Table, printed
from causal_openlock.analysis.topic import Topic
from causal_openlock.analysis.topics.learning import (
    ELSE,
    FINDS_ALL,
    OPENS,
    PARTS,
    Group,
    each_group,
    going_on,
    interval,
    matrix,
    shares,
)
from causal_openlock.experiment.declare import PROTOCOLS, Experiment, Protocol
from causal_openlock.paper.published import paper_ddqn
from causal_openlock.schemas.fsm import FloatArray

AGREES, DISAGREES, UNDECIDED = "agrees", "disagrees", "undecided"
MARGIN = 0.05
"""Cases that the paper calls nearly the same differ by .017, those it calls different by .118.

The study ``evidence/figure7`` takes its margin for the same shares from here; a test compares them.
"""
ATTEMPTS_OF_VISIT = 300
POINT_COLUMNS = [*Group._fields, "point", "ours", "ci_low", "ci_high", "paper", "margin", "verdict"]
ORDER_COLUMNS = ["learner", "protocol", "pair", "ours", "ci_low", "ci_high", "paper", "verdict"]
_RULE = (
    "“agrees”: the whole 95% interval over subjects lies within the margin of the paper's number; "
    "“disagrees”: all of it lies outside; “undecided”: else, or too few subjects. The margin is "
    f"{MARGIN}, since the cases that the paper calls nearly the same differ by .017 and those it "
    "calls different by .118 at least; for shares of visits it is at least the 95% interval of as "
    "few visits as the paper's number is of. Intervals of shares of visits are at least Wilson's "
    "for that number of visits."
)
_SIZES = [
    field.name
    for field in fields(Protocol)
    if field.name.endswith(("attempt_limit", "_loops", "_trials"))
]
_POINTS = dict.fromkeys(("ours", "ci_low", "ci_high", "paper", "margin"), ".3f")
_COURSE = {**{f"block{number}": ".1%" for number in range(1, PARTS + 1)}, "attempts": ",.0f"}
_ORDER = dict.fromkeys(("ours", "ci_low", "ci_high", "paper"), "+.3f")


def published_shares(counts: Mapping[str, int]) -> dict[str, float]:
    """Counts of categories as shares: ``opens`` and ``else`` of attempts, ``finds_all`` of visits.

    The counts are of visits of 300 attempts to rooms of three solutions.
    """
    total = sum(counts.values())
    return {
        OPENS: (counts["open1"] + counts["open2"] + counts["open3"]) / total,
        ELSE: counts["else"] / total,
        # The third new solution is the last, and a visit can have it once.
        FINDS_ALL: counts["open3"] / (total / ATTEMPTS_OF_VISIT),
    }


def margin_of(measure: str, share: float, visits: float) -> float:
    """Margin around the paper's share of ``visits`` visits that counts as the same.

    For ``finds_all`` visits are independent draws at best, so the margin is at least the 95%
    interval of their share.
    """
    noise = 1.96 * np.sqrt(share * (1 - share) / visits) if measure == FINDS_ALL else 0.0
    return max(MARGIN, float(noise))


def _published(phase: str) -> dict[str, list[dict[str, int]]]:
    """The paper's counts by condition, of each block."""
    table = paper_ddqn().query("phase == @phase")
    found: dict[str, list[dict[str, int]]] = {}
    for (condition, _), rows in table.groupby(["condition", "block"]):
        found.setdefault(condition, []).append(rows.set_index("category")["count"].to_dict())
    return found


def same(
    values: FloatArray, paper: float, margin: float, visits: int = 0
) -> tuple[float, float, float, str]:
    """Compare the mean of subjects with the paper's number.

    Args:
        values: ``[n]`` one number for each subject.
        paper: The paper's number.
        margin: How far from it counts as the same.
        visits: If the numbers are shares of visits, of how many in all; the interval is at least
            Wilson's for this number of visits.

    Returns:
        Their mean, the ends of its interval, and the verdict.
    """
    low, high = interval(values)
    if visits:
        least, most = share_interval(values.mean(), visits)
        low, high = float(np.fmin(low, least)), float(np.fmax(high, most))
    verdict = UNDECIDED
    if len(values) >= LEAST_UNITS:
        if paper - margin <= low and high <= paper + margin:
            verdict = AGREES
        elif high < paper - margin or low > paper + margin:
            verdict = DISAGREES
    return float(values.mean()), low, high, verdict


def grows(gain: FloatArray) -> str:
    """Whether ``[n]`` gains of a share from the first block to the last are as the paper says.

    They agree if they are surely above 0 and :data:`MARGIN` at least on average.
    """
    low, high = interval(gain)
    if len(gain) < LEAST_UNITS:
        return UNDECIDED
    if low > 0 and gain.mean() >= MARGIN:
        return AGREES
    return DISAGREES if high < MARGIN else UNDECIDED


def _beside_paper(
    group: Group, mine: pd.DataFrame, measures: Sequence[str], blocks: Sequence[int]
) -> Iterator[tuple[str, int, tuple[float, float, float, float, float, str]]]:
    """Values of :data:`POINT_COLUMNS`, from ``ours`` on, for each measure in each block."""
    published = _published(mine["phase"].iloc[0])[group.condition]
    for measure in measures:
        values = matrix(mine, measure)
        for block in blocks:
            paper = published_shares(published[block])[measure]
            visits = sum(published[block].values()) / ATTEMPTS_OF_VISIT
            margin = margin_of(measure, paper, visits)
            of = mine.loc[mine["part"] == block + 1, "visits"]
            made = int(of.sum()) if measure == FINDS_ALL else 0
            ours, low, high, verdict = same(values[:, block], paper, margin, made)
            yield measure, block, (ours, low, high, paper, margin, verdict)


def transfer_points(tested: pd.DataFrame) -> pd.DataFrame:
    """Figure 7: what share of test attempts has a solution, and of visits all, in each case.

    Tested are :func:`~causal_openlock.analysis.topics.learning.shares` with one part.

    Returns:
        Rows of :data:`POINT_COLUMNS`; ``point`` is ``opens`` or ``finds_all``.
    """
    rows = [
        (*group, measure, *found)
        for group, mine in each_group(tested, "test")
        if group.condition in TRANSFERS
        for measure, _, found in _beside_paper(group, mine, (OPENS, FINDS_ALL), [0])
    ]
    return pd.DataFrame(rows, columns=POINT_COLUMNS)


def transfer_order(tested: pd.DataFrame) -> pd.DataFrame:
    """The order of the transfer cases by share of attempts with a solution.

    A pair of cases agrees if the whole interval of their difference has the paper's sign; where the
    paper's shares differ by less than :data:`MARGIN`, if ours surely also do so.

    Returns:
        For each learner and protocol that has all four cases, a row ``tau``, Kendall's tau of the
        four means with the paper's (agrees if every pair does, disagrees if any pair does), and one
        for each pair, such as ``CC3-CC4 − CE3-CC4``, with the columns :data:`ORDER_COLUMNS`.
    """
    published = _published("test")
    paper = np.array([published_shares(published[case][0])[OPENS] for case in TRANSFERS])
    played: dict[tuple[str, str], dict[str, FloatArray]] = {}
    for group, mine in each_group(tested, "test"):
        cases = played.setdefault((group.learner, group.protocol), {})
        cases[group.condition] = matrix(mine, OPENS)[:, 0]
    pairs = list(combinations(range(len(TRANSFERS)), 2))
    rows: list[tuple[Any, ...]] = []
    for names, cases in played.items():
        if not all(case in cases for case in TRANSFERS):
            continue
        samples = [cases[case] for case in TRANSFERS]
        of_pairs = []
        for a, b in pairs:
            found = weighted_difference([Sample.of(samples[a]), Sample.of(samples[b], -1.0)])
            value, low, high, _ = found
            gap = paper[a] - paper[b]
            if abs(gap) < MARGIN:
                alike = low >= -MARGIN and high <= MARGIN
                apart = low > MARGIN or high < -MARGIN
            else:
                alike, apart = (low > 0, high < 0) if gap > 0 else (high < 0, low > 0)
            verdict = AGREES if alike else DISAGREES if apart else UNDECIDED
            pair = f"{TRANSFERS[a]} − {TRANSFERS[b]}"
            of_pairs.append((*names, pair, value, low, high, gap, verdict))
        verdicts = {row[-1] for row in of_pairs}
        verdict = AGREES if verdicts == {AGREES} else UNDECIDED
        verdict = DISAGREES if DISAGREES in verdicts else verdict
        tau = kendall([values.mean() for values in samples], paper)
        rows += [(*names, "tau", tau, np.nan, np.nan, 1.0, verdict), *of_pairs]
    return pd.DataFrame(rows, columns=ORDER_COLUMNS)


def kendall(values: Sequence[FloatArray], paper: FloatArray) -> FloatArray:
    """``[...]`` Kendall's tau (a) of k values ``[...]`` with the paper's ``[k]``, all different."""
    pairs = list(combinations(range(len(paper)), 2))
    signs = [np.sign(values[a] - values[b]) * np.sign(paper[a] - paper[b]) for a, b in pairs]
    tau: FloatArray = np.sum(signs, axis=0) / len(pairs)
    return tau


def baseline_course(parts: pd.DataFrame) -> pd.DataFrame:
    """Figure 6 as shares of five parts: block by block, the paper's first.

    Returns:
        ``learner`` (the paper's DDQN is ``paper``), ``condition``, ``protocol``, ``measure``,
        ``block1`` to ``block5``, and ``attempts``, how many each subject made.
    """
    measures = (OPENS, FINDS_ALL, ELSE)
    rows: list[tuple[Any, ...]] = []
    for condition, counts in _published("train").items():
        blocks = [published_shares(block) for block in counts]
        total = round(sum(sum(block.values()) for block in counts), -3)
        for measure in measures:
            rows.append(("paper", condition, "", measure, *(b[measure] for b in blocks), total))
    for group, mine in _baselines(parts):
        attempts = mine["attempts"].sum() / mine.groupby(SUBJECT, observed=True).ngroups
        for measure in measures:
            rows.append((*group, measure, *matrix(mine, measure).mean(axis=0).tolist(), attempts))
    blocks_named = [f"block{number}" for number in range(1, PARTS + 1)]
    return pd.DataFrame(rows, columns=[*Group._fields, "measure", *blocks_named, "attempts"])


def baseline_points(parts: pd.DataFrame) -> pd.DataFrame:
    """Figure 6: whether ``else`` grows, and its share in the first and the last block.

    Returns:
        Rows of :data:`POINT_COLUMNS`; ``point`` is ``else grows`` or a share with its block, such
        as ``opens, block 1``.
    """
    published = _published("train")
    rows: list[tuple[Any, ...]] = []
    for group, mine in _baselines(parts):
        first, *_, last = (published_shares(block)[ELSE] for block in published[group.condition])
        other = matrix(mine, ELSE)
        gain = other[:, -1] - other[:, 0]
        growth = (float(gain.mean()), *interval(gain), last - first, MARGIN, grows(gain))
        rows.append((*group, "else grows", *growth))
        ends = _beside_paper(group, mine, (OPENS, FINDS_ALL, ELSE), (0, PARTS - 1))
        for measure, block, found in ends:
            rows.append((*group, f"{measure}, block {block + 1}", *found))
    return pd.DataFrame(rows, columns=POINT_COLUMNS)


def _baselines(parts: pd.DataFrame) -> list[tuple[Group, pd.DataFrame]]:
    """Baselines whose course is long enough for the paper's number of blocks."""
    return [
        (group, mine)
        for group, mine in each_group(parts, "train")
        if group.condition in BASELINES and matrix(mine, ELSE).shape[1] == PARTS
    ]


def section(material: Material) -> Section | None:
    """Ours against the paper's counts: Figures 6 and 7, point by point.

    Returns:
        None if no learner played what they are about, or baselines alone and those under a shorter
        protocol, which have no course to compare.
    """
    visited = going_on(material.trials, material.experiment)
    going = set(visited["protocol"])
    paper = [one.name for one in material.experiment.conditions if one.is_of_paper]
    visited = visited[
        visited["condition"].isin(paper)
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
    tables: list[Table] = []
    if len(growth):
        caption = (
            f"Means over subjects in {PARTS} blocks of each subject's visits; attempts are those "
            "of a subject, and the paper's are those of all its agents together. opens: share of "
            "attempts that open the door; finds_all: share of visits in which all three solutions "
            "are found; else: share of attempts that neither unlock nor open the door."
        )
        tables.append(Table("figure6_course", "Figure 6 as shares", course, _COURSE, caption))
        caption = (
            "“else grows” is the gain from the first block to the last: it agrees if it is surely "
            f"above 0 and at least {MARGIN}, and disagrees if surely less. Elsewhere {_RULE}"
        )
        title = "Figure 6, point by point"
        tables.append(Table("figure6_agreement", title, growth, _POINTS, caption))
    if len(points):
        caption = (
            "opens: share of attempts in the test that open the door; finds_all: share of test "
            f"visits in which all three solutions are found. {_RULE}"
        )
        title = "Figure 7, point by point"
        tables.append(Table("figure7_agreement", title, points, _POINTS, caption))
    if len(points) and len(order):
        caption = (
            "Differences in the share of attempts with a solution, and Kendall's tau of the four "
            "shares with the paper's (one order in 24 gives 1 by luck). A pair agrees if its "
            "difference surely has the sign of the paper's, or, where the paper's differ by less "
            f"than {MARGIN}, if ours surely also do so; the order agrees if every pair does, and "
            "disagrees if any does."
        )
        title = "The order of the transfer cases"
        tables.append(Table("figure7_order", title, order, _ORDER, caption))
    text = [_told(one) for one in findings(points, order, growth)]
    if less := [name for name, is_short in short.items() if is_short]:
        text.append(
            f"Protocol {' and '.join(less)}: shorter than the paper's, which alone may explain "
            "where numbers disagree."
        )
    return Section("agreement", "Agreement with the paper's DDQN", tuple(text), tuple(tables))


def _told(found: Mapping[str, Any]) -> str:
    """What came of the comparisons of one learner under a protocol."""
    agree, disagree, undecided = (
        found["verdicts"].get(name, 0) for name in (AGREES, DISAGREES, UNDECIDED)
    )
    said = (
        f"{found['learner']} ({found['protocol']}): of {found['total']} comparisons with the "
        f"paper's numbers {agree} agree, {disagree} disagree and {undecided} are undecided."
    )
    if tau := found["tau"]:
        verb = "is " if tau["verdict"] == UNDECIDED else ""
        said += (
            f" The order of the four transfer cases {verb}{tau['verdict']}: Kendall's tau "
            f"{printed(tau['ours'], '.2f')}."
        )
    return said


def findings(
    points: pd.DataFrame, order: pd.DataFrame, growth: pd.DataFrame
) -> list[dict[str, Any]]:
    """Count what agrees with the paper and what does not, by learner and protocol.

    Returns:
        ``learner``, ``protocol``; the ``total`` of comparisons (whether “else” grows, and the
        points of Figure 7) and their ``verdicts``; Kendall's ``tau`` of the order, if known.
    """
    compared = pd.concat([growth[growth["point"] == "else grows"], points])
    found = []
    for (learner, protocol), rows in compared.groupby(["learner", "protocol"], sort=False):
        ranks = order[(order["learner"] == learner) & (order["protocol"] == protocol)]
        tau = ranks[ranks["pair"] == "tau"].to_dict("records")
        found.append(
            {
                "learner": learner,
                "protocol": protocol,
                "total": len(rows),
                "verdicts": rows["verdict"].value_counts().to_dict(),
                "tau": tau[0] if tau else None,
            }
        )
    return found


def _short(experiment: Experiment, protocols: set[str]) -> dict[str, bool]:
    """Whether some budget of each protocol is below the paper's."""
    return {
        one.name: any(getattr(one, size) < getattr(PROTOCOLS["rl"], size) for size in _SIZES)
        for one in sorted(experiment.protocols, key=lambda one: one.name)
        if one.name in protocols
    }


TOPIC = Topic("agreement", 110, section)
