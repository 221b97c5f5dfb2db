"""Sessions against the oracle's room: what is seen, what ends when, and what the record says."""

from dataclasses import fields, is_dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from causal_openlock.contract.learner import Brief, Console, Step, View
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.record import record_schema, with_times
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.rewards import PRESETS
from causal_openlock.world.room import Layout
from openlock_learners.random import RandomLearner
from oracle import Room, Rules
from oracle import reward as paid
from support.env_play import DOOR, L0, L1, L2, L3, WHITE
from support.session_play import HUMAN, SCHEMAS, Curious, Scripted, named, one_room, play

EIGHT = Schema("eight", [f"A{i}" for i in range(8)], {f"A{i}": ["door"] for i in range(8)})
MIXED = Condition(
    "mixed",
    (Trials(SCHEMAS["chain3"], number=2), Trials(SCHEMAS["noisy_CC3"], "random", 2)),
    (Trials(EIGHT, number=1), Trials(SCHEMAS["two_of_four"], number=1)),
)


class Restless(Curious):
    """Mostly pushes a grey lever or the door, and else does anything."""

    def act(self, view):
        anything = (self.streams.uniform() * (2 * self.positions + 1)).astype(int)
        return np.where(self.streams.uniform() < 0.25, anything, super().act(view))


@pytest.mark.parametrize(
    ("condition", "protocol", "reward"),
    [
        ("CC3-CE4", replace(HUMAN, attempt_limit=25, test_trials=2), "paper"),
        ("CC4", Protocol("on", 30, False, baseline_trials=2, baseline_loops=2), "paper"),
        ("CC3", Protocol("wide", 20, True, action_limit=5), "negative_repeat"),
        ("noisy_CC3-CC3", replace(HUMAN, layouts="random"), "unique_solutions"),
        (MIXED, Protocol("mine", 12, True, action_limit=5, train_loops=2), "negative_repeat"),
    ],
    ids=["people", "goes on when solved", "long attempts", "random layouts", "mixed rooms"],
)
def test_a_session_is_the_oracles_room_action_by_action(condition, protocol, reward):
    learner, subjects = Restless(), 6
    condition = named(condition) if isinstance(condition, str) else condition
    session = Session(condition, protocol, subjects, seed=3, reward=reward)
    record, terms = session.play(learner).to_pandas(), PRESETS[reward].terms
    schemas = {schema.name: schema for schema in condition.schemas}
    assert record.new_solution.sum() > 5
    for number, (_, attempts) in enumerate(record.groupby("subject")):
        steps, trials = iter(learner.steps), 0
        for _, trial in attempts.groupby(["phase", "loop", "trial"], observed=True, sort=False):
            schema = schemas[trial.schema.iloc[0]]
            layout = Layout.of(schema, trial.layout.iloc[0], session.brief.positions)
            rules = Rules.of(schema).at(dict(zip(schema.levers, layout.places, strict=True)))
            limit = protocol.action_limit or max(3, 1 + max(map(len, rules.solutions)))
            room, trials = Room(rules, session.brief.positions, limit), trials + 1
            for attempt, row in enumerate(trial.itertuples(), 1):
                room.begin()
                total = 0.0
                for action, moved in zip(row.actions, row.moved, strict=True):
                    step, found, used = next(steps), len(room.found), room.used
                    view, console = step.view, step.view.console
                    assert view.observation[number].tolist() == room.observation()
                    shown = (
                        view.playing, view.trial, view.attempt, console.solutions_found,
                        console.solutions_left, console.attempts_left, console.actions_left,
                    )  # fmt: skip
                    assert [column[number] for column in shown] == [
                        True, trials, attempt, found, len(rules.solutions) - found,
                        protocol.attempt_limit + 1 - attempt, limit - used,
                    ]  # fmt: skip
                    event = room.step(int(action), luck=0.0 if moved else 0.9999)
                    assert step.outcome[number].tolist() == room.observation()
                    led_to = (step.action, step.reward, step.attempt_over, step.new_solution)
                    assert [column[number] for column in led_to] == [
                        action,
                        pytest.approx(paid(event, terms)),
                        room.over,
                        room.new,
                    ]
                    assert event.moved == moved
                    total += paid(event, terms)
                solution = rules.solution(room.pushed) if room.opened else None
                levers = dict(zip(layout.places, schema.levers, strict=True))
                roles = solution and frozenset(map(levers.get, solution))
                sets = [*map(frozenset, schema.solutions)]
                assert room.over
                assert row._asdict() == row._asdict() | {
                    "attempt": attempt, "unlocked": room.was_unlocked, "opened": room.opened,
                    "solution": sets.index(roles) if solution else -1, "new_solution": room.new,
                    "solutions_found": len(room.found), "solutions": len(rules.solutions),
                    "category": room.category, "reward": pytest.approx(total),
                }  # fmt: skip
                solved = protocol.stop_when_solved and len(room.found) == len(rules.solutions)
                assert step.trial_over[number] == (solved or attempt == protocol.attempt_limit)
            assert step.trial_over[number]
        assert trials == session.brief.trials
        for rest in steps:
            view = rest.view
            assert not view.playing[number]
            for told in (rest.attempt_over, rest.trial_over, rest.new_solution):
                assert not told[number]
    for before, after in pairwise(learner.steps):
        assert before.next is after.view


