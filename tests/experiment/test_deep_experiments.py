"""The experiments on deep learners: that they are what their comments and the paper say."""

import numpy as np

from causal_openlock.analysis.topics.reward_study import BEST_OF_PAPER, reward_terms, rewards_of
from causal_openlock.experiment.declare import PAPER_CONDITIONS, PROTOCOLS
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.experiment.plan import plan
from causal_openlock.world.rewards import PRESETS, TERMS


def read(name):
    experiment = read_experiment(find_experiment(name))
    assert experiment.learners[0].learner == "random"  # beside all others
    assert not experiment.warnings()
    return experiment


def by_name(things):
    return {one.name: one for one in things}


def actions(one, condition):
    """The most actions that a subject takes."""
    visits = plan(condition, one.protocol, np.random.default_rng(0))
    return len(visits) * one.protocol.attempt_limit * 3


def test_paper_rl_is_the_papers_protocol_at_full_budget():
    experiment = read("paper_rl")
    assert tuple(by_name(experiment.conditions)) == PAPER_CONDITIONS
    assert {one.protocol for one in experiment.learners} == {PROTOCOLS["rl"]}
    assert all(one.subjects >= 10 for one in experiment.learners)
    ddqn, authors = (by_name(experiment.learners)[name] for name in ("ddqn", "ddqn_authors"))
    counts = {name: actions(ddqn, one) for name, one in by_name(experiment.conditions).items()}
    assert (counts["CC4"], counts["CC3-CC4"], sum(counts.values())) == (45_000, 585_000, 2_430_000)
    assert len(experiment.learners) * 10 * sum(counts.values()) / 3 == 32.4e6
    assert authors.parameters["target_period"] is None
    assert authors.parameters["bootstrap_over_attempts"]
    assert authors.reward == PRESETS["authors_2018"]


def test_reward_study_has_every_reward_and_the_papers_combinations():
    experiment = read("reward_study")
    played = {one.reward.name for one in experiment.learners}
    assert set(TERMS) <= played
    ladders = {name for name in PRESETS if name.startswith("authors_2018_")}
    # The whole ladder goes by its short name.
    full = "authors_2018_negative_immovable_partial_action_seq_solution_multiplier"
    assert (ladders - {full}) | {"authors_2018"} <= played
    terms = [reward_terms(one) for one in rewards_of(experiment).values()]
    assert BEST_OF_PAPER in terms
    assert BEST_OF_PAPER | {"unique_solutions"} in terms
    assert actions(experiment.learners[0], experiment.conditions[0]) == 9_000


def test_deep_quick_is_quick_and_has_every_form():
    experiment = read("deep_quick")
    conditions, learners = by_name(experiment.conditions), by_name(experiment.learners)
    assert tuple(conditions) == PAPER_CONDITIONS
    played = {one.learner for one in experiment.learners}
    assert played == {"random", "ddqn", "semi_markov_ddqn", "recurrent", "rl2"}
    assert actions(learners["ddqn"], conditions["CE4"]) == 9_000
    assert actions(learners["ddqn"], conditions["CE3-CE4"]) == 7_200
    # Ten baseline visits make five blocks of two; and somebody plays as people do.
    generator = np.random.default_rng(0)
    assert len(plan(conditions["CC4"], learners["ddqn"].protocol, generator)) == 10
    assert learners["rl2_human"].protocol == PROTOCOLS["human"]
