"""The Gymnasium environments: episodes, errors, and one room against many."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import causal_openlock
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.errors import LayoutError, OpenLockError, ProtocolError, RewardError
from causal_openlock.protocol import MAX_ACTION_LIMIT
from causal_openlock.rewards import PRESETS
from causal_openlock.room import Layout, Room
from causal_openlock.schema import Gate, Schema
from causal_openlock.schema_file import bundled_schemas, write_schema

SCHEMAS = bundled_schemas()
EPISODES = ("attempt", "trial")
# CC4 in trial7, by role.
L0, L1, L2, L3, WHITE, DOOR = 4, 0, 6, 2, 1, 14
SOLUTIONS = [(L0, L1, DOOR), (L0, L2, DOOR), (L0, L3, DOOR)]
NOTHING = (WHITE, WHITE, WHITE)
CONSOLE = ("solutions_left", "solutions_found", "attempts_left", "actions_left")


def trial7(**arguments: Any) -> OpenLockEnv:
    env = OpenLockEnv("CC4", "trial7", **arguments)
    env.reset(seed=0)
    return env


def act(env: gymnasium.Env[Any, Any], actions: tuple[int, ...]) -> tuple[Any, ...]:
    """What the last of these actions leads to."""
    for action in actions:
        result = env.step(action)
    return result


def attempt(env: gymnasium.Env[Any, Any], actions: tuple[int, ...]) -> tuple[Any, ...]:
    """A reset, these actions, and what the last of them leads to."""
    env.reset()
    return act(env, actions)


def left(info: dict[str, Any]) -> tuple[int, int]:
    """Solutions and attempts left."""
    return info["console"]["solutions_left"], info["console"]["attempts_left"]


# -- the checkers of other packages ---------------------------------------------------------------


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


# -- making one -----------------------------------------------------------------------------------

MINE = Schema("mine", ["A", "B"], {"A": ["door"], "B": ["door"]}, gates={"door": Gate("all")})


def test_a_schema_is_given_by_name_by_path_or_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    write_schema(MINE, path)
    for schema, name in (("CE3", "CE3"), (path, "mine"), (str(path), "mine"), (MINE, "mine")):
        env = gymnasium.make(causal_openlock.ENV_ID, schema=schema)
        _, info = env.reset(seed=0)
        assert info["latent"]["schema"] == name
    with pytest.raises(OpenLockError, match="there is no schema 'CC33'; did you mean CC3"):
        gymnasium.make(causal_openlock.ENV_ID, schema="CC33")


def test_a_layout_is_given_by_name_as_a_mapping_or_drawn() -> None:
    mapping = {"L0": "LEFT", "L1": "LOWER", "L2": "UPPER"}
    for layout in ("trial2", mapping, Layout((3, 5, 1))):
        env = gymnasium.make(causal_openlock.ENV_ID, schema="CC3", layout=layout)
        seen, info = env.reset(seed=0)
        assert np.flatnonzero(seen[7:14]).tolist() == [1, 3, 5]
        assert dict(info["latent"]["layout"]) == mapping
    env = gymnasium.make(causal_openlock.ENV_ID, schema="CC3", layout="random")
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


# -- episodes that are attempts -------------------------------------------------------------------


def test_an_attempt_terminates_when_the_door_opens_or_its_actions_are_spent() -> None:
    env = trial7(action_limit=5)
    flags = [env.step(action)[2:4] for action in SOLUTIONS[0]]
    assert flags == [(False, False), (False, False), (True, False)]
    env.reset()
    flags = [env.step(WHITE)[2:4] for _ in range(5)]
    assert flags == [(False, False)] * 4 + [(True, False)]


def test_the_last_observation_of_an_attempt_is_the_room_as_it_was_left() -> None:
    seen, *_ = attempt(trial7(), SOLUTIONS[0])
    assert np.flatnonzero(seen[:7]).tolist() == [L1, L0]
    assert seen[-2:].tolist() == [0, 1]


def test_reset_begins_the_next_attempt_in_the_same_room_and_the_console_counts() -> None:
    env = OpenLockEnv("CC4", "random")
    seen, info = env.reset(seed=3)
    rooms = {info["latent"]["layout"]}
    for number in range(29):
        assert left(info) == (3, 30 - number)
        assert info["console"]["actions_left"] == 3
        *_, info = act(env, (14, 14, 14))
        assert left(info) == (3, 30 - number), "the attempt counts as used once the next begins"
        assert info["console"]["actions_left"] == 0
        again, info = env.reset()
        rooms.add(info["latent"]["layout"])
        assert (again == seen).all()
    assert len(rooms) == 1


def test_a_new_solution_counts_and_a_repeated_one_does_not() -> None:
    env = trial7()
    *_, info = attempt(env, SOLUTIONS[1])
    assert info["console"] == dict(zip(CONSOLE, (2, 1, 30, 0), strict=True))
    assert info["latent"]["found"] == (1,)
    *_, info = attempt(env, SOLUTIONS[1])
    assert info["console"] == dict(zip(CONSOLE, (2, 1, 29, 0), strict=True))
    *_, info = attempt(env, SOLUTIONS[0])
    assert info["console"] == dict(zip(CONSOLE, (1, 2, 28, 0), strict=True))


def test_once_everything_is_found_reset_begins_a_new_trial() -> None:
    env = OpenLockEnv("CC4", "random")
    layouts = []
    for seed in range(5):
        _, info = env.reset(seed=seed)
        layouts.append(info["latent"]["layout"])
        room = Room.of(SCHEMAS["CC4"], dict(layouts[-1]))
        for count, levers in enumerate(SCHEMAS["CC4"].solutions, start=1):
            *_, info = act(env, tuple(room.action_of(levers)))
            assert left(info) == (3 - count, 31 - count)
            _, info = env.reset()
        assert left(info) == (3, 30)
        layouts.append(info["latent"]["layout"])
    assert len(set(layouts)) > 5, "a new trial draws another layout"


def test_once_the_attempts_are_spent_reset_begins_a_new_trial() -> None:
    env = OpenLockEnv("CC4", "random", attempt_limit=2)
    _, info = env.reset(seed=1)
    first = info["latent"]["layout"]
    layouts = set()
    for _ in range(10):
        act(env, NOTHING)
        assert left(env.reset()[1])[1] == 1
        act(env, NOTHING)
        _, info = env.reset()
        assert left(info) == (3, 2)
        layouts.add(info["latent"]["layout"])
    assert layouts != {first}


def test_a_reset_in_mid_attempt_spends_the_attempt() -> None:
    env = trial7(attempt_limit=3)
    env.step(L0)
    assert left(env.reset()[1]) == (3, 2)
    assert left(env.reset()[1]) == (3, 2), "nothing was done, so nothing is spent"
    act(env, NOTHING)
    assert left(env.reset()[1]) == (3, 1), "an attempt that is over is not spent again"
    env.step(L0)
    assert left(env.reset()[1]) == (3, 3), "that was the last one"


@pytest.mark.parametrize("episode", EPISODES)
def test_a_seed_and_the_option_new_trial_begin_a_new_trial(episode: Any) -> None:
    for arguments in ({"seed": 5}, {"options": {"new_trial": True}}):
        env = trial7(episode=episode)
        act(env, SOLUTIONS[0])
        if episode == "attempt":
            env.reset()
        env.step(L0)
        seen, info = env.reset(**arguments)  # type: ignore[arg-type]
        assert left(info) == (3, 30)
        assert info["latent"]["found"] == ()
        assert not seen[:7].any()
    env = trial7()
    act(env, NOTHING)
    assert left(env.reset(options={"new_trial": False})[1]) == (3, 29)
    env = trial7()
    act(env, NOTHING)
    assert left(env.reset(options={})[1]) == (3, 29)


# -- episodes that are trials ---------------------------------------------------------------------


def test_after_an_attempt_a_trial_goes_on_in_the_room_put_back() -> None:
    env = trial7(episode="trial")
    start, _ = env.reset(seed=0)
    env.step(L0)
    _, _, _, _, info = env.step(L1)
    assert "outcome" not in info
    seen, reward, terminated, truncated, info = env.step(DOOR)
    assert (reward, terminated, truncated) == (50, False, False)
    assert (seen == start).all()
    assert info["console"] == dict(zip(CONSOLE, (2, 1, 29, 3), strict=True))
    assert info["outcome"][[L0, L1, L2, L3]].tolist() == [1, 1, 0, 0]
    assert info["outcome"][-2:].tolist() == [0, 1]
    seen, *_ = env.step(L0)
    assert np.flatnonzero(seen[:7]).tolist() == [L0]


def test_a_trial_terminates_when_everything_is_found() -> None:
    env = trial7(episode="trial")
    ends = [act(env, solution)[2:4] for solution in (SOLUTIONS[0], SOLUTIONS[0], SOLUTIONS[2])]
    assert ends == [(False, False)] * 3
    seen, _, terminated, truncated, info = act(env, SOLUTIONS[1])
    assert (terminated, truncated) == (True, False)
    assert left(info)[0] == 0
    assert info["outcome"][-1] == 1
    assert not seen[:7].any()
    assert left(env.reset()[1]) == (3, 30)


def test_a_trial_is_truncated_when_its_attempts_are_spent() -> None:
    env = trial7(episode="trial", attempt_limit=3)
    assert [act(env, NOTHING)[2:4] for _ in range(3)] == [(False, False)] * 2 + [(False, True)]
    # The last attempt may still find the last solution, and then nothing is cut short.
    env.reset()
    ends = [act(env, solution)[2:4] for solution in SOLUTIONS]
    assert ends == [(False, False)] * 2 + [(True, False)]


def test_a_repeat_does_not_reach_over_the_end_of_an_attempt() -> None:
    env = trial7(episode="trial", reward="negative_repeat")
    assert [env.step(WHITE)[1] for _ in range(6)] == [0, -0.25, -0.25, 0, -0.25, -0.25]


# -- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("action", [-1, 15, 10**20, 1.0, np.float64(2), None, "3", [1]])
def test_what_is_no_action_is_refused_and_changes_nothing(episode: Any, action: Any) -> None:
    env = trial7(episode=episode)
    env.step(L0)
    with pytest.raises(InvalidAction, match="an action is an integer from 0 to 14"):
        env.step(action)
    seen, *_, info = env.step(L1)
    assert np.flatnonzero(seen[:7]).tolist() == [L1, L0]
    assert info["console"]["actions_left"] == 1


def test_any_kind_of_integer_is_an_action() -> None:
    for kind in (int, np.int8, np.uint8, np.int64, np.uint64, np.array):
        assert trial7().step(kind(L0))[0][L0] == 1


@pytest.mark.parametrize("episode", EPISODES)
def test_a_step_outside_an_episode_asks_for_a_reset(episode: Any) -> None:
    env = OpenLockEnv("CC4", "trial7", episode=episode, attempt_limit=1)
    with pytest.raises(ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    act(env, NOTHING)
    for _ in range(2):
        with pytest.raises(ResetNeeded):
            env.step(0)
    env.reset()
    env.step(0)
    with pytest.raises(ResetNeeded):
        OpenLockEnv(render_mode="ansi").render()
    with pytest.raises(ResetNeeded):
        OpenLockVectorEnv(2).step(np.zeros(2, dtype=int))


@pytest.mark.parametrize(
    "actions",
    [
        np.zeros(2),
        np.zeros(3, dtype=int),
        np.zeros((2, 1), dtype=int),
        np.zeros(2, dtype=bool),
        0,
        None,
        [0, None],
        [0, 15],
        [-1, 0],
        np.array([0, 2**63], dtype=np.uint64),
    ],
)
def test_many_rooms_refuse_what_are_no_actions(actions: Any) -> None:
    env = OpenLockVectorEnv(2, "CC4", "trial7")
    env.reset(seed=0)
    with pytest.raises(InvalidAction):
        env.step(actions)
    seen, *_ = env.step(np.array([L0, WHITE]))
    assert seen[:, L0].tolist() == [1, 0]


# -- what is handed out ---------------------------------------------------------------------------


@pytest.mark.parametrize("episode", EPISODES)
def test_whoever_changes_what_was_handed_out_does_not_change_the_room(episode: Any) -> None:
    def ruin(seen: np.ndarray, info: dict[str, Any]) -> None:
        seen[:] = 7
        if "outcome" in info:
            info["outcome"][:] = 7
        for part in ("console", "latent"):
            info[part].update(dict.fromkeys(info[part], 99))

    ruined, kept = (OpenLockEnv("CC4", "trial7", episode=episode) for _ in range(2))
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
def test_what_is_latent_is_told_under_that_key_alone(episode: Any) -> None:
    env = trial7(episode=episode)
    infos = [env.reset(seed=0)[1], *(env.step(action)[4] for action in SOLUTIONS[0])]
    for info in infos:
        assert set(info) - {"outcome"} == {"console", "latent"}
        assert set(info["console"]) == set(CONSOLE)
        assert all(type(value) is int for value in info["console"].values())
    assert infos[0]["latent"] == {
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
    many = OpenLockVectorEnv(2, "CC4", "trial7", episode=episode)
    for info in (many.reset(seed=0)[1], many.step(np.array([0, 1]))[4]):
        assert set(info) == {"console", "latent"}
        assert set(info["console"]) == set(CONSOLE)
        assert all(isinstance(value, np.ndarray) for value in info["console"].values())


# -- chance ---------------------------------------------------------------------------------------


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


# -- many rooms against one -----------------------------------------------------------------------


class Singles:
    """Some single rooms, stepped and reset as a vector environment with NEXT_STEP does."""

    def __init__(self, many: int, **arguments: Any) -> None:
        self.rooms = [OpenLockEnv(**arguments) for _ in range(many)]
        self.ended = [False] * many

    def reset(self, seed: int) -> tuple[list[Any], list[dict[str, Any]]]:
        seen, infos = zip(*[room.reset(seed=seed) for room in self.rooms], strict=True)
        return list(seen), list(infos)

    def step(self, actions: np.ndarray) -> tuple[list[Any], ...]:
        results = []
        for index, (room, action) in enumerate(zip(self.rooms, actions.tolist(), strict=True)):
            if self.ended[index]:
                seen, info = room.reset()
                result: tuple[Any, ...] = (seen, 0.0, False, False, info)
            else:
                result = room.step(action)
            self.ended[index] = result[2] or result[3]
            results.append(result)
        return tuple(map(list, zip(*results, strict=True)))


def assert_same_console(many: dict[str, Any], singles: list[dict[str, Any]]) -> None:
    for key in CONSOLE:
        assert many["console"][key].tolist() == [info["console"][key] for info in singles], key


class Lively:
    """Actions for many rooms that often follow a solution, sometimes repeat, and sometimes err."""

    def __init__(self, room: Room, many: int) -> None:
        paths = [room.action_of(levers) for levers in room.schema.solutions]
        longest = max(map(len, paths))
        self.paths = np.array([path + [14] * (longest - len(path)) for path in paths])
        self.generator = np.random.default_rng(0)
        self.which = np.zeros(many, dtype=int)
        self.last = np.zeros(many, dtype=int)

    def act(self, used: np.ndarray) -> np.ndarray:
        """What to do after so many actions of the attempt."""
        many = len(used)
        other = self.generator.integers(len(self.paths), size=many)
        self.which = np.where(used == 0, other, self.which)
        on_path = self.paths[self.which, np.minimum(used, self.paths.shape[1] - 1)]
        chance = self.generator.random(many)
        any_action = self.generator.integers(15, size=many)
        self.last = np.where(chance < 0.1, any_action, np.where(chance < 0.2, self.last, on_path))
        return self.last


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
@pytest.mark.parametrize("schema", ["CC4", "noisy_CC3"])
def test_arrays_that_were_handed_out_never_change_later(schema: str, episode: Any) -> None:
    generator = np.random.default_rng(0)
    env = OpenLockVectorEnv(20, schema, "random", "paper", episode, attempt_limit=3)

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
    env, kept = (OpenLockVectorEnv(4, "CC4", "trial7", "paper") for _ in range(2))
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


def test_random_layouts_are_all_equally_likely_and_last_for_a_trial() -> None:
    many = 8400
    env = OpenLockVectorEnv(many, "CC3", "random", attempt_limit=2)
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


def test_each_of_many_random_rooms_is_the_room_of_its_layout() -> None:
    generator = np.random.default_rng(0)
    many = 30
    env = OpenLockVectorEnv(many, "CE3", "random", "authors_2018", "trial", attempt_limit=40)
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


# -- pictures -------------------------------------------------------------------------------------


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
