"""What environments are made of, what they draw, and what Gymnasium and others say of them."""

import warnings
from itertools import pairwise

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from causal_openlock.envs import OpenLockEnv, OpenLockTextEnv, OpenLockVectorEnv
from causal_openlock.render.paint import draw
from causal_openlock.render.scene import Look, frame
from causal_openlock.schemas.graphs import write_schema
from causal_openlock.schemas.schema import Gate, Schema
from causal_openlock.world.rewards import PRESETS
from causal_openlock.world.room import Layout
from support.env_play import CONSOLE, EPISODES, L0, L1, SOLUTIONS, WHITE, act, trial7

ROOM = "causal_openlock/OpenLock-v0"
each_episode = pytest.mark.parametrize("episode", EPISODES)


def test_schemas_layouts_and_rewards_are_given_by_name_as_data_or_as_objects(tmp_path):
    gates = {"door": Gate("all")}
    mine = Schema("mine", ["A", "B"], {"A": ["door"], "B": ["door"]}, gates=gates)
    write_schema(mine, path := tmp_path / "mine.yaml")
    for schema in (path, str(path), mine, mine.as_dict()):
        assert OpenLockEnv(schema, reveal=True).reset()[1]["latent"]["schema"] == "mine"
    mapping = {"L0": "LEFT", "L1": "LOWER", "L2": "UPPER"}
    for layout in ("trial2", mapping, Layout((3, 5, 1))):
        seen, info = OpenLockEnv("CC3", layout, reveal=True).reset(seed=0)
        assert np.flatnonzero(seen[7:14]).tolist() == [1, 3, 5]
        assert dict(info["latent"]["layout"]) == mapping
    terms = ["basic", "negative_immovable", "partial_sequence", "solution_multiplier"]
    for reward in ("paper", terms, tuple(terms), PRESETS["paper"]):
        env = trial7(reward=reward)
        assert [env.step(action)[1] for action in SOLUTIONS[0]] == [1, 10, 50]
    env = trial7()
    assert [env.step(action)[1] for action in SOLUTIONS[0]] == [0, 10, 50], "basic by default"


def test_everything_can_be_set_through_gymnasium_for_one_room_and_for_many():
    arguments = {
        **{"schema": "CC3", "layout": {"L0": "P0", "L1": "P8", "L2": "P3"}, "positions": 9},
        **{"reward": ["basic", "state_change"], "episode": "trial"},
        **{"attempt_limit": np.int64(7), "action_limit": np.uint8(5)},
    }
    env = gymnasium.make(ROOM, **arguments, render_mode="ansi")
    vector = {"num_envs": 3, "vectorization_mode": "vector_entry_point"}
    many = gymnasium.make_vec(ROOM, **vector, **arguments)
    assert isinstance(many, OpenLockVectorEnv)
    assert many.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    seen, info = env.reset(seed=0)
    seen_by_many, info_of_many = many.reset(seed=0)
    spaces = gymnasium.spaces.MultiBinary(20), gymnasium.spaces.Discrete(19)
    assert (env.observation_space, env.action_space) == spaces
    assert (many.single_observation_space, many.single_action_space) == spaces
    assert seen.tolist() == [0] * 9 + [1, 0, 0, 1, 0, 0, 0, 0, 1] + [1, 0]
    assert seen_by_many.tolist() == [seen.tolist()] * 3
    for name, value in zip(CONSOLE, (2, 0, 7, 5), strict=True):
        assert info["console"][name] == value
        assert info_of_many["console"][name].tolist() == [value] * 3
    assert [env.step(action)[1] for action in (0, 8, 18)] == [0.5, 10.5, 50.5]
    paid = [many.step(np.full(3, action))[1].tolist() for action in (0, 8, 18)]
    assert paid == [[0.5] * 3, [10.5] * 3, [50.5] * 3]


def test_limits_and_sizes_follow_from_schema_and_layout_unless_given():
    one = Schema("one", ["A"], {"A": ["door"]})
    for schema, expected in (("CC3", 3), (one, 3), ("chain3", 4), ("seven", 4)):
        assert OpenLockEnv(schema).reset()[1]["console"]["actions_left"] == expected
    env = trial7(action_limit=63)
    *_, terminated, _, info = act(env, (WHITE,) * 62)
    assert (terminated, info["console"]["actions_left"]) == (False, 1)
    assert env.step(WHITE)[2] is True
    assert OpenLockEnv("CC3", Layout((0, 1, 8), 9)).action_space == gymnasium.spaces.Discrete(19)
    seen, _ = OpenLockEnv("CC3", Layout((0, 1, 6)), positions=10).reset()
    assert np.flatnonzero(seen).tolist() == [10, 11, 16, 20]


