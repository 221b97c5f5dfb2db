"""The experiments on deep learners: that they are what their comments and the paper say."""

import numpy as np

from causal_openlock.analysis.topics.reward_study import BEST_OF_PAPER, reward_terms
from causal_openlock.experiment.declare import PAPER_CONDITIONS, PROTOCOLS
from causal_openlock.experiment.making import find_experiment, read_experiment
from causal_openlock.experiment.plan import forewarnings, plan
from causal_openlock.world.rewards import PRESETS, TERMS


def read(name):
    """An experiment by name, and the most actions of its second learner in each condition."""
    experiment = read_experiment(find_experiment(name))
    assert experiment.learners[0].learner == "random"  # beside all others
    assert not forewarnings(experiment)
    protocol = experiment.learners[1].protocol
    rooms = [plan(each, protocol, np.random.default_rng(0)) for each in experiment.conditions]
    actions = [len(visits) * protocol.attempt_limit * 3 for visits in rooms]
    names = [condition.name for condition in experiment.conditions]
    return experiment, dict(zip(names, actions, strict=True))


def test_deep_quick_is_quick():
    _, actions = read("deep_quick")
    assert tuple(actions) == PAPER_CONDITIONS
    assert (actions["CE4"], actions["CE3-CE4"]) == (9_000, 7_200)


def test_paper_rl_is_the_papers_protocol_at_full_budget():
    experiment, actions = read("paper_rl")
    assert tuple(actions) == PAPER_CONDITIONS
    assert experiment.protocols == (PROTOCOLS["rl"],)
    assert all(spec.subjects >= 10 for spec in experiment.learners)
    assert (actions["CC4"], actions["CC3-CC4"], sum(actions.values())) == (45_000, 585_000, 2.43e6)
    (authors,) = (spec for spec in experiment.learners if spec.name == "ddqn_authors")
    assert authors.parameters["target_period"] is None
    assert authors.parameters["bootstrap_over_attempts"]
    assert authors.reward == PRESETS["authors_2018"]


def test_reward_study_has_every_reward_and_the_papers_combinations():
    experiment, actions = read("reward_study")
    ladders = {name for name in PRESETS if name.startswith("authors_2018_")}
    # The whole ladder goes by its short name.
    full = "authors_2018_negative_immovable_partial_action_seq_solution_multiplier"
    played = {spec.reward.name for spec in experiment.learners}
    assert {*TERMS, *(ladders - {full}), "authors_2018"} <= played
    terms = [reward_terms(spec.reward) for spec in experiment.learners]
    assert BEST_OF_PAPER in terms
    assert BEST_OF_PAPER | {"unique_solutions"} in terms
    assert set(actions.values()) == {9_000}
