"""What an environment hands out: what is told where, and that changing it changes no room."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from causal_openlock.envs import MixedRoomsEnv, OpenLockEnv, OpenLockVectorEnv
from support.cc4_in_trial7 import DOOR, L0, L1, L2, L3, SOLUTIONS
from support.env_play import CONSOLE, EPISODES, trial7


@pytest.mark.parametrize("episode", EPISODES)
def test_whoever_changes_what_was_handed_out_does_not_change_the_room(episode: Any) -> None:
    def ruin(seen: np.ndarray, info: dict[str, Any]) -> None:
        seen[:] = 7
        if "outcome" in info:
            info["outcome"][:] = 7
        for part in ("console", "latent"):
            info[part].update(dict.fromkeys(info[part], 99))

    ruined, kept = (OpenLockEnv("CC4", "trial7", episode=episode, reveal=True) for _ in range(2))
    ruin(*ruined.reset(seed=0))
    kept.reset(seed=0)
    generator = np.random.default_rng(0)
    for _ in range(200):
        action = int(generator.choice([L0, L1, L2, L3, DOOR]))
        seen, reward, terminated, truncated, info = ruined.step(action)
        expected = kept.step(action)
        assert (seen == expected[0]).all()
        assert (reward, terminated, truncated) == expected[1:4]
        assert info["console"] == expected[4]["console"]
        assert info["latent"] == expected[4]["latent"]
        if "outcome" in info:
            assert (info["outcome"] == expected[4]["outcome"]).all()
        ruin(seen, info)
        if terminated or truncated:
            ruin(*ruined.reset())
            kept.reset()


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("reveal", [{}, {"reveal": True}], ids=["by default", "revealed"])
def test_what_is_latent_is_in_info_only_if_revealed(reveal: dict[str, Any], episode: Any) -> None:
    parts = {"console", "latent"} if reveal else {"console"}
    mixed = MixedRoomsEnv([{"schema": "CC4", "layout": "trial7", "episode": episode}], **reveal)
    for env in (trial7(episode=episode, **reveal), mixed):
        infos = [env.reset(seed=0)[1], *(env.step(action)[4] for action in SOLUTIONS[0])]
        for info in infos:
            assert set(info) - {"outcome"} == parts
            assert set(info["console"]) == set(CONSOLE)
            assert all(type(value) is int for value in info["console"].values())
    many = OpenLockVectorEnv(2, "CC4", "trial7", episode=episode, **reveal)
    for info in (many.reset(seed=0)[1], many.step(np.array([0, 1]))[4]):
        assert set(info) == parts
        assert set(info["console"]) == set(CONSOLE)
        assert all(isinstance(value, np.ndarray) for value in info["console"].values())


def test_what_is_latent_in_one_room_and_in_many() -> None:
    env = trial7(reveal=True)
    info = env.reset(seed=0)[1]
    assert info["latent"] == {
        "schema": "CC4",
        "layout": (
            ("L0", "LOWERLEFT"),
            ("L1", "UPPERRIGHT"),
            ("L2", "LOWERRIGHT"),
            ("L3", "UPPERLEFT"),
        ),
        "solutions": (("L0", "L1"), ("L0", "L2"), ("L0", "L3")),
        "found": (),
    }
    many = OpenLockVectorEnv(2, "CC4", "trial7", reveal=True)
    latent = many.reset(seed=0)[1]["latent"]
    rooms = latent["tables"].room[latent["row"]]
    assert [latent["tables"].rooms[room].schema.name for room in rooms] == ["CC4", "CC4"]


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("schema", ["CC4", "noisy_CC3"])
def test_arrays_that_were_handed_out_never_change_later(schema: str, episode: Any) -> None:
    generator = np.random.default_rng(0)
    env = OpenLockVectorEnv(20, schema, "random", "paper", episode, attempt_limit=3, reveal=True)

    def arrays(seen: Any, *rest: Any) -> list[np.ndarray]:
        *results, info = rest
        return [seen, *results, *info["console"].values(), info["latent"]["row"]]

    handed_out = arrays(*env.reset(seed=0))
    copies = [array.copy() for array in handed_out]
    for step in range(100):
        new = arrays(*env.step(generator.integers(15, size=20)))
        if step % 40 == 39:
            new += arrays(*env.reset(options={"reset_mask": generator.random(20) < 0.5}))
        handed_out += new
        copies += [array.copy() for array in new]
    for array, copy in zip(handed_out, copies, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_changing_what_was_handed_out_cannot_change_many_rooms() -> None:
    env, kept = (OpenLockVectorEnv(4, "CC4", "trial7", "paper", reveal=True) for _ in range(2))
    generator = np.random.default_rng(0)
    env.reset(seed=0)
    kept.reset(seed=0)
    for _ in range(60):
        actions = generator.choice([L0, L1, L2, L3, DOOR], size=4)
        given = actions.copy()
        *results, info = env.step(given)
        *expected, expected_info = kept.step(actions)
        for one, other in zip(results, expected, strict=True):
            np.testing.assert_array_equal(one, other)
        for key in CONSOLE:
            np.testing.assert_array_equal(info["console"][key], expected_info["console"][key])
        for array in (*results, given, *info["console"].values(), info["latent"]["row"]):
            if array.flags.writeable:
                array[:] = 1