@each_episode
@pytest.mark.parametrize("checker", ["gymnasium.utils", "stable_baselines3.common"])
@pytest.mark.parametrize("schema", ["CC4", "noisy_CC3", "seven", "CC3"])
def test_others_checkers_find_nothing(checker, schema, episode, monkeypatch):
    check = pytest.importorskip(f"{checker}.env_checker").check_env

    def complain(message, *_):
        raise AssertionError(message)

    monkeypatch.setattr(gymnasium.logger, "warn", complain)
    arguments = {"schema": schema, "episode": episode, "physics": schema == "CC3"}
    made = gymnasium.make(ROOM, **arguments, render_mode="rgb_array")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check(made.unwrapped)


def test_a_room_is_drawn_as_text_or_as_a_picture_that_changes_with_it():
    for mode in ("ansi", "rgb_array"):
        with pytest.raises(ResetNeeded):
            OpenLockEnv(render_mode=mode).render()
        env = trial7(render_mode=mode)
        shown = [env.render()]
        for action in (WHITE, *SOLUTIONS[0][:2]):
            env.step(action)
            shown.append(env.render())
        assert np.array_equal(shown[0], shown[1])
        assert all(not np.array_equal(one, other) for one, other in pairwise(shown[1:]))
    with pytest.warns(UserWarning, match="'ansi' or 'rgb_array'"):
        assert trial7().render() is None
    for size in (64, 333):
        picture = trial7(render_mode="rgb_array", render_size=size).render()
        assert picture.shape == (size, frame(7, size).width, 3)
        np.testing.assert_array_equal(
            picture, draw(Look.of_observation(trial7().reset()[0], 7), size)
        )


def test_the_console_stands_beside_the_room_and_ticks_solutions_off():
    env = trial7(render_mode="rgb_array", render_console=True)
    plain = trial7(render_mode="rgb_array").render()
    shown, width = [env.render()], plain.shape[1]
    np.testing.assert_array_equal(shown[0][:, :width], plain)
    for actions in ((WHITE,), SOLUTIONS[0]):
        act(env, actions)
        shown.append(env.render())
        env.reset()
    consoles = [picture[:, width:].astype(int) for picture in shown]
    assert all((one != other).any() for one, other in pairwise(consoles))
    green = [(console[..., 1] - console[..., 0] > 60).sum() for console in consoles]
    assert green[0] == green[1] == 0
    assert green[2] > 50


@each_episode
def test_a_physical_room_is_drawn_as_its_bodies_are(episode):
    arguments = {"render_mode": "rgb_array", "physics": True, "episode": episode}
    env, symbolic = trial7(**arguments), trial7(render_mode="rgb_array")
    assert np.abs(env.render().astype(int) - symbolic.render()).max() <= 2
    for action in (L0, L1):
        seen, *_ = env.step(action)
        picture, look = env.render(), Look.of_pose(env.physical_room.pose(), seen[7:14] == 1)
        assert (picture == draw(look, 600)).all()
        assert (picture != symbolic.render()).any()


def test_a_room_in_words_goes_as_that_of_bits():
    bits = OpenLockEnv("CC4", "trial8", "paper", "trial", 40)
    words = OpenLockTextEnv("CC4", "trial8", "paper", 40, render_mode="ansi")
    with pytest.raises(ResetNeeded):
        words.step("push oak")
    bits.reset(seed=0)
    text, info = words.reset(seed=0)
    assert "Left: 3 combinations, 40 attempts, 3 actions" in text
    with pytest.raises(InvalidAction):
        words.step(3)
    text, reward, *_, info = words.step("What would you do?")
    assert (words.render(), reward, info["action"]) == (text, 0, None)
    assert info["console"]["actions_left"] == 3
    generator, ended = np.random.default_rng(1), [False]
    while not any(ended):
        action = int(generator.choice([0, 2, 3, 5, 14]))
        _, reward, *ended, expected = bits.step(action)
        _, *answer, info = words.step(words._words.actions[action])
        assert answer == [reward, *ended]
        assert (info["console"], info["action"]) == (expected["console"], action)
    with pytest.raises(ResetNeeded):
        words.step("push oak")
    told = [words.reset(seed=seed)[1]["actions"] for seed in (1, 2, 1, None)]
    assert told[0] == told[2] == told[3] != told[1]
    check_env(gymnasium.make("causal_openlock/OpenLockText-v0", render_mode="ansi").unwrapped)
