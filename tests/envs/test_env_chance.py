"""Chance in the environments: seeds, random layouts, and rooms that do not always obey."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.error import InvalidAction

from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from support.env_play import EPISODES, attempt


def history(env: Any, seed: int, actions: np.ndarray) -> list[Any]:
    """All that is seen and paid in the course of some actions."""
    many = isinstance(env, OpenLockVectorEnv)
    seen = [env.reset(seed=seed)[0].tolist()]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action if many else int(action))
        seen += [observation.tolist(), np.asarray(reward).tolist()]
        if not many and (terminated or truncated):
            seen.append(env.reset()[0].tolist())
    return seen


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("schema", ["CE4", "noisy_CC3"])
def test_a_seed_determines_layouts_and_luck(schema: str, episode: Any) -> None:
    actions = np.random.default_rng(0).integers(15, size=(400, 5))
    for kind, taken in ((OpenLockEnv, actions[:, 0]), (OpenLockVectorEnv, actions)):
        many = {"num_envs": 5} if kind is OpenLockVectorEnv else {}

        def play(
            seed: int, kind: Any = kind, many: Any = many, taken: np.ndarray = taken
        ) -> list[Any]:
            env = kind(schema=schema, episode=episode, attempt_limit=4, **many)
            history(env, 99, taken[:50])  # what was played before makes no difference
            return history(env, seed, taken)

        assert play(1) == play(1)
        assert play(1) != play(2)


def test_a_list_of_seeds_determines_the_whole_batch() -> None:
    env = OpenLockVectorEnv(4, "CC4")
    first, again, other = (
        env.reset(seed=seeds)[0] for seeds in ([1, 2, 3, 4],) * 2 + ([1, 2, 3, 5],)
    )
    assert (first == again).all()
    assert (first != other).any()


def test_random_layouts_are_all_equally_likely_and_last_for_a_trial() -> None:
    many = 8400
    env = OpenLockVectorEnv(many, "CC3", "random", attempt_limit=2, reveal=True)
    _, info = env.reset(seed=0)

    def layouts(info: dict[str, Any]) -> np.ndarray:
        tables = info["latent"]["tables"]
        places = np.array([room.layout.places for room in tables.rooms])
        return places[tables.room[info["latent"]["row"]]] @ [49, 7, 1]

    first = layouts(info)
    codes, counts = np.unique(first, return_counts=True)
    assert len(codes) == 7 * 6 * 5
    assert abs(counts - 40).max() < 6 * np.sqrt(40)
    for moment in range(4):  # the first attempt, the reset, and the next attempt's first action
        *_, info = env.step(np.full(many, 14))
        assert (layouts(info) == first).all(), moment
    for _ in range(3):  # the rest of it, and the reset
        *_, info = env.step(np.full(many, 14))
    assert (layouts(info) == first).all()
    *_, info = env.step(np.full(many, 14))
    assert np.mean(layouts(info) == first) < 0.02


def test_a_noisy_room_obeys_as_often_as_its_strengths_say() -> None:
    pushes = 4000
    env = OpenLockEnv("noisy_CC3", "trial1")  # L0 at 0, L1 at 4; L0 -> L1 has strength 0.8
    env.reset(seed=0)
    moved = []
    for _ in range(pushes):
        seen, *_ = attempt(env, (0, 4))
        assert seen[0] == 1, "a lever without causes always obeys"
        moved.append(seen[4])
    many = OpenLockVectorEnv(pushes, "noisy_CC3", "trial1")
    many.reset(seed=0)
    many.step(np.full(pushes, 0))
    seen, reward, *_ = many.step(np.full(pushes, 4))
    assert (reward == 10 * seen[:, 4]).all(), "and it pays for what happened"
    five_sigma = 5 * np.sqrt(0.8 * 0.2 / pushes)
    assert np.mean(moved) == pytest.approx(0.8, abs=five_sigma)
    assert seen[:, 4].mean() == pytest.approx(0.8, abs=five_sigma)
    # A push that fails changes nothing and costs an action.
    *_, info = many.step(np.full(pushes, 4))
    assert (info["console"]["actions_left"] == 0).all()


@pytest.mark.parametrize("episode", EPISODES)
def test_luck_of_a_room_depends_on_no_other_room_and_not_on_how_many_there_are(
    episode: Any,
) -> None:
    few, many = (OpenLockVectorEnv(n, "noisy_CC3", "trial1", "paper", episode, 4) for n in (3, 10))
    generator = np.random.default_rng(0)
    for env in (few, many):
        env.reset(seed=5)
    failed = 0
    for moment in range(300):
        actions = generator.choice([0, 0, 4, 4, 14], size=10)
        if moment % 50 == 7:  # a refused action draws nothing
            with pytest.raises(InvalidAction):
                few.step(np.array([0, 4, 15]))
        results, others = few.step(actions[:3]), many.step(actions)
        for one, other in zip(results[:4], others[:4], strict=True):
            np.testing.assert_array_equal(one, other[:3])
        for key, counts in results[4]["console"].items():
            np.testing.assert_array_equal(counts, others[4]["console"][key][:3])
        failed += ((actions == 4) & (others[0][:, 0] == 1) & (others[0][:, 4] == 0)).sum()
    assert failed > 20


@pytest.mark.parametrize(
    ("kind", "episode"), [("one", "attempt"), ("one", "trial"), ("many", "attempt")]
)
def test_rewards_of_a_noisy_room_are_for_what_happened(kind: str, episode: Any) -> None:
    terms = ["basic", "state_change"]
    generator = np.random.default_rng(1)
    if kind == "one":
        env: Any = OpenLockEnv("noisy_CC3", "trial1", terms, episode)
    else:
        env = OpenLockVectorEnv(1, "noisy_CC3", "trial1", terms, episode)
    before, _ = env.reset(seed=0)
    before = before.reshape(-1)
    opened = 0
    for _ in range(2000):
        action = int(generator.choice([0, 4, 2, 14]))
        seen, reward, over, truncated, info = env.step(action if kind == "one" else [action])
        after = np.asarray(info.get("outcome", seen)).reshape(-1)
        expected = 0.5 * (after != before).any() + 10 * (before[14] > after[14])
        expected += 50 * (after[15] > before[15])
        assert float(np.asarray(reward).item()) == expected
        opened += after[15] == 1
        before = np.asarray(seen).reshape(-1)
        if over or truncated:
            seen, *_ = env.reset() if kind == "one" else env.step([14])
            before = seen.reshape(-1)
    assert opened > 5
