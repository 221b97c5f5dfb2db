"""The reward study: which rewards a learner learns with, and whether that is what the paper says.

The paper holds that with unique solutions nothing is learned ("an agent incapable of meaningfully
interacting with the environment"), and that negative immovable, partial sequence and solution
multiplier together are best. An experiment that gives learners several rewards is held against
both sentences.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.report.sections.learning import (
    FALLS,
    LEARNS,
    NOT,
    SOME,
    progress,
    said,
)
from causal_openlock.analysis.results.deep.visits import FINDS_ALL, OPENS
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.world.rewards import AuthorsReward, Reward, RewardFunction

LEAST_REWARDS = 3
"""Fewer rewards in an experiment are no study of them."""

BEST_OF_PAPER = frozenset({"negative_immovable", "partial_sequence", "solution_multiplier"})
"""What the paper found best, beside the basic reward."""

_RUNGS = {
    "unique": "unique_solutions",
    "change": "state_change",
    "immovable": "negative_immovable",
    "repeat": "negative_repeat",
    "partial": "partial_sequence",
    "multiplier": "solution_multiplier",
}


def reward_terms(reward: RewardFunction) -> frozenset[str]:
    """What a reward is made of, beside the basic one, in the paper's words."""
    if isinstance(reward, Reward):
        return frozenset(reward.terms) - {"basic"}
    if isinstance(reward, AuthorsReward):
        return frozenset(term for rung, term in _RUNGS.items() if getattr(reward, rung))
    return frozenset()


def rewards_of(experiment: Experiment) -> dict[str, RewardFunction]:
    """The reward of every learner by its label, but of those that act at random."""
    return {spec.name: spec.reward for spec in experiment.learners if not spec.is_random}


def study(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> pd.DataFrame:
    """What each reward led to, the best first.

    Args:
        table: From :func:`~causal_openlock.analysis.report.sections.learning.progress`.
        rewards: From :func:`rewards_of`.

    Returns:
        One row for each learner: ``learner``; ``door`` and ``all``, its mean shares in the last
        part of training, averaged over conditions, each followed by the verdict on it in each
        condition (``door CC4``, ``all CC4``, ...); ``reward``, and its ``terms`` in words.
    """
    kept = table[table["learner"].isin(list(rewards))]
    conditions = ordered(kept["condition"])
    rows = []
    for learner, mine in kept.groupby("learner", sort=False):
        row: dict[str, Any] = {"learner": learner}
        for name, measure in (("door", OPENS), ("all", FINDS_ALL)):
            own = mine[mine["measure"] == measure]
            row[name] = own["last"].mean()
            for condition in conditions:
                told = own.loc[own["condition"] == condition, "verdict"]
                row[f"{name} {condition}"] = ", ".join(dict.fromkeys(told))
        row["reward"] = rewards[str(learner)].name
        row["terms"] = " + ".join(sorted(reward_terms(rewards[str(learner)]))) or "none"
        rows.append(row)
    frame = pd.DataFrame(rows)
    return frame.sort_values(["door", "all"], ascending=False, kind="stable", ignore_index=True)


def on_unique_solutions(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> str | None:
    """Whether unique solutions cannot be learned, as the paper says; None if nobody got them.

    Args:
        table: From :func:`~causal_openlock.analysis.report.sections.learning.progress`.
        rewards: From :func:`rewards_of`.
    """
    unique = [name for name, one in rewards.items() if "unique_solutions" in reward_terms(one)]
    doors = table[table["learner"].isin(unique) & (table["measure"] == OPENS)]
    if doors.empty:
        return None
    claim = "The paper: with unique solutions nothing is learned. Here: "
    able = doors["verdict"].isin([LEARNS, FALLS])
    if (doors["verdict"] == NOT).all():
        judged = "the same, in every condition."
    elif able.all():
        judged = "otherwise, in every condition the door comes to be opened."
    elif able.any() or (doors["verdict"] == SOME).any():
        judged = "otherwise in part."
    else:
        judged = "undecided."
    return f"{claim}{judged} {said(doors)}"


def on_the_best(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> str | None:
    """Whether the paper's best combination is best; None if nobody got it.

    Args:
        table: From :func:`~causal_openlock.analysis.report.sections.learning.progress`.
        rewards: From :func:`rewards_of`.
    """
    best = [
        name
        for name, one in rewards.items()
        if reward_terms(one) == BEST_OF_PAPER and isinstance(one, Reward)
    ]
    doors = table[table["learner"].isin(list(rewards)) & (table["measure"] == OPENS)]
    mine = doors[doors["learner"].isin(best)]
    if mine.empty:
        return None
    parts = []
    for row in mine.to_dict("records"):
        beside = doors[
            (doors["condition"] == row["condition"])
            & (doors["protocol"] == row["protocol"])
            & ~doors["learner"].isin(best)
        ]
        above = beside[beside["ci_low"] > row["ci_high"]]
        better = int((beside["last"] > row["last"]).sum())
        where = f"{row['learner']} in {row['condition']}"
        share = f"{where} opens the door in {row['last']:.1%} of the last part's attempts"
        if len(above):
            names = ", ".join(f"{one.learner} ({one.last:.1%})" for one in above.itertuples())
            parts.append(f"{share}, and surely less often than {names}.")
        elif better:
            do = "does" if better == 1 else "do"
            parts.append(f"{share}; {better} of the others {do} so more often, but not surely.")
        else:
            parts.append(f"{share}, and nobody more often.")
    claim = "The paper: negative immovable, partial sequence and solution multiplier are best. Here"
    return f"{claim}: {' '.join(parts)}"


def section(material: Material) -> Section | None:
    """The reward study: which rewards learn, or None if the experiment has too few of them."""
    rewards = rewards_of(material.experiment)
    if len({one.name for one in rewards.values()}) < LEAST_REWARDS:
        return None
    table = progress(material.trials, material.experiment)
    table = table[table["learner"].isin(list(rewards))]
    if table.empty:
        return None
    frame = study(table, rewards)
    text = [on_unique_solutions(table, rewards), on_the_best(table, rewards)]
    text.append(
        "“Surely” means that 95% intervals over subjects do not overlap. The verdicts are those of "
        "“Which learners learn”, where the rule is stated."
    )
    told = Table(
        "reward_study",
        "Which rewards learn",
        frame,
        {"door": ".2%", "all": ".1%"},
        "“door”: share of attempts that open the door, “all”: share of visits in which every "
        "solution is found, both in the last part of training, averaged over conditions; with a "
        "condition, the verdict there. Terms are beside the basic reward.",
    )
    return Section("reward_study", "Reward study", tuple(line for line in text if line), (told,))
