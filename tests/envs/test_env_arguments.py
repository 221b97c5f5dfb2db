"""What an environment is made from: schema, layout, reward, limits, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

import causal_openlock
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.errors import LayoutError, OpenLockError, ProtocolError, RewardError
from causal_openlock.experiment.protocol import MAX_ACTION_LIMIT
from causal_openlock.schemas.graphs import write_schema
from causal_openlock.schemas.schema import Gate, Schema
from causal_openlock.world.rewards import PRESETS
from causal_openlock.world.room import Layout
from support.cc4_in_trial7 import SOLUTIONS, WHITE
from support.env_play import CONSOLE, act, trial7

MINE = Schema("mine", ["A", "B"], {"A": ["door"], "B": ["door"]}, gates={"door": Gate("all")})


def test_a_schema_is_given_by_name_by_path_or_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    write_schema(MINE, path)
    for schema, name in (("CE3", "CE3"), (path, "mine"), (str(path), "mine"), (MINE, "mine")):
        env = gymnasium.make(causal_openlock.ENV_ID, schema=schema, reveal=True)
        _, info = env.reset(seed=0)
        assert info["latent"]["schema"] == name
    with pytest.raises(OpenLockError, match="there is no schema 'CC33'; did you mean CC3"):
        gymnasium.make(causal_openlock.ENV_ID, schema="CC33")


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gymnasium.make(causal_openlock.ENV_ID, attempts=5),
         "OpenLockEnv has no argument attempts; did you mean attempt_limit? known: action_limit"),
        (lambda: gymnasium.make_vec(causal_openlock.ENV_ID, num_envs=2, attempts=5),
         "OpenLockVectorEnv has no argument attempts; did you mean attempt_limit?"),
        (lambda: gymnasium.make("causal_openlock/OpenLockText-v0", shema="CC3"),
         "OpenLockTextEnv has no argument shema; did you mean schema?"),
        (lambda: gymnasium.make(causal_openlock.MIXED_ID, room=[]), "did you mean rooms?"),
    ],
)  # fmt: skip
def test_an_argument_that_an_environment_lacks_is_told_with_the_nearest(
    make: Callable[[], Any], said: str
) -> None:
    with pytest.raises(OpenLockError) as caught:
        make()
    assert said in str(caught.value)


def test_a_layout_is_given_by_name_as_a_mapping_or_drawn() -> None:
    mapping = {"L0": "LEFT", "L1": "LOWER", "L2": "UPPER"}
    for layout in ("trial2", mapping, Layout((3, 5, 1))):
        env = gymnasium.make(causal_openlock.ENV_ID, schema="CC3", layout=layout, reveal=True)
        seen, info = env.reset(seed=0)
        assert np.flatnonzero(seen[7:14]).tolist() == [1, 3, 5]
        assert dict(info["latent"]["layout"]) == mapping
    env = gymnasium.make(causal_openlock.ENV_ID, schema="CC3", layout="random", reveal=True)
    assert len({env.reset(seed=seed)[1]["latent"]["layout"] for seed in range(20)}) > 10
    with pytest.raises(LayoutError, match="there is no layout 'trial12'; did you mean"):
        gymnasium.make(causal_openlock.ENV_ID, layout="trial12")
    with pytest.raises(LayoutError, match="layouts that fit: trial1, "):
        gymnasium.make(causal_openlock.ENV_ID, schema="CC3", layout="trial7")


def test_a_reward_is_given_by_name_as_a_list_or_as_it_is() -> None:
    terms = ("basic", "negative_immovable", "partial_sequence", "solution_multiplier")
    rewards: tuple[Any, ...] = ("paper", terms, list(terms), PRESETS["paper"])
    for reward in rewards:
        env = gymnasium.make(causal_openlock.ENV_ID, schema="CC4", layout="trial7", reward=reward)
        env.reset(seed=0)
        assert [env.step(action)[1] for action in SOLUTIONS[0]] == [1, 10, 50]
    with pytest.raises(RewardError, match=r"there is no reward 'papers'; did you mean paper\?"):
        gymnasium.make(causal_openlock.ENV_ID, reward="papers")
    env = trial7()
    assert [env.step(action)[1] for action in SOLUTIONS[0]] == [0, 10, 50], "basic by default"


def test_everything_can_be_set_through_gymnasium_for_one_room_and_for_many() -> None:
    arguments: dict[str, Any] = {
        "schema": "CC3",
        "layout": {"L0": "P0", "L1": "P8", "L2": "P3"},
        "reward": ["basic", "state_change"],
        "episode": "trial",
        "attempt_limit": 7,
        "action_limit": 5,
        "positions": 9,
    }
    env = gymnasium.make(causal_openlock.ENV_ID, **arguments, render_mode="ansi")
    many = gymnasium.make_vec(
        causal_openlock.ENV_ID, num_envs=3, vectorization_mode="vector_entry_point", **arguments
    )
    assert isinstance(many, OpenLockVectorEnv)
    assert many.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seen, info = env.reset(seed=0)
    seen_by_many, info_of_many = many.reset(seed=0)
    assert (
        env.observation_space == many.single_observation_space == gymnasium.spaces.MultiBinary(20)
    )
    assert env.action_space == many.single_action_space == gymnasium.spaces.Discrete(19)
    assert seen.tolist() == [0] * 9 + [1, 0, 0, 1, 0, 0, 0, 0, 1] + [1, 0]
    assert seen_by_many.tolist() == [seen.tolist()] * 3
    expected = dict(zip(CONSOLE, (2, 0, 7, 5), strict=True))
    assert info["console"] == expected
    assert {key: list(value) for key, value in info_of_many["console"].items()} == {
        key: [value] * 3 for key, value in expected.items()
    }
    assert [env.step(action)[1] for action in (0, 8, 18)] == [0.5, 10.5, 50.5]
    steps = [many.step(np.full(3, action))[1].tolist() for action in (0, 8, 18)]
    assert steps == [[0.5] * 3, [10.5] * 3, [50.5] * 3]


def test_a_layout_brings_the_size_of_its_room_with_it_unless_another_is_asked_for() -> None:
    layout = Layout((0, 1, 8), 9)
    assert OpenLockEnv("CC3", layout).action_space == gymnasium.spaces.Discrete(19)
    wider = OpenLockEnv("CC3", Layout((0, 1, 6)), positions=10)
    seen, _ = wider.reset(seed=0)
    assert np.flatnonzero(seen).tolist() == [10, 11, 16, 20]
    assert wider.step(0)[0][0] == 1
    with pytest.raises(LayoutError, match="there is no position 8 in a room of 7"):
        OpenLockEnv("CC3", layout, positions=7)


@pytest.mark.parametrize("kind", [OpenLockEnv, OpenLockVectorEnv])
@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"attempt_limit": 0}, ProtocolError, "attempt_limit must be at least 1, not 0"),
        ({"action_limit": 2}, ProtocolError, "at least 3 actions .* cannot be 2"),
        ({"action_limit": 0}, ProtocolError, "cannot be 0"),
        ({"action_limit": 64}, ProtocolError, "more than 63, so action_limit cannot be 64"),
        ({"schema": "chain3", "action_limit": 3}, ProtocolError, "at least 4 actions"),
        ({"episode": "session"}, OpenLockError, "an episode is 'attempt' or 'trial', not 'sess"),
        ({"positions": 6}, LayoutError, "a room has 7 to 12 positions, not 6"),
        ({"positions": 0}, LayoutError, "a room has 7 to 12 positions, not 0"),
        ({"positions": 13}, LayoutError, "a room has 7 to 12 positions, not 13"),
        ({"render_mode": "human"}, OpenLockError, "rgb_array"),
    ],
)
def test_arguments_that_make_no_sense_are_refused_at_once(
    kind: Any, arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    if kind is OpenLockVectorEnv and "render_mode" in arguments:
        message = "many rooms at once are not drawn; use OpenLockEnv"
    with pytest.raises(error, match=message):
        kind(**arguments)


def test_the_longest_attempt_allowed_has_as_many_actions_as_it_says() -> None:
    for env in (trial7(action_limit=MAX_ACTION_LIMIT),):
        *_, terminated, _, info = act(env, (WHITE,) * 62)
        assert (terminated, info["console"]["actions_left"]) == (False, 1)
        assert env.step(WHITE)[2] is True


def test_an_attempt_is_as_long_as_the_schema_needs_and_at_least_three_actions() -> None:
    one = Schema("one", ["A"], {"A": ["door"]})
    for schema, expected in (("CC3", 3), (one, 3), ("chain3", 4), ("seven", 4)):
        *_, info = OpenLockEnv(schema).reset(seed=0)
        assert info["console"]["actions_left"] == expected
