"""Sessions: what subjects meet, what is recorded, and what no learner can know."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields, is_dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
import pytest

from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import LearnerError, ProtocolError
from causal_openlock.learner import Brief, Console, InformedLearner, Learner, Step, Truth, View
from causal_openlock.protocol import PAPER_CONDITIONS, PROTOCOLS, Condition, Protocol, Trials
from causal_openlock.randomness import Streams, generators
from causal_openlock.rewards import PRESETS
from causal_openlock.room import Layout
from causal_openlock.schema import Schema
from causal_openlock.schema_file import bundled_schemas, find_schema
from causal_openlock.session import Session
from learners.oracle import Oracle
from learners.random import RandomLearner

SCHEMAS = bundled_schemas()
HUMAN, RL = PROTOCOLS["human"], PROTOCOLS["rl"]
ONE = Schema("one", ["A"], {"A": ["door"]})


@cache
def named(name: str) -> Condition:
    return Condition.named(name, find_schema)


def play(
    player: Learner,
    condition: str | Condition,
    protocol: Protocol = HUMAN,
    subjects: Sequence[int] | int = 10,
    **arguments: Any,
) -> pd.DataFrame:
    condition = named(condition) if isinstance(condition, str) else condition
    return Session(condition, protocol, subjects, **arguments).play(player).to_pandas()


def one_room(schema: str | Schema, layout: str | Layout, trials: int = 1) -> Condition:
    """A baseline of trials in one room."""
    schema = SCHEMAS[schema] if isinstance(schema, str) else schema
    group = Trials(schema, (Layout.of(schema, layout),))
    return Condition("room", (group,) * trials)


def trials_of(record: pd.DataFrame) -> pd.DataFrame:
    """One row for each trial: how many attempts it took, what was found."""
    keys = ["subject", "phase", "loop", "trial"]
    return record.groupby(keys, observed=True).agg(
        attempts=("attempt", "max"),
        rows=("attempt", "size"),
        found=("solutions_found", "max"),
        solutions=("solutions", "max"),
        schema=("schema", "first"),
        layout=("layout", "first"),
    )


class Scripted(Learner):
    """Does what is written, a list of actions for each subject, and then nothing valid."""

    def __init__(self, *scripts: Sequence[int], afterwards: int = -1) -> None:
        super().__init__()
        self.scripts, self.afterwards = scripts, afterwards
        self.steps: list[Step] = []

    def begin(self, brief: Brief) -> None:
        self.moment = 0

    def act(self, view: View) -> np.ndarray:
        chosen = [
            script[self.moment] if self.moment < len(script) else self.afterwards
            for script in self.scripts
        ]
        self.moment += 1
        return np.array(chosen)

    def learn(self, step: Step) -> None:
        self.steps.append(step)


class Curious(Learner):
    """Draws among the grey levers and the door, and so finds solutions now and then."""

    def begin(self, brief: Brief) -> None:
        self.positions, self.streams = brief.positions, Streams(brief.generators)
        self.steps: list[Step] = []

    def act(self, view: View) -> np.ndarray:
        p = self.positions
        grey = view.observation[:, p : 2 * p]
        # Pushes of grey levers and, as often as any of them, the door.
        could = np.cumsum(np.column_stack([grey, np.ones(len(grey))]), axis=1)
        which = (could > (self.streams.uniform() * could[:, -1])[:, None]).argmax(axis=1)
        return np.where(which == p, 2 * p, which)

    def learn(self, step: Step) -> None:
        self.steps.append(step)


# -- bounds ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("condition", PAPER_CONDITIONS)
def test_the_oracle_needs_as_many_attempts_as_there_are_solutions(condition: str) -> None:
    trials = trials_of(play(Oracle(), condition, subjects=12))
    assert len(trials) == 12 * (5 if "-" not in condition else 7)
    three = trials.schema.isin(["CC3", "CE3"])
    assert (trials.attempts[three] == 2).all()
    assert (trials.attempts[~three] == 3).all()
    assert (trials.found == trials.solutions).all()


def test_the_random_learner_almost_never_solves_a_trial() -> None:
    record = play(RandomLearner(), "CC4", subjects=100)
    trials = trials_of(record)
    assert (trials.found == trials.solutions).mean() < 0.01
    assert (trials.attempts == 30).mean() > 0.99
    # Three of the 3,375 sequences open the door.
    assert record.opened.mean() == pytest.approx(3 / 3375, abs=5 * np.sqrt(3 / 3375 / len(record)))


# -- the same rooms as an environment's -----------------------------------------------------------


def layout_of(name: str, schema: Schema) -> Any:
    if name.startswith("trial"):
        return name
    return dict(zip(schema.levers, name.split(), strict=True))


@pytest.mark.parametrize("reward", ["paper", "unique_solutions", "negative_repeat", "authors_2018"])
@pytest.mark.parametrize("layouts", ["published", "random"])
def test_a_session_is_what_each_subject_would_have_met_alone(reward: str, layouts: Any) -> None:
    """Replayed subject by subject through the environment, action by action."""
    learner = Curious()
    protocol = replace(HUMAN, layouts=layouts, attempt_limit=20, test_trials=2)
    record = play(learner, "CC3-CE4", protocol, 4, reward=reward, seed=3)
    assert record.new_solution.sum() > 10
    for number, (_, attempts) in enumerate(record.groupby("subject")):
        moment = 0
        for _, trial in attempts.groupby(["phase", "loop", "trial"], observed=True, sort=False):
            schema = SCHEMAS[trial.schema.iloc[0]]
            env = OpenLockEnv(
                schema, layout_of(trial.layout.iloc[0], schema), reward, "attempt", 20
            )
            seen, info = env.reset(seed=0)
            found = 0
            for row in trial.itertuples():
                total = 0.0
                for index, action in enumerate(row.actions):
                    step = learner.steps[moment]
                    moment += 1
                    assert step.action[number] == action
                    assert (step.view.observation[number] == seen).all()
                    console = {
                        field.name: int(getattr(step.view.console, field.name)[number])
                        for field in fields(Console)
                    }
                    assert console == info["console"]
                    before = seen
                    seen, paid, terminated, _, info = env.step(int(action))
                    assert (step.outcome[number] == seen).all()
                    assert step.reward[number] == paid
                    assert step.attempt_over[number] == terminated
                    assert row.moved[index] == (seen != before).any()
                    total += float(paid)
                assert terminated
                assert step.new_solution[number] == row.new_solution
                assert row.new_solution == (len(info["latent"]["found"]) > found)
                found = len(info["latent"]["found"])
                assert row.reward == pytest.approx(total)
                assert row.opened == seen[-1]
                assert row.solutions_found == info["console"]["solutions_found"] == found
                seen, info = env.reset()
                if not step.trial_over[number]:
                    assert (step.next.observation[number] == seen).all()
            # The environment goes on to a new trial exactly where the session does.
            assert info["console"]["attempts_left"] == 20
            assert info["console"]["solutions_found"] == 0
            assert step.trial_over[number]


def test_under_the_rl_protocol_a_trial_goes_on_after_everything_is_found() -> None:
    protocol = replace(RL, attempt_limit=12, baseline_loops=2)
    record = play(Oracle(), "CC4", protocol, 5)
    trials = trials_of(record)
    assert len(trials) == 5 * 5 * 2
    assert (trials.attempts == 12).all()
    assert (trials.rows == 12).all()
    assert (trials.found == 3).all()
    # Found afresh in every visit, and not again afterwards.
    assert (record[record.attempt > 3].category == "open1").all()
    firsts = record[record.attempt <= 3].groupby("attempt").category.unique()
    assert [list(values) for values in firsts] == [["open1"], ["open2"], ["open3"]]
    assert record.new_solution.sum() == 3 * len(trials)


def test_under_the_human_protocol_the_solving_attempt_is_the_last() -> None:
    record = play(Curious(), "CC3", replace(HUMAN, attempt_limit=40), 20)
    trials = trials_of(record)
    assert (trials.rows == trials.attempts).all()
    solved = trials.found == trials.solutions
    assert solved.any()
    assert (trials.attempts[~solved] == 40).all()
    last = record.groupby(["subject", "loop", "trial"]).tail(1)
    assert (last.new_solution.to_numpy() >= solved.to_numpy()).all()


# -- the record against a log written by hand -----------------------------------------------------

# CC4 in trial7, by role; pulls are 7 above.
L0, L1, L2, L3, WHITE, DOOR = 4, 0, 6, 2, 1, 14
F, T = False, True
BY_HAND: list[tuple[list[int], list[bool], bool, bool, int, bool, int, str, float]] = [
    # actions, moved, unlocked, opened, solution, new, found so far, category, the paper's reward
    ([L1, L0, DOOR], [F, T, F], F, F, -1, F, 0, "else", -0.5 - 0.5),
    ([L0, L1, WHITE], [T, T, F], T, F, -1, F, 0, "unlock", 1 + 10 - 0.5),
    ([L0, L2, DOOR], [T, T, T], T, T, 1, T, 1, "open1", 1 + 10 + 50),
    ([L0, L2, DOOR], [T, T, T], T, T, 1, F, 1, "open1", 1 + 10 + 50),
    ([L0, L3, L3 + 7], [T, T, T], T, F, -1, F, 1, "unlock", 1 + 15),
    ([L0, L3, DOOR], [T, T, T], T, T, 2, T, 2, "open2", 1 + 15 + 75),
    ([L0, L0, L1], [T, F, T], T, F, -1, F, 2, "unlock", 1 - 0.5 + 22.5),
    ([L0, L0 + 7, L1], [T, T, F], F, F, -1, F, 2, "else", 1 - 0.5),
    ([L0, L1, DOOR], [T, T, T], T, T, 0, T, 3, "open3", 1 + 22.5 + 112.5),
    ([L0, L3, DOOR], [T, T, T], T, T, 2, F, 3, "open1", 1 + 10 + 50),
]


def test_the_record_is_what_happened() -> None:
    script = [action for actions, *_ in BY_HAND for action in actions]
    learner = Scripted(script, [WHITE] * len(script))
    protocol = Protocol("mine", attempt_limit=len(BY_HAND), stop_when_solved=False)
    record = play(
        learner,
        one_room("CC4", "trial7"),
        protocol,
        [4, 9],
        seed=11,
        learner="scripted",
        experiment="by hand",
    )
    assert record.subject.tolist() == [4] * 10 + [9] * 10
    mine, other = record[record.subject == 4], record[record.subject == 9]
    columns = ["unlocked", "opened", "solution", "new_solution", "solutions_found", "category"]
    assert mine.attempt.tolist() == list(range(1, 11))
    for row, (actions, moved, *rest, reward) in zip(mine.itertuples(), BY_HAND, strict=True):
        assert row.actions.tolist() == actions
        assert row.moved.tolist() == moved
        assert [getattr(row, column) for column in columns] == rest
        assert row.reward == pytest.approx(reward)
    assert (other.category == "else").all()
    assert (other.reward == -1.5).all()
    assert not other.new_solution.any()
    assert (other.solutions_found == 0).all()
    constant = {
        "experiment": "by hand",
        "learner": "scripted",
        "condition": "room",
        "protocol": "mine",
        "seed": 11,
        "phase": "train",
        "loop": 1,
        "trial": 1,
        "schema": "CC4",
        "layout": "trial7",
        "solutions": 3,
    }
    for column, value in constant.items():
        assert set(record[column]) == {value}, column
    assert mine.wall_time.is_monotonic_increasing
    assert record.wall_time.between(0, 60).all()


def test_a_learner_is_told_what_its_own_action_led_to() -> None:
    script = [action for actions, *_ in BY_HAND for action in actions]
    learner = Scripted(script)
    protocol = Protocol("mine", attempt_limit=len(BY_HAND), stop_when_solved=False)
    play(learner, one_room("CC4", "trial7"), protocol, 1)
    steps = learner.steps
    assert [int(step.action[0]) for step in steps] == script
    assert [bool(step.attempt_over[0]) for step in steps] == [F, F, T] * 10
    assert [bool(step.trial_over[0]) for step in steps] == [F] * 29 + [T]
    assert [bool(step.new_solution[0]) for step in steps[2::3]] == [row[5] for row in BY_HAND]
    for step, later in pairwise(steps):
        assert step.next is later.view
    start = steps[0].view.observation
    for step in steps:
        if step.attempt_over[0]:
            assert (step.next.observation == start).all(), "the room is put back"
        else:
            assert (step.next.observation == step.outcome).all()
        moved = (step.outcome != step.view.observation).any()
        changes = [row[1] for row in BY_HAND]
        assert (
            moved
            == changes[int(step.view.attempt[0]) - 1][3 - int(step.view.console.actions_left[0])]
        )


def test_what_a_learner_does_to_what_it_was_handed_does_not_change_the_session() -> None:
    class Vandal(Scripted):
        def learn(self, step: Step) -> None:
            for array in (step.action, step.reward, step.outcome, step.attempt_over):
                array[:] = 1
            for array in (step.trial_over, step.new_solution, step.view.observation):
                array[:] = 1

    arguments = {"condition": "CC3-CC4", "reward": "negative_repeat"}
    curious = Curious()
    expected = play(curious, **arguments).drop(columns="wall_time")
    scripts = np.stack([step.action for step in curious.steps], axis=1).tolist()
    record = play(Vandal(*scripts), **arguments).drop(columns="wall_time")
    pd.testing.assert_frame_equal(record, expected)


def test_a_new_trial_forgets_what_was_found_and_shows_the_next_room() -> None:
    solve = [L0, L1, DOOR, L0, L2, DOOR, L0, L3, DOOR]
    condition = one_room("CC4", "trial7", trials=2)
    learner = Scripted(solve + solve)
    record = play(learner, condition, HUMAN, 1)
    assert record.trial.tolist() == [1, 1, 1, 2, 2, 2]
    assert record.attempt.tolist() == [1, 2, 3] * 2
    assert record.category.tolist() == ["open1", "open2", "open3"] * 2
    assert record.reward.tolist() == [61, 91, 136] * 2
    after = learner.steps[8].next
    assert (after.trial[0], after.attempt[0]) == (2, 1)
    assert (after.console.solutions_left[0], after.console.attempts_left[0]) == (3, 30)


def test_an_attempt_ends_as_soon_as_the_door_opens() -> None:
    layout = Layout((3,))
    learner = Scripted([3, DOOR, 1, 3, DOOR, DOOR, DOOR, 3])
    protocol = Protocol("mine", attempt_limit=3, stop_when_solved=False)
    record = play(learner, one_room(ONE, layout), protocol, 1, reward="basic")
    assert [row.tolist() for row in record.actions] == [[3, DOOR], [1, 3, DOOR], [DOOR, DOOR, 3]]
    assert [row.tolist() for row in record.moved] == [[T, T], [F, T, T], [F, F, T]]
    assert record.category.tolist() == ["open1", "open1", "unlock"]
    assert record.new_solution.tolist() == [T, F, F]
    assert record.reward.tolist() == [60, 60, 10]
    assert [int(step.view.console.actions_left[0]) for step in learner.steps] == [
        *(3, 2),
        *(3, 2, 1),
        *(3, 2, 1),
    ]


def test_opening_with_more_levers_than_needed_is_open1_and_no_solution() -> None:
    protocol = Protocol("mine", attempt_limit=1, stop_when_solved=True, action_limit=4)
    record = play(Scripted([L0, L1, L2, DOOR]), one_room("CC4", "trial7"), protocol, 1)
    assert record.opened.tolist() == [T]
    assert record.category.tolist() == ["open1"]
    assert record.solution.tolist() == [-1]
    assert record.solutions_found.tolist() == [0]


def test_rooms_of_different_sizes_and_limits_meet_in_one_condition() -> None:
    eight = Schema("eight", [f"A{i}" for i in range(8)], {f"A{i}": ["door"] for i in range(8)})
    condition = Condition("mixed", (Trials(SCHEMAS["chain3"], number=2), Trials(eight, number=1)))
    session = Session(condition, HUMAN, 3)
    assert (session.brief.positions, session.brief.actions) == (8, 17)
    assert session.brief.action_limit == 4
    record = session.play(Oracle()).to_pandas()
    trials = trials_of(record)
    assert trials.attempts.tolist() == [1, 1, 8] * 3
    assert [len(actions) for actions in record.actions[:3]] == [4, 4, 2]


# -- independence ---------------------------------------------------------------------------------


@pytest.mark.parametrize("learner", [RandomLearner, Curious])
@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_a_subjects_data_do_not_depend_on_who_shares_its_batch(
    learner: Callable[[], Learner], condition: str
) -> None:
    together = play(learner(), condition, subjects=10, seed=7).drop(columns="wall_time")
    assert together.subject.unique().tolist() == list(range(10))
    batches: list[list[list[int]]] = [
        [[subject] for subject in range(10)],
        [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]],
        [[9, 0], [7, 2, 5], [1, 3, 4, 6, 8]],
    ]
    for split in batches:
        parts = [play(learner(), condition, subjects=batch, seed=7) for batch in split]
        apart = pd.concat(
            [part.astype(dict.fromkeys(texts(part), str)) for part in parts]
        ).sort_values("subject", kind="stable", ignore_index=True)
        expected = together.astype(dict.fromkeys(texts(together), str))
        pd.testing.assert_frame_equal(apart.drop(columns="wall_time"), expected)


def texts(record: pd.DataFrame) -> list[str]:
    return [name for name in record if record[name].dtype == "category"]


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_rooms_and_luck_are_the_same_for_all_learners(condition: str) -> None:
    script = np.random.default_rng(0).integers(15, size=7 * 90).tolist()
    labels = ("one", "other")
    first, second = (
        play(Scripted(*[script] * 5, afterwards=0), condition, subjects=5, learner=label)
        for label in labels
    )
    different = ["learner", "wall_time"]
    pd.testing.assert_frame_equal(first.drop(columns=different), second.drop(columns=different))
    # Even a learner that ends its trials sooner meets the same rooms.
    oracle, chance = (
        trials_of(play(Oracle(), condition)),
        trials_of(play(RandomLearner(), condition)),
    )
    assert oracle.layout.tolist() == chance.layout.tolist()
    # And one that draws as another does draws other numbers under another label.
    alike = [play(RandomLearner(), condition, learner=label).actions.tolist() for label in labels]
    assert any((a.tolist() != b.tolist()) for a, b in zip(*alike, strict=True))


def test_seed_and_subject_determine_the_rooms() -> None:
    def layouts(seed: int) -> list[str]:
        return trials_of(play(Oracle(), "CC4", subjects=20, seed=seed)).layout.tolist()

    assert layouts(1) == layouts(1)
    assert layouts(1) != layouts(2)
    orders = np.array(layouts(1)).reshape(20, 5)
    assert len(np.unique(orders, axis=0)) > 10


def test_noisy_rooms_obey_as_often_as_their_strengths_say() -> None:
    many, attempts = 40, 100
    protocol = Protocol("mine", attempt_limit=attempts, stop_when_solved=False)
    learner = Scripted(*[[0, 4, DOOR] * attempts] * many)  # trial1: L0, L1, the door
    record = play(
        learner, one_room("noisy_CC3", "trial1"), protocol, many, reward="negative_immovable"
    )
    moved = np.array([row.tolist() for row in record.moved])
    tolerance = 5 * np.sqrt(0.16 / len(record))
    assert moved[:, 0].all()
    assert moved[:, 1].mean() == pytest.approx(0.8, abs=tolerance)
    assert not moved[~moved[:, 1], 2].any(), "the door is locked then"
    assert moved[moved[:, 1], 2].mean() == pytest.approx(0.8, abs=2 * tolerance)
    expected = np.where(moved[:, 1], 10, -0.5) + np.where(moved[:, 2], 50, -0.5)
    np.testing.assert_array_equal(record.reward, expected)
    # Every subject has luck of its own.
    by_subject = moved[:, 1].reshape(many, attempts)
    assert len(np.unique(by_subject, axis=0)) == many


# -- what a learner knows -------------------------------------------------------------------------

PLAIN = (bool, int, float, str, type(None), np.generic, np.random.Generator)
TOLD = (Brief, View, Console, Step)


def reachable(thing: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Everything that can be reached from a thing, and by which path."""
    yield path, thing
    if is_dataclass(thing):
        for field in fields(thing):
            yield from reachable(getattr(thing, field.name), f"{path}.{field.name}")
    elif isinstance(thing, tuple | list):
        for index, part in enumerate(thing):
            yield from reachable(part, f"{path}[{index}]")
    elif isinstance(thing, dict):
        for key, part in thing.items():
            yield from reachable(part, f"{path}[{key!r}]")
    elif isinstance(thing, np.ndarray) and thing.base is not None:
        yield from reachable(thing.base, f"{path}.base")
    elif hasattr(thing, "__dict__") and not isinstance(thing, PLAIN):
        yield from reachable(vars(thing), f"{path}.__dict__")


