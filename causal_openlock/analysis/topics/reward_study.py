"""The reward study: which rewards a learner learns with, and whether that is what the paper says.

The paper holds that with unique solutions nothing is learned ("an agent incapable of meaningfully
interacting with the environment"), and that negative immovable, partial sequence and solution
multiplier together are best. An experiment that gives learners several rewards is held against
both sentences: by visits in which every solution is found, as a subject is asked to, and next to
them by attempts that open the door, of which a reward paid once for each solution needs few.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.visits import FINDS_ALL, OPENS
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import Topic
from causal_openlock.analysis.topics.learning import (
    FALLS,
    FLAT,
    LEARNS,
    NOT,
    SOME,
    by_verdict,
    progress,
)
from causal_openlock.experiment.declare import Experiment
from causal_openlock.world.rewards import AuthorsReward, Reward, RewardFunction

LEAST_REWARDS = 3
"""Fewest rewards in an experiment that are compared."""

BEST_OF_PAPER = frozenset({"negative_immovable", "partial_sequence", "solution_multiplier"})
"""Terms that the paper found best, in addition to the basic reward."""

ABLE = {OPENS: (LEARNS, FALLS), FINDS_ALL: (LEARNS, FALLS, FLAT)}
"""Verdicts that count as learning; a first visit is long enough to learn in, so that the share of
those in which every solution is found need not rise from there."""

_PROSE = Prose(__name__)
_RUNGS = {
    "unique": "unique_solutions",
    "change": "state_change",
    "immovable": "negative_immovable",
    "repeat": "negative_repeat",
    "partial": "partial_sequence",
    "multiplier": "solution_multiplier",
}


def reward_terms(reward: RewardFunction) -> frozenset[str]:
    """Terms of a reward, in addition to the basic one, in the paper's words."""
    if isinstance(reward, Reward):
        return frozenset(reward.terms) - {"basic"}
    if isinstance(reward, AuthorsReward):
        return frozenset(term for rung, term in _RUNGS.items() if getattr(reward, rung))
    return frozenset()


def rewards_of(experiment: Experiment) -> dict[str, RewardFunction]:
    """The reward of every learner by its label, but of those that act at random."""
    by_chance = experiment.random_learners
    return {spec.name: spec.reward for spec in experiment.learners if spec.name not in by_chance}


def study(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> pd.DataFrame:
    """Results of each reward, the one first with which every solution is found most often.

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
                found = own.loc[own["condition"] == condition, "verdict"]
                row[f"{name} {condition}"] = ", ".join(dict.fromkeys(found))
        row["reward"] = rewards[str(learner)].name
        row["terms"] = " + ".join(sorted(reward_terms(rewards[str(learner)]))) or "none"
        rows.append(row)
    frame = pd.DataFrame(rows)
    return frame.sort_values(["all", "door"], ascending=False, kind="stable", ignore_index=True)


def without_repeats(
    table: pd.DataFrame, rewards: Mapping[str, RewardFunction]
) -> dict[str, dict[str, Any]] | None:
    """Whether unique solutions cannot be learned, as the paper says; None if no learner got them.

    Returns:
        By measure, whether the paper is ``right``: ``yes``, ``no`` (it is learned in every
        condition), ``in part`` or ``undecided``; and the learners by ``verdict``.
    """
    unique = [name for name, one in rewards.items() if "unique_solutions" in reward_terms(one)]
    table = table[table["learner"].isin(unique)]
    return {measure: _without(table, measure) for measure in ABLE} if len(table) else None


def _without(table: pd.DataFrame, measure: str) -> dict[str, Any]:
    found = table[table["measure"] == measure]
    able = found["verdict"].isin(ABLE[measure])
    if (found["verdict"] == NOT).all():
        right = "yes"
    elif able.all():
        right = "no"
    else:
        right = "in part" if able.any() or (found["verdict"] == SOME).any() else "undecided"
    return {"right": right, "verdicts": by_verdict(found)}


def best_rewards(
    table: pd.DataFrame, rewards: Mapping[str, RewardFunction]
) -> list[dict[str, Any]]:
    """Learners with the paper's best combination, compared with the others.

    Returns:
        ``learner``, ``condition``, ``last`` (its share of visits in which every solution is found,
        in the last part of training), ``door`` (that of attempts that open the door), how many
        others are ``better`` and which of them surely (``above``), by intervals.
    """
    best = [
        name
        for name, one in rewards.items()
        if reward_terms(one) == BEST_OF_PAPER and isinstance(one, Reward)
    ]
    by = ["learner", "condition", "protocol"]
    doors = table[table["measure"] == OPENS].set_index(by)["last"].rename("door")
    visits = table[table["measure"] == FINDS_ALL].join(doors, on=by)
    found = []
    for row in visits[visits["learner"].isin(best)].to_dict("records"):
        others = visits[
            (visits["condition"] == row["condition"])
            & (visits["protocol"] == row["protocol"])
            & ~visits["learner"].isin(best)
        ]
        above = others[others["ci_low"] > row["ci_high"]].to_dict("records")
        better = int((others["last"] > row["last"]).sum())
        found.append({**row, "better": better, "above": above})
    return found


def section(material: Material) -> Section | None:
    """The reward study: which rewards learn, or None if the experiment has too few rewards."""
    rewards = rewards_of(material.experiment)
    if len({one.name for one in rewards.values()}) < LEAST_REWARDS:
        return None
    table = progress(material.trials, material.experiment)
    table = table[table["learner"].isin(list(rewards))]
    if table.empty:
        return None
    return _PROSE.section(
        "reward_study",
        [_PROSE.table("reward_study", study(table, rewards), {"door": ".2%", "all": ".1%"})],
        unique=without_repeats(table, rewards),
        best=best_rewards(table, rewards),
    )


TOPIC = Topic("reward_study", 120, section)
