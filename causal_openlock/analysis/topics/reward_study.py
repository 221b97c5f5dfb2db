"""The reward study: which rewards a learner learns with, and whether that is what the paper says.

The paper holds that with unique solutions nothing is learned ("an agent incapable of meaningfully
interacting with the environment"), and that negative immovable, partial sequence and solution
multiplier together are best. An experiment that gives learners several rewards is held against
both sentences: by visits in which every solution is found, as a subject is asked to, and next to
them by attempts that open the door, of which a reward paid once for each solution needs few.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

import pandas as pd

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic
from causal_openlock.analysis.topics.learning import (
    FALLS,
    FINDS_ALL,
    FLAT,
    LEARNS,
    NOT,
    OPENS,
    SOME,
    progress,
    verdicts,
)
from causal_openlock.world.rewards import AuthorsReward, Reward, RewardFunction

LEAST_REWARDS = 3  #: fewest rewards in an experiment that are compared
BEST_OF_PAPER = frozenset({"negative_immovable", "partial_sequence", "solution_multiplier"})
"""Terms that the paper found best, in addition to the basic reward."""

ABLE = {OPENS: (LEARNS, FALLS), FINDS_ALL: (LEARNS, FALLS, FLAT)}
"""Verdicts that count as learning; a first visit is long enough to learn in, so that the share of
those in which every solution is found need not rise from there."""


def reward_terms(reward: RewardFunction) -> frozenset[str]:
    """Terms of a reward in addition to the basic one; of the authors' program, in its words."""
    if isinstance(reward, AuthorsReward):
        return frozenset(term for term, is_paid in asdict(reward).items() if is_paid is True)
    return frozenset(reward.terms) - {"basic"} if isinstance(reward, Reward) else frozenset()


def section(material: Material) -> Section | None:
    """The reward study: which rewards learn, or None if the experiment has too few rewards."""
    experiment, by_chance = material.experiment, material.experiment.random_learners
    rewards = {one.name: one.reward for one in experiment.learners if one.name not in by_chance}
    table = progress(material.trials, experiment)
    table = table[table["learner"].isin(list(rewards))]
    if len({reward.name for reward in rewards.values()}) < LEAST_REWARDS or table.empty:
        return None
    terms = {name: reward_terms(reward) for name, reward in rewards.items()}
    text = []
    unique = [name for name in terms if terms[name] & {"unique_solutions", "unique"}]
    without = table[table["learner"].isin(unique)]
    if len(without):
        text = [
            "The paper: with unique solutions nothing is learned. Here, by visits in which every "
            f"solution is found: {_held_against(without, FINDS_ALL)}",
            "By attempts that open the door, of which an agent optimal for unique solutions alone "
            f"needs as many in a visit as there are solutions: {_held_against(without, OPENS)}",
        ]
    if best := _best(table, [name for name in terms if terms[name] == BEST_OF_PAPER]):
        text.append(
            "The paper: negative immovable, partial sequence and solution multiplier are best. "
            f"Here: {' '.join(best)}"
        )
    text.append(
        "“Surely” means that 95% intervals over subjects do not overlap. The verdicts are those of "
        "“Which learners learn”, where the rule is stated."
    )
    caption = (
        "“door”: share of attempts that open the door, “all”: share of visits in which every "
        "solution is found, both in the last part of training, averaged over conditions; with a "
        "condition, the verdict there. Terms are added to the basic reward."
    )
    frame, formats = _study(table, rewards), {"door": ".2%", "all": ".1%"}
    shown = Table("reward_study", "Which rewards learn", frame, formats, caption)
    return Section("reward_study", "Reward study", tuple(text), (shown,))


def _study(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> pd.DataFrame:
    """Results of each reward, the one first with which every solution is found most often."""
    table = table.replace({"measure": {OPENS: "door", FINDS_ALL: "all"}})
    table["where"] = table["measure"] + " " + table["condition"]
    frame = table.pivot_table("last", "learner", "measure", observed=True)[["door", "all"]]
    told = table.groupby(["learner", "where"], sort=False, observed=True)["verdict"]
    frame = frame.join(told.agg(", ".join).unstack())
    frame["reward"] = [rewards[name].name for name in frame.index]
    terms = [" + ".join(sorted(reward_terms(rewards[name]))) for name in frame.index]
    frame["terms"] = [words or "none" for words in terms]
    return frame.sort_values(["all", "door"], ascending=False, kind="stable").reset_index()


def _held_against(without: pd.DataFrame, measure: str) -> str:
    """Whether nothing is learned with unique solutions, as the paper says, in words."""
    rows = without[without["measure"] == measure]
    able = rows["verdict"].isin(ABLE[measure])
    if (rows["verdict"] == NOT).all():
        outcome = "the same, in every condition."
    elif able.all():
        outcome = "otherwise, in every condition something is learned."
    elif able.any() or (rows["verdict"] == SOME).any():
        outcome = "otherwise in part."
    else:
        outcome = "undecided."
    return f"{outcome} {verdicts(rows)}"


def _best(table: pd.DataFrame, best: list[str]) -> list[str]:
    """How learners with the paper's best combination compare with the others, by intervals."""
    doors, visits = (table[table["measure"] == measure] for measure in (OPENS, FINDS_ALL))
    visits = visits.assign(door=doors["last"].to_numpy())  # of the same groups, in the same order
    is_best = visits["learner"].isin(best)
    told = []
    for row in visits[is_best].itertuples():
        same = (visits["condition"] == row.condition) & (visits["protocol"] == row.protocol)
        above = visits[~is_best & same & (visits["ci_low"] > row.ci_high)]
        named = ", ".join(f"{one.learner} ({one.last:.1%})" for one in above.itertuples())
        told.append(
            f"{row.learner} in {row.condition} finds every solution in {row.last:.1%} of the last "
            f"part's visits, and opens the door in {row.door:.1%} of its attempts. "
            f"Surely more often finds every solution {named or 'none of the others'}."
        )
    return told


TOPIC = Topic("reward_study", 120, section)
