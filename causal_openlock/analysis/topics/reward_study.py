"""The reward study: which rewards a learner learns with, and whether that is what the paper says.

The paper holds that with unique solutions nothing is learned ("an agent incapable of meaningfully
interacting with the environment"), and that negative immovable, partial sequence and solution
multiplier together are best. An experiment that gives learners several rewards is held against
both sentences: by visits in which every solution is found, as a subject is asked to, and next to
them by attempts that open the door, of which a reward paid once for each solution needs few.
"""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic
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
from causal_openlock.experiment.declare import Experiment
from causal_openlock.world.rewards import AuthorsReward, Reward, RewardFunction

LEAST_REWARDS = 3
"""Fewest rewards in an experiment that are compared."""

BEST_OF_PAPER = frozenset({"negative_immovable", "partial_sequence", "solution_multiplier"})
"""Terms that the paper found best, in addition to the basic reward."""

ABLE = {OPENS: (LEARNS, FALLS), FINDS_ALL: (LEARNS, FALLS, FLAT)}
"""Verdicts that count as learning; a first visit is long enough to learn in, so that the share of
those in which every solution is found need not rise from there."""

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


def section(material: Material) -> Section | None:
    """The reward study: which rewards learn, or None if the experiment has too few rewards."""
    rewards = rewards_of(material.experiment)
    if len({one.name for one in rewards.values()}) < LEAST_REWARDS:
        return None
    table = progress(material.trials, material.experiment)
    table = table[table["learner"].isin(list(rewards))]
    if table.empty:
        return None
    text = []
    unique = [name for name, one in rewards.items() if "unique_solutions" in reward_terms(one)]
    without = table[table["learner"].isin(unique)]
    if len(without):
        text = [
            "The paper: with unique solutions nothing is learned. Here, by visits in which every "
            f"solution is found: {_held_against(without, FINDS_ALL)}",
            "By attempts that open the door, of which an agent optimal for unique solutions alone "
            f"needs as many in a visit as there are solutions: {_held_against(without, OPENS)}",
        ]
    if best := _best(table, rewards):
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
    formats = {"door": ".2%", "all": ".1%"}
    frame = study(table, rewards)
    tables = (Table("reward_study", "Which rewards learn", frame, formats, caption),)
    return Section("reward_study", "Reward study", tuple(text), tables)


def study(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> pd.DataFrame:
    """Results of each reward, the one first with which every solution is found most often."""
    frame = pd.DataFrame(index=list(dict.fromkeys(table["learner"])))
    for name, measure in (("door", OPENS), ("all", FINDS_ALL)):
        own = table[table["measure"] == measure]
        frame[name] = own.groupby("learner")["last"].mean()
        for condition in ordered(own["condition"]):
            found = own[own["condition"] == condition].groupby("learner")["verdict"]
            frame[f"{name} {condition}"] = found.agg(lambda each: ", ".join(dict.fromkeys(each)))
    frame["reward"] = [rewards[name].name for name in frame.index]
    terms = [" + ".join(sorted(reward_terms(rewards[name]))) for name in frame.index]
    frame["terms"] = [words or "none" for words in terms]
    frame = frame.sort_values(["all", "door"], ascending=False, kind="stable")
    return frame.rename_axis("learner").reset_index()


def _held_against(without: pd.DataFrame, measure: str) -> str:
    """Whether nothing is learned with unique solutions, as the paper says, in words."""
    found = without[without["measure"] == measure]
    able = found["verdict"].isin(ABLE[measure])
    if (found["verdict"] == NOT).all():
        right = "the same, in every condition."
    elif able.all():
        right = "otherwise, in every condition something is learned."
    elif able.any() or (found["verdict"] == SOME).any():
        right = "otherwise in part."
    else:
        right = "undecided."
    return f"{right} {verdicts(found)}"


def _best(table: pd.DataFrame, rewards: Mapping[str, RewardFunction]) -> list[str]:
    """How learners with the paper's best combination compare with the others, by intervals."""
    best = [
        name
        for name, one in rewards.items()
        if reward_terms(one) == BEST_OF_PAPER and isinstance(one, Reward)
    ]
    by = ["learner", "condition", "protocol"]
    doors = table[table["measure"] == OPENS].set_index(by)["last"].rename("door")
    visits = table[table["measure"] == FINDS_ALL].join(doors, on=by)
    others = visits[~visits["learner"].isin(best)]
    found = []
    for row in visits[visits["learner"].isin(best)].itertuples():
        same = (others["condition"] == row.condition) & (others["protocol"] == row.protocol)
        above = others[same & (others["ci_low"] > row.ci_high)]
        better = int((same & (others["last"] > row.last)).sum())
        if len(above):
            named = ", ".join(f"{one.learner} ({one.last:.1%})" for one in above.itertuples())
            compared = f". Surely more often finds every solution {named}"
        elif better:
            finds = "finds" if better == 1 else "find"
            compared = f"; {better} of the others {finds} every solution more often, but not surely"
        else:
            compared = ", and none of the others finds every solution more often"
        found.append(
            f"{row.learner} in {row.condition} finds every solution in {row.last:.1%} of the last "
            f"part's visits, and opens the door in {row.door:.1%} of its attempts{compared}."
        )
    return found


TOPIC = Topic("reward_study", 120, section)
