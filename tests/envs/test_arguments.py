"""Arguments of environments: what cannot be meant is a sentence; NumPy's numbers are numbers."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest

from causal_openlock import Layout, OpenLockError, find_reward, find_schema
from causal_openlock.envs import MixedRoomsEnv, OpenLockEnv, OpenLockVectorEnv


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"attempt_limit": 2.5}, "attempt_limit must be a whole number"),
        ({"attempt_limit": "3"}, "attempt_limit must be a whole number"),
        ({"attempt_limit": None}, "attempt_limit must be a whole number"),
        ({"attempt_limit": True}, "attempt_limit must be a whole number"),
        ({"action_limit": 3.0}, "action_limit must be a whole number"),
        ({"positions": "7"}, "positions must be a whole number"),
        ({"layout": None}, "layout is a name"),
        ({"layout": 3}, "layout is a name"),
    ],
)
@pytest.mark.parametrize("kind", [OpenLockEnv, OpenLockVectorEnv])
def test_arguments_that_cannot_be_meant_are_a_sentence(
    kind: Any, arguments: dict[str, Any], said: str
) -> None:
    with pytest.raises(OpenLockError, match=said):
        kind(**arguments)


@pytest.mark.parametrize("number", [np.int64(2), np.uint8(2)])
def test_numbers_of_numpy_are_numbers(number: Any) -> None:
    env = OpenLockEnv(attempt_limit=number, positions=np.int32(8))
    env.reset(seed=0)
    assert env.observation_space.shape == (18,)


@pytest.mark.parametrize("rooms", [["CC3"], "CC3", [3]])
def test_rooms_that_are_no_arguments_are_a_sentence(rooms: Any) -> None:
    with pytest.raises(OpenLockError, match="rooms are a list of the arguments of each"):
        MixedRoomsEnv(rooms)


WRONG_MASKS: list[Any] = [[True], [True, False], [1, 0, 1], np.ones(4, bool), np.ones((3, 1), bool)]


@pytest.mark.parametrize("mask", [*WRONG_MASKS, "all", [None] * 3])
def test_a_mask_that_is_not_one_of_the_rooms_is_a_sentence(mask: Any) -> None:
    rooms = OpenLockVectorEnv(3)
    rooms.reset(seed=0)
    with pytest.raises(OpenLockError, match="reset_mask is a boolean array of 3"):
        rooms.reset(options={"reset_mask": mask})


def test_a_mask_resets_the_rooms_that_it_names() -> None:
    rooms = OpenLockVectorEnv(3, schema="CC3", layout="trial1")
    rooms.reset(seed=0)
    rooms.step(np.zeros(3, int))
    _, info = rooms.reset(options={"reset_mask": [True, False, True]})
    assert info["console"]["actions_left"].tolist() == [3, 2, 3]


def layouts(rooms: OpenLockVectorEnv, seed: Any) -> list[Any]:
    _, info = rooms.reset(seed=seed)
    tables, rows = info["latent"]["tables"], info["latent"]["row"]
    return [tuple(tables.observation[row].tolist()) for row in rows]


def test_seeds_of_rooms() -> None:
    rooms = OpenLockVectorEnv(40, reveal=True)
    drawn = [str(layouts(rooms, [None] * 40)) for _ in range(3)]
    assert len({*drawn}) == 3  # no seed is not a seed of 0
    assert layouts(rooms, [*range(40)]) == layouts(rooms, [*range(40)])
    assert layouts(rooms, tuple(range(40))) == layouts(rooms, [*range(40)])
    for wrong in ([1, 2], [], [None] * 41):
        with pytest.raises(OpenLockError, match=r"seeds for 40 rooms; give one for each, or one"):
            rooms.reset(seed=wrong)
    with pytest.raises(OpenLockError, match="seed must be a whole number"):
        rooms.reset(seed=[0.5] * 40)


def test_a_process_that_has_not_imported_the_package_makes_rooms() -> None:
    """As the workers of SubprocVecEnv: the module before the colon is imported."""
    code = (
        "import gymnasium; print(gymnasium.make("
        "'causal_openlock:causal_openlock/OpenLock-v0', schema='CC3').reset(seed=0)[0].shape)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "(16,)" in done.stdout


def made_anew(env: Any) -> Any:
    """The environment that Gymnasium makes of the JSON of another one's spec."""
    return gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))


@pytest.mark.parametrize(
    ("kind", "arguments"),
    [
        ("OpenLock", {"schema": find_schema("CE4"), "attempt_limit": np.int64(7)}),
        ("OpenLock", {"layout": Layout((0, 8, 3), 9), "reward": find_reward("paper")}),
        ("OpenLock", {"reward": find_reward({"terms": ["basic"], "open": 5})}),
        ("OpenLockText", {"schema": find_schema("CE3"), "story": "levers"}),
        ("MixedRooms", {"rooms": ({"schema": find_schema("CC3")}, {"schema": "CE3"})}),
    ],
)
def test_what_was_made_with_objects_is_made_again_from_json(
    kind: str, arguments: dict[str, Any]
) -> None:
    env = gymnasium.make(f"causal_openlock/{kind}-v0", **arguments)
    again = made_anew(env)
    assert again.spec.to_json() == env.spec.to_json()
    first, second = env.reset(seed=3)[0], again.reset(seed=3)[0]
    assert np.array_equal(first, second)
    for action in [0, 5, 3, 2, 6, 1] * 2 if kind == "OpenLock" else ():
        before, after = env.step(action), again.step(action)
        assert np.array_equal(before[0], after[0])
        assert before[1:4] == after[1:4]
        if before[2] or before[3]:
            env.reset(), again.reset()


def test_a_batch_says_that_its_limits_are_the_rooms_own() -> None:
    with pytest.raises(OpenLockError, match="no max_episode_steps; give attempt_limit"):
        gymnasium.make_vec("causal_openlock/OpenLock-v0", num_envs=2, max_episode_steps=5)
    made = gymnasium.make_vec("causal_openlock/OpenLock-v0", num_envs=2, schema=find_schema("CE3"))
    assert '"CE3"' in made.spec.to_json()


def test_workers_of_stable_baselines_make_rooms(tmp_path: Path) -> None:
    pytest.importorskip("stable_baselines3")
    (tmp_path / "train.py").write_text(
        "import gymnasium\n"
        "from stable_baselines3.common.vec_env import SubprocVecEnv\n"
        "def room():\n"
        "    return gymnasium.make('causal_openlock:causal_openlock/OpenLock-v0', schema='CC3')\n"
        "if __name__ == '__main__':\n"
        "    rooms = SubprocVecEnv([room, room], start_method='forkserver')\n"
        "    print(rooms.reset().shape)\n"
        "    rooms.close()\n"
    )
    words = [sys.executable, "train.py"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "(2, 16)" in done.stdout
