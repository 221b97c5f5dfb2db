"""Many rooms at once do exactly what as many single rooms do."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.world.batch import KEPT_ARRAYS, LARGE, Spare
from causal_openlock.world.rewards import PRESETS
from causal_openlock.world.room import Layout, Room
from support.cc4_in_trial7 import DOOR, L0, L1, L2, NOTHING, SOLUTIONS, WHITE
from support.env_play import CONSOLE, EPISODES
from support.single_rooms import Lively, Singles

SCHEMAS = bundled_schemas()


def assert_same_console(many: dict[str, Any], singles: list[dict[str, Any]]) -> None:
    for key in CONSOLE:
        assert many["console"][key].tolist() == [info["console"][key] for info in singles], key


@pytest.mark.parametrize("reward", PRESETS)
@pytest.mark.parametrize("episode", EPISODES)
def test_many_rooms_do_exactly_what_as_many_single_rooms_do(reward: str, episode: Any) -> None:
    many = 8
    for schema, layout in (("CC3", "trial3"), ("CE4", "trial9")):
        arguments: dict[str, Any] = {
            "schema": schema,
            "layout": layout,
            "reward": reward,
            "episode": episode,
            "attempt_limit": 5,
            "reveal": True,
        }
        vector, singles = OpenLockVectorEnv(many, **arguments), Singles(many, **arguments)
        seen, info = vector.reset(seed=0)
        expected_seen, expected_infos = singles.reset(seed=0)
        np.testing.assert_array_equal(seen, expected_seen)
        assert_same_console(info, expected_infos)
        player = Lively(Room.of(SCHEMAS[schema], layout), many)
        ends: set[Any] = set()
        for _ in range(150):
            actions = player.act(3 - info["console"]["actions_left"])
            seen, rewards, terminated, truncated, info = vector.step(actions)
            expected = singles.step(actions)
            np.testing.assert_array_equal(seen, expected[0])
            np.testing.assert_array_equal(rewards, expected[1])
            np.testing.assert_array_equal(terminated, expected[2])
            np.testing.assert_array_equal(truncated, expected[3])
            assert_same_console(info, expected[4])
            tables, rows = info["latent"]["tables"], info["latent"]["row"]
            np.testing.assert_array_equal(tables.observation[rows], seen)
            ends |= set(zip(terminated.tolist(), truncated.tolist(), strict=True))
            ends |= {f"left {n}" for n in info["console"]["solutions_left"].tolist()}
        assert {"left 0", (True, False)} <= ends, "the rooms were solved in the course of this"
        assert ((False, True) in ends) == (episode == "trial"), "and attempts were spent"


@pytest.mark.parametrize("schema", ["chain3", "two_keys", "seven"])
@pytest.mark.parametrize("episode", EPISODES)
def test_many_rooms_do_what_single_rooms_do_under_other_schemas_and_limits(
    schema: str, episode: Any
) -> None:
    many = 8
    places = tuple(range(len(SCHEMAS[schema].levers)))
    arguments: dict[str, Any] = {
        "schema": schema,
        "layout": Layout(places),
        "reward": ["basic", "solution_multiplier", "negative_repeat", "partial_sequence"],
        "episode": episode,
        "attempt_limit": 8,
        "action_limit": 6,
    }
    vector, singles = OpenLockVectorEnv(many, **arguments), Singles(many, **arguments)
    _, info = vector.reset(seed=0)
    singles.reset(seed=0)
    player, solved = Lively(Room.of(SCHEMAS[schema], Layout(places)), many), False
    for _ in range(300):
        actions = player.act(6 - info["console"]["actions_left"])
        result, expected = vector.step(actions), singles.step(actions)
        info = result[4]
        solved |= 0 in info["console"]["solutions_left"]
        for one, other in zip(result[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(one, other)
        assert_same_console(info, expected[4])
    assert solved


@pytest.mark.parametrize("episode", EPISODES)
def test_the_step_that_resets_a_room_ignores_its_action(episode: Any) -> None:
    env = OpenLockVectorEnv(3, "CC4", "trial7", "negative_repeat", episode, attempt_limit=1)
    start, _ = env.reset(seed=0)
    # Room 0 ends its attempt, and room 1 opens its door.
    for actions in zip(NOTHING, SOLUTIONS[0], (L0, L0, L1), strict=True):
        _, _, terminated, truncated, info = env.step(np.array(actions))
    assert (terminated | truncated).all()
    seen, reward, terminated, truncated, info = env.step(np.array([L0, WHITE, DOOR]))
    np.testing.assert_array_equal(seen, start)
    assert not reward.any()
    assert not (terminated | truncated).any()
    assert (info["console"]["actions_left"] == 3).all()
    assert (info["console"]["attempts_left"] == 1).all()
    _, reward, *_ = env.step(np.array([L0, WHITE, DOOR]))
    assert not reward.any(), "the ignored action is none to be repeated"


@pytest.mark.parametrize("episode", EPISODES)
def test_forgetting_rooms_that_nobody_is_in_bounds_the_tables_and_changes_nothing(
    episode: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments: dict[str, Any] = {
        "schema": "noisy_CC3",
        "episode": episode,
        "attempt_limit": 2,
        "reveal": True,
    }
    remembers = OpenLockVectorEnv(3, reward="paper", **arguments)
    monkeypatch.setattr("causal_openlock.envs.vector.KEPT_CHOICES", 1)
    forgets = OpenLockVectorEnv(3, reward="paper", **arguments)
    for own in (remembers, forgets):
        own.reset(seed=4)
    generator = np.random.default_rng(0)
    stacked = []
    for moment in range(600):
        # Trials end together at first, and then at moments of their own.
        if moment == 50:
            mask = np.array([True, False, False])
            for own in (remembers, forgets):
                own.reset(options={"reset_mask": mask})
        actions = generator.integers(15, size=3)
        first, second = (own.step(actions) for own in (remembers, forgets))
        for result, expected in zip(second[:4], first[:4], strict=True):
            np.testing.assert_array_equal(result, expected)
        assert_same_console(second[4], [{"console": _at(first[4], each)} for each in range(3)])
        (first_rooms, second_rooms) = (
            [tables.rooms[room].layout for room in tables.room[told["latent"]["row"]]]
            for told in (first[4], second[4])
            for tables in [told["latent"]["tables"]]
        )
        assert first_rooms == second_rooms
        stacked.append(len(second[4]["latent"]["tables"].rooms))
    assert max(stacked) <= 12, "three are in use, and as many again may be before they are counted"
    assert len(first[4]["latent"]["tables"].rooms) > 60


def _at(info: dict[str, Any], which: int) -> dict[str, Any]:
    return {key: values[which] for key, values in info["console"].items()}


def test_each_of_many_random_rooms_is_the_room_of_its_layout() -> None:
    generator = np.random.default_rng(0)
    many = 30
    env = OpenLockVectorEnv(
        many, "CE3", "random", "authors_2018", "trial", attempt_limit=40, reveal=True
    )
    seen, info = env.reset(seed=0)
    rooms = [
        info["latent"]["tables"].rooms[index]
        for index in info["latent"]["tables"].room[info["latent"]["row"]]
    ]
    singles = [OpenLockEnv("CE3", room.layout, "authors_2018", "trial", 40) for room in rooms]
    for single in singles:
        single.reset(seed=0)
    for _ in range(60):
        actions = np.array([generator.choice([*room.layout.places, 14]) for room in rooms])
        seen, reward, terminated, truncated, _ = env.step(actions)
        if (terminated | truncated).any():
            break
        for index, single in enumerate(singles):
            expected = single.step(int(actions[index]))
            assert (seen[index] == expected[0]).all()
            assert reward[index] == expected[1]


@pytest.mark.parametrize("episode", EPISODES)
def test_a_reset_mask_resets_those_rooms_and_leaves_the_others(episode: Any) -> None:
    env = OpenLockVectorEnv(4, "CC4", "trial7", "basic", episode, attempt_limit=9)
    env.reset(seed=0)
    for actions in ((L0, L0, L0, WHITE), (L1, L1, L2, WHITE), (DOOR, DOOR, DOOR, WHITE)):
        env.step(np.array(actions))
    before = env.step(np.full(4, L0))  # the reset of an attempt, the first action of a trial's next
    mask = np.array([True, False, False, True])
    seen, info = env.reset(options={"reset_mask": mask})
    assert info["console"]["solutions_left"].tolist() == [3, 2, 2, 3]
    assert info["console"]["attempts_left"].tolist() == [9, 8, 8, 9]
    np.testing.assert_array_equal(seen[~mask], before[0][~mask])
    assert not seen[mask][:, :7].any()
    assert info["console"]["actions_left"][mask].tolist() == [3, 3]
    seen, *_ = env.step(np.full(4, L0))
    assert seen[mask][:, L0].tolist() == [1, 1]


def test_a_mask_over_rooms_that_have_ended_spares_the_others_their_reset() -> None:
    env = OpenLockVectorEnv(2, "CC4", "trial7", "basic", "trial", attempt_limit=1)
    env.reset(seed=0)
    for action in NOTHING:
        _, _, _, truncated, _ = env.step(np.full(2, action))
    assert truncated.all()
    env.reset(options={"reset_mask": np.array([True, False])})
    seen, *_ = env.step(np.full(2, L0))
    assert seen[:, L0].tolist() == [1, 0], "the second room takes this step to reset"


@pytest.mark.parametrize("positions", [7, 9], ids=["seen in words", "seen in bytes"])
@pytest.mark.parametrize("episode", EPISODES)
def test_what_many_rooms_return_stays_as_it_is_however_long_it_is_kept(
    positions: int, episode: Any
) -> None:
    many = LARGE // 8 + 1
    layout = Layout((0, 1, 2), positions)
    env = OpenLockVectorEnv(many, "CC3", layout, "paper", episode, 2, reveal=True)
    generator = np.random.default_rng(0)
    env.reset(seed=0)
    kept = []
    for _ in range(12):
        seen, *ends, info = env.step(generator.integers(2 * positions + 1, size=many))
        np.testing.assert_array_equal(
            seen, info["latent"]["tables"].observation[info["latent"]["row"]]
        )
        # A part of an array keeps all of it.
        parts = [array[1:] for array in (seen, *ends, *info["console"].values())]
        kept.append((parts, [array.copy() for array in parts]))
        del seen, ends, info
        for parts, copies in kept[-5:]:
            for array, kept_copy in zip(parts, copies, strict=True):
                np.testing.assert_array_equal(array, kept_copy)
        if len(kept) == 8:
            kept.clear()


def test_large_arrays_are_used_again_only_once_nobody_refers_to_them() -> None:
    spare = Spare((LARGE,), np.dtype(np.int8))
    first, second = spare.array(), spare.array()
    assert not np.shares_memory(first, second)
    part, where = first[:1], first.ctypes.data
    del first
    assert not np.shares_memory(spare.array(), part)
    del part
    assert where in [array.ctypes.data for array in [spare.array() for _ in range(KEPT_ARRAYS)]]
    kept = [spare.array() for _ in range(2 * KEPT_ARRAYS)]
    assert len({array.ctypes.data for array in kept}) == len(kept)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_plays_as_the_original(copied: Callable[[Any], Any]) -> None:
    env = OpenLockVectorEnv(20, "CC4", attempt_limit=3)
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    for _ in range(7):
        env.step(generator.integers(15, size=20))
    other = copied(env)
    for _ in range(40):
        actions = generator.integers(15, size=20)
        for one, two in zip(env.step(actions)[:4], other.step(actions)[:4], strict=True):
            np.testing.assert_array_equal(one, two)
