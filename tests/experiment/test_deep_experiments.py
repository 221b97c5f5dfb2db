"""The experiments on deep learners: that they are what their comments and the paper say."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.analysis.topics.reward_study import (
    BEST_OF_PAPER,
    reward_terms,
    rewards_of,
)
from causal_openlock.experiment.experiment import Experiment, LearnerSpec
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.protocol import PAPER_CONDITIONS, PROTOCOLS, Condition, plan
from causal_openlock.paper.exploration import USUAL, schedules
from causal_openlock.world.rewards import PRESETS, TERMS

NAMES = ("paper_rl", "deep_quick", "exploration_decay", "reward_study")
STUDY = Path(__file__).parents[2] / "evidence" / "figure6" / "experiment.yaml"


@pytest.fixture(scope="module")
def experiments() -> dict[str, Experiment]:
    return {name: read_experiment(find_experiment(name)) for name in NAMES}


def entry(experiment: Experiment, name: str) -> LearnerSpec:
    return next(one for one in experiment.learners if one.name == name)


def actions(one: LearnerSpec, condition: Condition) -> int:
    """The most actions that a subject takes."""
    visits = plan(condition, one.protocol, np.random.default_rng(0))
    return len(visits) * one.protocol.attempt_limit * 3


def of(experiment: Experiment, name: str) -> Condition:
    return next(one for one in experiment.conditions if one.name == name)


def said(name: str) -> str:
    return re.sub(r"\s*\n#\s*", " ", find_experiment(name).read_text())


@pytest.mark.parametrize("name", NAMES)
def test_all_have_a_random_learner_beside(experiments: dict[str, Experiment], name: str) -> None:
    assert experiments[name].learners[0].learner == "random"
    assert not experiments[name].warnings()


def test_paper_rl_is_the_papers_protocol_at_full_budget(
    experiments: dict[str, Experiment],
) -> None:
    experiment = experiments["paper_rl"]
    assert tuple(one.name for one in experiment.conditions) == PAPER_CONDITIONS
    for one in experiment.learners:
        assert one.protocol == PROTOCOLS["rl"]
        assert one.subjects >= 10
    ddqn, text = entry(experiment, "ddqn"), said("paper_rl")
    assert actions(ddqn, of(experiment, "CC4")) == 45_000
    assert actions(ddqn, of(experiment, "CC3-CC4")) == 585_000
    total = sum(actions(ddqn, condition) for condition in experiment.conditions)
    assert total == 2_430_000
    assert "45,000 actions in a baseline and 585,000 in a transfer, so 2.43 million" in text
    assert len(experiment.learners) * 10 * total / 3 == 32.4e6
    assert "The record has 32 million attempts" in text
    authors = entry(experiment, "ddqn_authors")
    assert authors.parameters["target_period"] is None
    assert authors.parameters["bootstrap_over_attempts"]
    assert authors.reward == PRESETS["authors_2018"]


def test_figure6_has_the_attempts_of_the_papers_axis() -> None:
    experiment = read_experiment(STUDY)
    for condition in experiment.conditions:
        assert actions(experiment.learners[0], condition) == 3 * 150_000
    usual = entry(experiment, "rate_001").parameters
    changed = {
        one.name: {key for key, value in one.parameters.items() if value != usual[key]}
        | ({"reward"} if one.reward.name != "paper" else set())
        for one in experiment.learners
    }
    both = {"target_period", "bootstrap_over_attempts"}
    slow = {"epsilon_decay", "epsilon_after_trial"}
    rate = {"learning_rate"}
    assert changed == {
        "rate_001": set(),
        "rate_0025": rate,
        "rate_005": rate,
        "target_never": {"target_period"},
        "over_attempts": {"bootstrap_over_attempts"},
        "never_and_over": both,
        "authors_program": both | slow | {"reward"} | rate,
    }


def test_reward_study_has_every_reward_and_the_papers_combinations(
    experiments: dict[str, Experiment],
) -> None:
    experiment = experiments["reward_study"]
    played = {one.reward.name for one in experiment.learners}
    assert set(TERMS) <= played
    ladders = {name for name in PRESETS if name.startswith("authors_2018_")}
    full = "authors_2018_negative_immovable_partial_action_seq_solution_multiplier"
    assert ladders - {full} <= played
    assert "authors_2018" in played  # the same ladder by its short name
    terms = [reward_terms(one) for one in rewards_of(experiment).values()]
    assert BEST_OF_PAPER in terms
    assert BEST_OF_PAPER | {"unique_solutions"} in terms
    assert actions(experiment.learners[0], experiment.conditions[0]) == 9_000


def test_exploration_decay_has_peoples_decays_in_every_way(
    experiments: dict[str, Experiment],
) -> None:
    found = schedules(experiments["exploration_decay"])
    ways = set(found[["decay", "shrinks_with"]].itertuples(index=False, name=None))
    for decay in (0.548, 0.743):
        assert {(decay, way) for way in ("action", "attempt", "trial")} <= ways
    assert (found["decay"] > USUAL).sum() == 2
    # Set at each trial's end, epsilon could not shrink from trial to trial.
    assert found.loc[found["shrinks_with"] == "trial", "after_trial"].isna().all()
    assert found["first_trial"].max() == 900


def test_deep_quick_is_quick_and_has_every_form(experiments: dict[str, Experiment]) -> None:
    experiment = experiments["deep_quick"]
    assert tuple(one.name for one in experiment.conditions) == PAPER_CONDITIONS
    learners = {one.learner for one in experiment.learners}
    assert learners == {"random", "ddqn", "semi_markov_ddqn", "recurrent", "rl2"}
    ddqn = entry(experiment, "ddqn")
    assert actions(ddqn, of(experiment, "CE4")) == 9_000
    assert actions(ddqn, of(experiment, "CE3-CE4")) == 7_200
    # Ten baseline visits make five blocks of two; and somebody plays as people do.
    assert len(plan(of(experiment, "CC4"), ddqn.protocol, np.random.default_rng(0))) == 10
    assert entry(experiment, "rl2_human").protocol == PROTOCOLS["human"]