class Nosy(Curious):
    """Keeps all that it is told; it has a method to be informed, but no right to be."""

    told: list[Any]

    def begin(self, brief: Brief) -> None:
        super().begin(brief)
        self.told = [brief]

    def act(self, view: View) -> np.ndarray:
        self.told.append(view)
        return super().act(view)

    def learn(self, step: Step) -> None:
        self.told.append(step)

    def inform(self, truth: Truth) -> None:
        raise AssertionError("it was told the truth")


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_nothing_that_a_learner_is_given_leads_to_what_is_latent(condition: str) -> None:
    learner = Nosy()
    session = Session(named(condition), replace(HUMAN, attempt_limit=3), 4)
    session.play(learner)
    latent = [value for value in vars(session._tables).values() if isinstance(value, np.ndarray)]
    for told in learner.told:
        for path, thing in reachable(told, type(told).__name__):
            assert isinstance(thing, (*PLAIN, *TOLD, tuple, np.ndarray)), path
            if isinstance(thing, np.ndarray):
                assert thing.dtype.kind in "biuf", path
                assert not any(np.shares_memory(thing, table) for table in latent), path
            if isinstance(thing, tuple):
                assert path in ("Brief.action_names", "Brief.generators"), path


def test_a_learners_luck_is_not_the_rooms() -> None:
    session = Session(named("noisy_CC3"), HUMAN, 3, seed=4)
    rooms = generators(4, "environment/noisy_CC3", range(3))
    for mine, room in zip(session.brief.generators, rooms, strict=True):
        assert mine.bit_generator.state != room.bit_generator.state
        assert (mine.random(5) != room.random(5)).any()
    # A learner that draws no number and one that draws many meet the same luck.
    generous, thrifty = ([0, 4, DOOR] * 150 for _ in range(2))
    records = []
    for script, numbers in ((generous, 1000), (thrifty, 0)):
        learner = Scripted(*[script] * 3, afterwards=0)
        session = Session(named("noisy_CC3"), HUMAN, 3, seed=4)
        for generator in session.brief.generators:
            generator.random(numbers)
        records.append(session.play(learner).to_pandas().drop(columns="wall_time"))
    pd.testing.assert_frame_equal(*records)


