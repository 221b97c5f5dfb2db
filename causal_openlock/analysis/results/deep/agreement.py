"""Where a learner agrees with the paper's own DDQN, point by point (Figures 6 and 7).

The paper's counts are known for each category and block, but not how many agents they add up, so
they are taken as exact, and only the learner's subjects have uncertainty. Two shares *agree* if the
whole bootstrap interval of ours lies within a margin of the paper's, they *disagree* if all of it
lies outside, and otherwise it is *undecided*. Of orders and of growth the sign is judged.

Figure 6 has five blocks of 30,000 attempts. The paper does not say whether one agent made them all,
in 100 loops, or ten made them in 10 loops each: ours are cut into five blocks in any case.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import BASELINES, SUBJECT, TRANSFERS
from causal_openlock.analysis.results.deep.visits import (
    ELSE,
    FINDS_ALL,
    LEAST_SUBJECTS,
    OPENS,
    PARTS,
    Group,
    each_group,
    interval,
    matrix,
)
from causal_openlock.analysis.statistics import SEED, bootstrap_interval
from causal_openlock.world import reference
from causal_openlock.world.fsm import FloatArray

AGREES, DISAGREES, UNDECIDED = "agrees", "disagrees", "undecided"

MARGIN = 0.05
"""Cases that the paper calls nearly the same differ by .017, those it calls different by .118."""

ATTEMPTS_OF_VISIT = 300

POINT_COLUMNS = [*Group._fields, "point", "ours", "ci_low", "ci_high", "paper", "margin", "verdict"]


def published_shares(counts: Mapping[str, int]) -> dict[str, float]:
    """Counts of categories as shares: ``opens`` and ``else`` of attempts, ``finds_all`` of visits.

    Args:
        counts: Attempts in each category, in visits of 300 attempts to rooms of three solutions.
    """
    total = sum(counts.values())
    return {
        OPENS: (counts["open1"] + counts["open2"] + counts["open3"]) / total,
        ELSE: counts["else"] / total,
        # The third new solution is the last, and a visit can have it once.
        FINDS_ALL: counts["open3"] / (total / ATTEMPTS_OF_VISIT),
    }


def margin_of(measure: str, share: float, visits: float) -> float:
    """How far from the paper's share counts as the same.

    Args:
        measure: One of :data:`~causal_openlock.analysis.results.deep.visits.SHARES`.
        share: The paper's.
        visits: How many visits it is of. For ``finds_all`` they are independent draws at best, so
            the margin is at least the 95% interval of so many.
    """
    noise = 1.96 * np.sqrt(share * (1 - share) / visits) if measure == FINDS_ALL else 0.0
    return max(MARGIN, float(noise))


def same(
    values: FloatArray, paper: float, margin: float, visits: int = 0
) -> tuple[float, float, float, str]:
    """Whether subjects come to the paper's number.

    Args:
        values: ``[n]`` one number for each subject.
        paper: The paper's number.
        margin: How far from it counts as the same.
        visits: If the numbers are shares of visits, of how many in all. Where all subjects are
            equal, as with no success in few visits, the bootstrap interval has no width; so the
            interval is at least Wilson's for so many visits.

    Returns:
        Their mean, the ends of its interval, and the verdict.
    """
    from scipy.stats import binomtest

    low, high = interval(values)
    if visits:
        wilson = binomtest(round(values.mean() * visits), visits).proportion_ci(method="wilson")
        low, high = min(low, float(wilson.low)), max(high, float(wilson.high))
    verdict = UNDECIDED
    if len(values) >= LEAST_SUBJECTS:
        if paper - margin <= low and high <= paper + margin:
            verdict = AGREES
        elif high < paper - margin or low > paper + margin:
            verdict = DISAGREES
    return float(values.mean()), low, high, verdict


def grows(gain: FloatArray) -> str:
    """Whether a share grows as the paper says: surely, and by :data:`MARGIN` at least.

    Args:
        gain: ``[n]`` each subject's share in the last block minus that in the first.
    """
    low, high = interval(gain)
    if len(gain) < LEAST_SUBJECTS:
        return UNDECIDED
    if low > 0 and gain.mean() >= MARGIN:
        return AGREES
    return DISAGREES if high < MARGIN else UNDECIDED


def transfer_points(tested: pd.DataFrame, learners: Sequence[str] = ()) -> pd.DataFrame:
    """Figure 7: what share of test attempts has a solution, and of visits all, in each case.

    Args:
        tested: From :func:`~causal_openlock.analysis.results.deep.visits.shares` with one part.
        learners: The order of learners.

    Returns:
        Rows of :data:`POINT_COLUMNS`; ``point`` is ``opens`` or ``finds_all``.
    """
    published = reference.results()["cogsci2018"]["ddqn"]["transfer_counts"]
    rows = []
    for group, mine in each_group(tested, "test", learners):
        if group.condition in published:
            shares = published_shares(published[group.condition])
            visits = sum(published[group.condition].values()) / ATTEMPTS_OF_VISIT
            for measure in (OPENS, FINDS_ALL):
                paper = shares[measure]
                margin = margin_of(measure, paper, visits)
                made = int(mine["visits"].sum()) if measure == FINDS_ALL else 0
                ours, low, high, verdict = same(matrix(mine, measure)[:, 0], paper, margin, made)
                rows.append((*group, measure, ours, low, high, paper, margin, verdict))
    return pd.DataFrame(rows, columns=POINT_COLUMNS)


def transfer_order(tested: pd.DataFrame, learners: Sequence[str] = ()) -> pd.DataFrame:
    """The order of the transfer cases by share of attempts with a solution.

    Kendall's tau of the four means is recomputed in every resample of the subjects, and so is the
    difference of each pair of cases. Where the paper's shares differ by less than :data:`MARGIN`,
    a pair agrees if ours surely do so too.

    Args:
        tested: As in :func:`transfer_points`.
        learners: The order of learners.

    Returns:
        For each learner and protocol that has all four cases, a row ``tau`` (agrees if its whole
        interval is above 0, disagrees if none of it is) and one for each pair, such as
        ``CC3-CC4 − CE3-CC4``, with ``learner``, ``protocol``, ``pair``, ``ours``, ``ci_low``,
        ``ci_high``, ``paper`` and ``verdict``.
    """
    published = reference.results()["cogsci2018"]["ddqn"]["transfer_counts"]
    paper = np.array([published_shares(published[case])[OPENS] for case in TRANSFERS])
    played: dict[tuple[str, str], dict[str, FloatArray]] = {}
    for group, mine in each_group(tested, "test", learners):
        cases = played.setdefault((group.learner, group.protocol), {})
        cases[group.condition] = matrix(mine, OPENS)[:, 0]
    pairs = list(combinations(range(len(TRANSFERS)), 2))

    def order(*cases: FloatArray) -> FloatArray:
        means = [values.mean(axis=-1) for values in cases]
        return np.stack([kendall(means, paper), *(means[a] - means[b] for a, b in pairs)])

    rows: list[tuple[Any, ...]] = []
    for names, cases in played.items():
        if not all(case in cases for case in TRANSFERS):
            continue
        samples = [cases[case] for case in TRANSFERS]
        few = min(map(len, samples)) < LEAST_SUBJECTS
        ends = bootstrap_interval(order, samples, np.random.default_rng(SEED))
        (tau, *ours), (low, *lows), (high, *highs) = order(*samples), *ends
        verdict = AGREES if low > 0 else DISAGREES if high <= 0 else UNDECIDED
        rows.append((*names, "tau", tau, low, high, 1.0, UNDECIDED if few else verdict))
        for (a, b), value, low, high in zip(pairs, ours, lows, highs, strict=True):
            published_gap = paper[a] - paper[b]
            if abs(published_gap) < MARGIN:
                alike = low >= -MARGIN and high <= MARGIN
                apart = low > MARGIN or high < -MARGIN
            else:
                alike, apart = (low > 0, high < 0) if published_gap > 0 else (high < 0, low > 0)
            verdict = AGREES if alike else DISAGREES if apart else UNDECIDED
            pair = f"{TRANSFERS[a]} − {TRANSFERS[b]}"
            row = (*names, pair, value, low, high, published_gap, UNDECIDED if few else verdict)
            rows.append(row)
    return pd.DataFrame(rows, columns=ORDER_COLUMNS)


ORDER_COLUMNS = ["learner", "protocol", "pair", "ours", "ci_low", "ci_high", "paper", "verdict"]


def kendall(values: Sequence[FloatArray], paper: FloatArray) -> FloatArray:
    """``[...]`` Kendall's tau (a) of k values ``[...]`` with the paper's ``[k]``, all different."""
    pairs = list(combinations(range(len(paper)), 2))
    signs = [np.sign(values[a] - values[b]) * np.sign(paper[a] - paper[b]) for a, b in pairs]
    tau: FloatArray = np.sum(signs, axis=0) / len(pairs)
    return tau


def baseline_course(parts: pd.DataFrame, learners: Sequence[str] = ()) -> pd.DataFrame:
    """Figure 6 as shares: block by block, the paper's first.

    Args:
        parts: From :func:`~causal_openlock.analysis.results.deep.visits.shares` with five parts.
        learners: The order of learners.

    Returns:
        ``learner`` (the paper's DDQN is ``paper``), ``condition``, ``protocol``, ``measure``,
        ``block1`` to ``block5``, and ``attempts``, how many each subject made.
    """
    published = reference.results()["cogsci2018"]["ddqn"]["baseline_counts"]
    rows: list[tuple[Any, ...]] = []
    for condition in BASELINES:
        blocks = [published_shares(counts) for counts in published[condition].values()]
        total = sum(sum(counts.values()) for counts in published[condition].values())
        for measure in (OPENS, FINDS_ALL, ELSE):
            values = [block[measure] for block in blocks]
            rows.append(("paper", condition, "", measure, *values, round(total, -3)))
    for group, mine in _baselines(parts, learners):
        attempts = mine["attempts"].sum() / mine.groupby(SUBJECT, observed=True).ngroups
        for measure in (OPENS, FINDS_ALL, ELSE):
            values = matrix(mine, measure).mean(axis=0).tolist()
            rows.append((*group, measure, *values, attempts))
    blocks_named = [f"block{number}" for number in range(1, PARTS + 1)]
    return pd.DataFrame(rows, columns=[*Group._fields, "measure", *blocks_named, "attempts"])


def baseline_points(parts: pd.DataFrame, learners: Sequence[str] = ()) -> pd.DataFrame:
    """Figure 6: whether ``else`` grows, and what the first and the last block come to.

    Args:
        parts: As in :func:`baseline_course`.
        learners: The order of learners.

    Returns:
        Rows of :data:`POINT_COLUMNS`; ``point`` is ``else grows`` or a share with its block, such
        as ``opens, block 1``.
    """
    published = reference.results()["cogsci2018"]["ddqn"]["baseline_counts"]
    rows = []
    for group, mine in _baselines(parts, learners):
        counts = list(published[group.condition].values())
        blocks = [published_shares(block) for block in counts]
        other = matrix(mine, ELSE)
        gain = other[:, -1] - other[:, 0]
        published_gain = blocks[-1][ELSE] - blocks[0][ELSE]
        growth = (float(gain.mean()), *interval(gain), published_gain, MARGIN, grows(gain))
        rows.append((*group, "else grows", *growth))
        for measure in (OPENS, FINDS_ALL, ELSE):
            share = matrix(mine, measure)
            for block in (0, PARTS - 1):
                paper = blocks[block][measure]
                visits = sum(counts[block].values()) / ATTEMPTS_OF_VISIT
                margin = margin_of(measure, paper, visits)
                of = mine.loc[mine["part"] == block + 1, "visits"]
                made = int(of.sum()) if measure == FINDS_ALL else 0
                ours, low, high, verdict = same(share[:, block], paper, margin, made)
                point = f"{measure}, block {block + 1}"
                rows.append((*group, point, ours, low, high, paper, margin, verdict))
    return pd.DataFrame(rows, columns=POINT_COLUMNS)


def _baselines(parts: pd.DataFrame, learners: Sequence[str]) -> list[tuple[Group, pd.DataFrame]]:
    """Baselines whose course is long enough for as many blocks as the paper's."""
    return [
        (group, mine)
        for group, mine in each_group(parts, "train", learners)
        if group.condition in BASELINES and matrix(mine, ELSE).shape[1] == PARTS
    ]
