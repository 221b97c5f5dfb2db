"""Learners next to the paper's own DDQN: Figures 6 and 7 as shares.

The paper counts attempts by category: in five blocks of the baselines (Figure 6), and in the tests
of the transfer cases (Figure 7). It does not say how many agents the counts add up. So a learner's
share has two intervals: of the mean over subjects, for a count of very many agents, and of one more
subject, for what one agent did.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import BASELINES, SUBJECT, TRANSFERS
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic
from causal_openlock.analysis.topics.learning import (
    ELSE,
    FINDS_ALL,
    GROUP,
    OPENS,
    PARTS,
    UNLOCKS,
    going_on,
    matrix,
    shares,
)
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.paper.published import paper_ddqn
from causal_openlock.schemas.fsm import FloatArray

MEASURES = (OPENS, FINDS_ALL, ELSE)
PAPER = "paper"
ROW = ["learner", "protocol", "condition", "measure", "attempts"]
_FORMATS = {"attempts": ",.0f"}
_CAPTION = (
    "opens: share of attempts that open the door; finds_all: share of visits to a room in which "
    "all three solutions are found; else: share of attempts that neither unlock nor open the "
    "door. Means of subjects with 95% intervals (none of fewer than five, or where nearly all are "
    "alike); below, the 95% interval of one more subject. The paper does not say how many agents "
    "its counts add up: a share outside the second interval differs even if it is of a single "
    "agent, and one between the two intervals may. Attempts: of a subject; of the paper, of all "
    "its agents together."
)


def published_shares() -> pd.DataFrame:
    """Return the paper's counts as shares.

    >>> published_shares().loc[("CE3-CE4", "test", 1), ["opens", "attempts"]].round(3).tolist()
    [0.43, 18000.0]

    Returns:
        Rows by ``condition``, ``phase`` and ``block``: the shares of attempts ``opens``,
        ``unlocks`` and ``else``, of visits ``finds_all``; and the number of ``attempts``.
    """
    key = ["condition", "phase", "block"]
    counts = paper_ddqn().pivot_table(index=key, columns="category", values="count")
    attempts = counts.sum(axis=1)
    # A visit has 300 attempts, and its third new solution is its last.
    visits = attempts / PROTOCOLS["rl"].attempt_limit
    return pd.DataFrame(
        {
            OPENS: counts[["open1", "open2", "open3"]].sum(axis=1) / attempts,
            FINDS_ALL: counts["open3"] / visits,
            UNLOCKS: counts["unlock"] / attempts,
            ELSE: counts["else"] / attempts,
            "attempts": attempts,
        }
    )


def share_text(shares: FloatArray) -> str:
    """Print a mean of ``[n]`` subjects, its interval, and that of one more subject.

    >>> print(share_text(np.array([0.2, 0.3, 0.25, 0.35, 0.3])))
    28.0%
    20.9% to 35.1%
    one subject 11% to 45%

    Where nearly all are alike, their number stands in place of the intervals; fewer than five
    subjects have none.
    """
    mean, low, high, _ = weighted_difference([Group.of(shares)])
    if np.isnan(low):
        return f"{mean:.1%}"
    half = (high - low) / 2 * np.sqrt(len(shares) + 1)  # t · SD · √(1 + 1/n)
    low, high, least, most = np.clip([low, high, mean - half, mean + half], 0, 1)
    return f"{mean:.1%}\n{low:.1%} to {high:.1%}\none subject {least:.0%} to {most:.0%}"


def beside_paper(parts: pd.DataFrame, phase: str, conditions: Iterable[str]) -> pd.DataFrame:
    """Compare :func:`~causal_openlock.analysis.topics.learning.shares` with the paper's, by block.

    The ``phase`` is ``train`` or ``test``; rows are in the order of the ``conditions``.

    Returns:
        A row for each measure, condition and learner with as many blocks as the paper has, after
        the paper's own: :data:`ROW`, and the shares as they are printed, ``block 1`` and so on.
        Empty if there are no such learners.
    """
    paper = published_shares().xs(phase, level="phase")
    blocks = paper.index.unique("block")
    rows = []
    for measure, condition in product(MEASURES, conditions):
        known = paper.loc[condition]
        printed = known[measure].map("{:.1%}".format)
        beside = [(PAPER, "", condition, measure, round(known["attempts"].sum(), -3), *printed)]
        own = parts[(parts["condition"] == condition) & (parts["phase"] == phase)]
        for (learner, protocol, _), played in own.groupby(GROUP, observed=True):
            values = matrix(played, measure)
            if values.shape[1] == len(blocks):
                many = played["attempts"].sum() / len(played[SUBJECT].drop_duplicates())
                shown = map(share_text, values.T)
                beside.append((learner, protocol, condition, measure, many, *shown))
        rows += beside if len(beside) > 1 else []
    return pd.DataFrame(rows, columns=[*ROW, *(f"block {block}" for block in blocks)])


def section(material: Material) -> Section | None:
    """Figures 6 and 7 next to learners that go on after a trial is solved.

    Returns:
        None if no learner played what they are about, or baselines alone under another protocol,
        which have no course to compare.
    """
    experiment = material.experiment
    of_paper = [one.name for one in experiment.conditions if one.is_of_paper]
    visited = going_on(material.trials, experiment)
    visited = visited[
        visited["condition"].isin(of_paper) & ~visited["learner"].isin(experiment.random_learners)
    ]
    if visited.empty:
        return None
    trained = beside_paper(shares(visited), "train", BASELINES)
    tested = beside_paper(shares(visited, parts=1), "test", TRANSFERS)
    paper = PROTOCOLS["rl"]
    protocols = [one for one in experiment.protocols if one.name in {*visited["protocol"]}]
    others = [one.name for one in protocols if replace(one, name=paper.name) != paper]
    if tested.empty and (trained.empty or len(others) == len(protocols)):
        return None
    tables = []
    if len(trained):
        caption = f"{PARTS} blocks of a subject's visits. {_CAPTION}"
        tables.append(Table("figure6", "Figure 6 as shares", trained, _FORMATS, caption))
    if len(tested):
        whose = [name for name in ROW if name != "condition"]
        cases = tested.set_index([*whose, "condition"])["block 1"].unstack(sort=False)
        frame = cases.rename_axis(columns=None).reset_index()
        tables.append(Table("figure7", "Figure 7 as shares", frame, _FORMATS, _CAPTION))
    text = [
        f"{name} is another protocol than the paper's, which alone may explain differences."
        for name in others
    ]
    return Section("agreement", "Agreement with the paper's DDQN", tuple(text), tuple(tables))


TOPIC = Topic("agreement", 110, section)
