"""The environment against the checkers of Gymnasium and Stable-Baselines3."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium
import pytest
from gymnasium.utils.env_checker import check_env

import causal_openlock
from causal_openlock.envs import OpenLockEnv
from causal_openlock.schemas.finding import bundled_schemas
from support.env_play import EPISODES

SCHEMAS = bundled_schemas()


@pytest.fixture
def no_warnings(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every warning is an error, and so is whatever Gymnasium logs."""

    def complain(message: str, *arguments: Any, **_: Any) -> None:
        raise AssertionError(message % arguments if arguments else message)

    monkeypatch.setattr(gymnasium.logger, "warn", complain)
    monkeypatch.setattr(gymnasium.logger, "error", complain)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("schema", SCHEMAS)
@pytest.mark.usefixtures("no_warnings")
def test_gymnasium_finds_nothing_to_say(schema: str, episode: str) -> None:
    arguments = {"schema": schema, "episode": episode}
    made = gymnasium.make(causal_openlock.ENV_ID, **arguments, render_mode="rgb_array")
    check_env(made.unwrapped)


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("schema", SCHEMAS)
def test_stable_baselines_finds_nothing_to_say(
    schema: str, episode: str, request: pytest.FixtureRequest
) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    request.getfixturevalue("no_warnings")  # once it is imported: others' imports may warn
    env = OpenLockEnv(schema, episode=episode, render_mode="rgb_array")
    checker.check_env(env)
