"""What a learner is told in a session, and that what is latent stays so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from causal_openlock.contract.learner import Brief, Console, InformedLearner, Step, Truth, View
from causal_openlock.experiment.session import Session
from openlock_learners.oracle import Oracle
from support.cc4_in_trial7 import WHITE
from support.session_play import HUMAN, RL, Curious, named, one_room

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


def writable(thing: Any) -> Iterator[np.ndarray]:
    return (part for _, part in reachable(thing) if isinstance(part, np.ndarray))


def test_a_learner_that_writes_into_what_it_was_told_alters_nothing_it_is_told_next() -> None:
    def course(vandal: bool) -> list[list[Any]]:
        session = Session(named("CC3-CE4"), replace(HUMAN, attempt_limit=3), 4, seed=5)
        learner, seen = Curious(), []
        learner.begin(session.brief)
        while not session.over:
            step = session.step(learner.act(session.view))
            past = [step.view, step.outcome, step.reward, step.new_solution, step.attempt_over]
            if vandal:
                for array in writable(past):
                    array[...] = 1
            seen.append([array.tolist() for array in writable(step.next)])
        return [*seen, session.record().drop_columns(["wall_time"]).to_pylist()]

    assert course(vandal=True) == course(vandal=False)


def test_no_two_arrays_of_a_step_are_one() -> None:
    session = Session(named("CE4"), HUMAN, 3)
    learner = Curious()
    learner.begin(session.brief)
    for _ in range(7):  # in mid-attempt and at its end
        step = session.step(learner.act(session.view))
        arrays = list(writable([getattr(step, field.name) for field in fields(step)]))
        for index, array in enumerate(arrays):
            assert not any(np.shares_memory(array, other) for other in arrays[:index])