def test_a_record_has_the_columns_of_the_contract_each_with_its_meaning():
    session = Session(named("CC4"), HUMAN, 3)
    assert session.record().num_rows == 0
    for _ in range(7):
        session.step(np.zeros(3, int))
    table = session.record()  # while the session goes on
    assert table.num_rows == 6
    assert table.schema.equals(record_schema(), check_metadata=True)
    assert not any(column.null_count for column in table.columns)
    ends = [1.5, None, 2, 3, 4, 5]
    actions = [{"visit": 1 + n // 5, "attempt_over": True, "time": time}
               for n, time in enumerate(ends)]  # fmt: skip
    timed = with_times(table, actions, 1)
    assert timed["wall_time"].to_pylist() == [1.5, 0, 2, 3, 4]
    assert timed.drop_columns("wall_time") == table[:5].drop_columns("wall_time")
    assert timed.schema.equals(table.schema, check_metadata=True)


def test_actions_of_subjects_that_have_finished_are_ignored():
    solve = [L0, L1, DOOR, L0, L2, DOOR, L0, L3, DOOR]
    learner = Scripted(solve, [WHITE] * 90, afterwards=-1)  # no action at all
    record = play(learner, one_room("CC4", "trial7"), HUMAN, 2)
    assert record.subject.value_counts().to_dict() == {0: 3, 1: 30}


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_rooms_and_luck_are_the_same_for_all_learners(condition):
    script = np.random.default_rng(0).integers(15, size=7 * 90).tolist()
    first, second = (
        play(Scripted(*[script] * 5, afterwards=0), condition, subjects=5, learner=label)
        for label in ("one", "other")
    )
    different = ["learner", "wall_time"]
    pd.testing.assert_frame_equal(first.drop(columns=different), second.drop(columns=different))
    # One that draws as another does draws other numbers under another label.
    one, other = (
        np.concatenate(play(RandomLearner(), condition, learner=label).actions.tolist())
        for label in ("one", "other")
    )
    assert one.tolist() != other.tolist()


# -- what a learner is told -----------------------------------------------------------------------

PLAIN = (bool, int, float, str, type(None), np.generic, np.random.Generator)
TOLD = (Brief, View, Console, Step)


def reachable(thing, path=""):
    """Everything that can be reached from a thing, and by which path."""
    yield path, thing
    if is_dataclass(thing):
        for field in fields(thing):
            yield from reachable(getattr(thing, field.name), f"{path}.{field.name}")
    elif isinstance(thing, tuple | list):
        for index, part in enumerate(thing):
            yield from reachable(part, f"{path}[{index}]")
    elif isinstance(thing, np.ndarray) and thing.base is not None:
        yield from reachable(thing.base, f"{path}.base")
    elif hasattr(thing, "__dict__") and not isinstance(thing, PLAIN):
        yield from reachable(vars(thing), f"{path}.__dict__")


class Nosy(Curious):
    """Has a method to be informed, but no right to be."""

    def inform(self, truth):
        raise AssertionError("it was told the truth")


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_nothing_that_a_learner_is_given_leads_to_what_is_latent(condition):
    learner = Nosy()
    session = Session(named(condition), replace(HUMAN, attempt_limit=3), 4)
    session.play(learner)
    latent = [value for value in session._tables if isinstance(value, np.ndarray)]
    assert latent
    for told in (session.brief, *learner.steps):
        for path, thing in reachable(told, type(told).__name__):
            assert isinstance(thing, (*PLAIN, *TOLD, tuple, np.ndarray)), path
            if isinstance(thing, np.ndarray):
                assert thing.dtype.kind in "biuf", path
                assert path.endswith(".base") or not thing.flags.writeable, path
                assert not any(np.shares_memory(thing, table) for table in latent), path
            if isinstance(thing, tuple):
                assert path in ("Brief.action_names", "Brief.generators"), path