def test_an_informed_learner_is_told_the_truth_and_told_anew_in_every_room() -> None:
    rooms: list[list[str]] = []

    class Witness(Oracle):
        def inform(self, truth: Truth) -> None:
            super().inform(truth)
            rooms.append([truth.rooms[index].layout.name for index in truth.room])

    session = Session(named("CC3-CC4"), HUMAN, 4)
    truth = session.truth
    first = truth.room.tolist()
    record = session.play(Witness()).to_pandas()
    assert truth.room.tolist() == first != session.truth.room.tolist()
    assert issubclass(Witness, InformedLearner)
    for subject in range(4):
        told = [moment[subject] for moment in rooms]
        changes = [told[0], *(b for a, b in pairwise(told) if a != b)]
        # No two rooms that follow one another have the same layout, so each change shows.
        order = record[record.subject == subject].drop_duplicates(["phase", "trial"])
        assert changes == order.layout.tolist()


def test_a_brief_says_how_large_everything_is() -> None:
    brief = Session(named("CC3-CE4"), RL, [3, 5]).brief
    assert (brief.subjects, brief.positions, brief.actions, brief.observation_size) == (
        2,
        7,
        15,
        16,
    )
    assert (brief.action_limit, brief.attempt_limit, brief.trials) == (3, 300, 650)
    assert brief.action_names[0] == "push_UPPERRIGHT"
    assert brief.action_names[13:] == ("pull_LOWERRIGHT", "push_door")
    assert len(brief.generators) == 2


