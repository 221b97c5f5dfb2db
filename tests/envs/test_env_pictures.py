"""What an environment draws."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest

import causal_openlock
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.render.room import draw_room
from causal_openlock.render.scene import frame
from support.cc4_in_trial7 import DOOR, L0, L1, SOLUTIONS, WHITE
from support.env_play import EPISODES, act, trial7

RED = [255, 0, 0]


def test_a_room_is_drawn_as_text_or_as_a_picture_that_changes_with_it() -> None:
    frames: dict[str, list[Any]] = {"ansi": [], "rgb_array": []}
    for mode, shown in frames.items():
        env = trial7(render_mode=mode)
        shown.append(env.render())
        for action in SOLUTIONS[0]:
            env.step(action)
            shown.append(env.render())
    assert all(isinstance(text, str) for text in frames["ansi"])
    assert len(set(frames["ansi"])) == 4
    assert "locked" in frames["ansi"][0]
    assert "open" in frames["ansi"][3]
    pictures = frames["rgb_array"]
    assert all(picture.dtype == np.uint8 and picture.shape[2] == 3 for picture in pictures)
    assert all((one != other).any() for one, other in pairwise(pictures))


def test_a_step_that_changes_nothing_is_drawn_as_before() -> None:
    env = trial7(render_mode="rgb_array")
    before = env.render()
    env.step(WHITE)
    np.testing.assert_array_equal(env.render(), before)


def test_render_without_a_mode_says_what_to_do() -> None:
    with pytest.warns(UserWarning, match="render_mode='ansi' or 'rgb_array'"):
        assert trial7().render() is None


@pytest.mark.parametrize("size", [64, 333, 1000])
def test_a_picture_has_the_size_that_is_asked_for(size: int) -> None:
    env = trial7(render_mode="rgb_array", render_size=size)
    picture = env.render()
    assert picture.shape == (size, frame(7, size).width, 3)
    np.testing.assert_array_equal(picture, draw_room(env.reset()[0], 7, size))


@pytest.mark.parametrize("size", [0, 31, 5000, 600.0, True, "large"])
def test_a_size_that_is_none_is_refused(size: Any) -> None:
    with pytest.raises(OpenLockError, match="render_size is the height of a picture in pixels"):
        OpenLockEnv(render_size=size)


def test_the_console_stands_beside_the_room_and_changes_with_what_it_says() -> None:
    env = trial7(render_mode="rgb_array", render_console=True)
    plain = trial7(render_mode="rgb_array")
    room = plain.render().shape[1]
    at_first = env.render()
    np.testing.assert_array_equal(at_first[:, :room], plain.render())
    assert at_first.shape[1] > room + 300
    env.step(WHITE)
    after = env.render()
    np.testing.assert_array_equal(after[:, :room], at_first[:, :room])
    assert (after[:, room:] != at_first[:, room:]).any()  # one action less


def test_a_solution_found_is_ticked_on_the_console() -> None:
    green = np.array([0, 120, 62])

    def ticks() -> int:
        return int((np.abs(env.render().astype(int) - green).max(axis=2) < 3).sum())

    env = trial7(render_mode="rgb_array", render_console=True)
    assert ticks() == 0
    act(env, SOLUTIONS[0])
    one = ticks()
    assert one > 50
    env.reset()
    assert ticks() == one
    act(env, SOLUTIONS[1])
    assert 1.8 * one < ticks() < 2.2 * one


@pytest.mark.parametrize("episode", EPISODES)
def test_a_physical_room_is_drawn_as_its_bodies_are(episode: Any) -> None:
    env = trial7(render_mode="rgb_array", physics=True, episode=episode)
    symbolic = trial7(render_mode="rgb_array")
    assert np.abs(env.render().astype(int) - symbolic.render()).max() <= 2
    shown = frame(7, 600)
    for action in (L0, L1, WHITE):
        env.step(action)
        if action == WHITE and episode == "trial":
            break  # the room is put back
        picture, pose = env.render(), env.physical_room.pose()
        for joint in pose.joints[:-1]:
            column, row = shown.pixel(joint)
            assert picture[int(row), int(column)].tolist() == RED
        assert (picture != symbolic.render()).any()


def test_gymnasium_makes_a_room_that_is_drawn_physically() -> None:
    env = gymnasium.make(
        causal_openlock.ENV_ID,
        schema="CC4",
        layout="trial7",
        physics=True,
        render_mode="rgb_array",
        render_size=120,
        render_console=True,
    )
    env.reset(seed=0)
    before: Any = env.render()
    for action in (L0, L1, DOOR):
        env.step(action)
    after: Any = env.render()
    assert before.shape == after.shape
    assert before.shape[0] == 120
    # Where the swung door is, nothing was before.
    x, y = frame(7, 120).pixel((3.6 + 1.5 * np.sin(np.pi / 3), 1.0 - 1.5 * np.cos(np.pi / 3)))
    assert before[int(y), int(x)].tolist() == [255, 255, 255]
    assert after[int(y), int(x)].tolist() != [255, 255, 255]


def test_many_rooms_at_once_are_not_simulated_and_say_so() -> None:
    with pytest.raises(OpenLockError, match=r"not simulated; use OpenLockEnv\(physics=True\)"):
        OpenLockVectorEnv(2, physics=True)
    with pytest.raises(OpenLockError, match="not simulated"):
        gymnasium.make_vec(
            causal_openlock.ENV_ID,
            num_envs=2,
            vectorization_mode="vector_entry_point",
            physics=True,
        )
    assert OpenLockVectorEnv(2, physics=False).num_envs == 2
