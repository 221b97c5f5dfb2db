"""The environment of words: the same rules as that of bits, and the information of each action."""

from __future__ import annotations

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env

import causal_openlock
from causal_openlock.belief.trace import trace_trial
from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv, OpenLockTextEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition, Trials
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout, action_names


def test_gymnasium_finds_nothing_to_say() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = gymnasium.make(causal_openlock.TEXT_ID, schema="CC3", render_mode="ansi")
        check_env(made.unwrapped)


def test_it_goes_as_the_environment_of_bits() -> None:
    generator, layout = np.random.default_rng(1), "trial8"
    bits = OpenLockEnv("CC4", layout, "paper", "trial", 40)
    words = OpenLockTextEnv("CC4", layout, "paper", 40)
    bits.reset(seed=0)
    text, info = words.reset(seed=0)
    assert "Left: 3 combinations, 40 attempts, 3 actions" in text
    while True:
        action = int(generator.choice([0, 2, 3, 5, 14]))
        _, reward, *ended, known = bits.step(action)
        text, *got, info = words.step(words._words.actions[action])
        assert got[:3] == [reward, *ended]
        assert info["console"] == known["console"]
        assert info["action"] == action
        assert words.render() is None
        if any(ended):
            break
    with pytest.raises(ResetNeeded):
        words.step("push oak")


def test_a_text_that_is_no_action_does_nothing() -> None:
    env = OpenLockTextEnv("CC3", "trial1", story="levers", render_mode="ansi")
    with pytest.raises(ResetNeeded):
        env.step("push oak")
    env.reset(seed=0)
    with pytest.raises(InvalidAction, match="an action is a text, such as 'push "):
        env.step(3)  # type: ignore[arg-type]
    text, reward, solved, spent, info = env.step("What would you do?")
    assert text.startswith("That is no action, and nothing was done. The actions are: ")
    assert env.render() == text
    assert (reward, solved, spent, info["action"], info["information"]) == (
        0,
        False,
        False,
        None,
        0,
    )
    assert info["console"]["actions_left"] == 3


def test_a_seed_draws_words_and_a_further_trial_keeps_them() -> None:
    env = OpenLockTextEnv("CC3")
    told = [env.reset(seed=seed)[1]["actions"] for seed in (1, 2, 1)]
    assert told[0] == told[2] != told[1]
    assert env.reset()[1]["actions"] == told[2]
    with pytest.raises(OpenLockError, match="no story"):
        OpenLockTextEnv("CC3", story="cars")  # type: ignore[arg-type]


def test_information_is_what_the_bayesian_learner_gains() -> None:
    """``bayes`` in its first room observes as ideally."""
    schema = find_schema("CC4")
    layout = Layout.of(schema, "trial7")
    condition = Condition("room", (Trials(schema, (layout,)),))
    trace = trace_trial(create("bayes"), condition, PROTOCOLS["human"])
    env = OpenLockTextEnv("CC4", layout)
    env.reset(seed=0)
    gained = []
    for action in trace.actions:
        text = env._words.actions[action_names(7).index(action.name)]
        gained.append(env.step(text)[4]["information"])
    np.testing.assert_allclose(gained, [action.obtained for action in trace.actions], atol=1e-9)
    assert sum(gained) > 5
    assert "information" not in OpenLockTextEnv("CC4", information=False).reset()[1]