def test_the_view_counts_trials_attempts_and_what_is_left() -> None:
    session = Session(one_room("CC4", "trial7", 2), replace(HUMAN, attempt_limit=2), 1)
    seen = []
    while not session.over:
        view, console = session.view, session.view.console
        numbers = (view.trial, view.attempt, console.attempts_left, console.actions_left)
        seen.append(tuple(int(number[0]) for number in numbers))
        session.step(np.array([WHITE]))
    assert seen == [
        (trial, attempt, 3 - attempt, 3 - action)
        for trial in (1, 2)
        for attempt in (1, 2)
        for action in range(3)
    ]
    assert not session.view.playing.any()
    assert session.progress == 1.0


# -- answers --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            [0],
            "answers with 2 integers, one for each subject, and not with int64 of shape \\(1,\\)",
        ),
        ([[0, 0]], "shape \\(1, 2\\)"),
        (3, "shape \\(\\)"),
        (None, "object"),
        ([[0], [0, 1]], "object"),
        ([0.0, 1.0], "float64 of shape \\(2,\\)"),
        ([True, False], "bool"),
        (["push", "pull"], "of shape \\(2,\\)"),
        ([0, 15], "action 15 is outside the action space; .* 7 positions has actions 0 to 14"),
        ([-1, 0], "action -1 is outside the action space"),
        ([0, 10**12], "action 1000000000000 is outside"),
    ],
)
def test_an_answer_that_is_none_is_refused_in_one_sentence(answer: Any, message: str) -> None:
    class Wrong(Scripted):
        def act(self, view: View) -> Any:
            return answer

    with pytest.raises(LearnerError, match=message) as caught:
        play(Wrong(), "CC3", subjects=2)
    assert "\n" not in str(caught.value)
    assert not str(caught.value).endswith(".")


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int32, np.uint64, list])
def test_any_integers_are_an_answer(kind: Any) -> None:
    session = Session(one_room("CC4", "trial7"), HUMAN, 2)
    actions = [L0, DOOR] if kind is list else np.array([L0, DOOR], dtype=kind)
    assert session.step(actions).action.tolist() == [L0, DOOR]


def test_actions_of_subjects_that_have_finished_are_ignored() -> None:
    solve = [L0, L1, DOOR, L0, L2, DOOR, L0, L3, DOOR]
    idle = [WHITE] * 90
    learner = Scripted(solve, idle, afterwards=-1)
    record = play(learner, one_room("CC4", "trial7"), HUMAN, 2)
    assert record.subject.value_counts().to_dict() == {0: 3, 1: 30}
    playing = np.array([step.view.playing for step in learner.steps])
    assert playing[:, 0].tolist() == [T] * 9 + [F] * 81
    assert playing[:, 1].all()
    for step in learner.steps[9:]:
        for flags in (step.attempt_over, step.trial_over, step.new_solution):
            assert not flags[0]


def test_a_session_needs_subjects_each_of_them_once() -> None:
    for subjects in (0, [], [1, 2, 1]):
        with pytest.raises(ProtocolError, match="at least one subject, and each subject only once"):
            Session(named("CC4"), HUMAN, subjects)


def test_progress_goes_up_to_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(range(10**6))
    monkeypatch.setattr("causal_openlock.session.time.monotonic", lambda: float(next(clock)))
    told: list[float] = []
    session = Session(named("CC4"), HUMAN, 3)
    session.play(Oracle(), told.append)
    assert told == sorted(told)
    assert 0 <= told[0] < told[-1] == 1.0


def test_a_session_by_hand_is_the_same_as_one_that_is_played() -> None:
    learner = Curious()
    session = Session(named("CE3"), HUMAN, 4, seed=2)
    learner.begin(session.brief)
    while not session.over:
        learner.learn(session.step(learner.act(session.view)))
    by_hand = session.record().to_pandas().drop(columns="wall_time")
    played = play(Curious(), "CE3", subjects=4, seed=2).drop(columns="wall_time")
    pd.testing.assert_frame_equal(by_hand, played)


def test_the_record_can_be_read_while_a_session_goes_on() -> None:
    session = Session(named("CC4"), HUMAN, 3)
    assert session.record().num_rows == 0
    for _ in range(7):
        session.step(np.zeros(3, int))
    assert session.record().num_rows == 6


@pytest.mark.parametrize("reward", PRESETS)
def test_a_reward_by_name_is_the_reward_itself(reward: str) -> None:
    by_name = play(Curious(), "CE4", subjects=3, reward=reward)
    as_object = play(Curious(), "CE4", subjects=3, reward=PRESETS[reward])
    assert by_name.reward.tolist() == as_object.reward.tolist()
