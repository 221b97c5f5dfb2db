"""A room in words: what is seen is told, nothing else is, and every action can be written."""

from __future__ import annotations

import numpy as np
import pytest

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.render.words import STORIES, Counters, Wording, feedback, room_now
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout

CC3 = find_schema("CC3")
NOW = Counters(solutions_left=2, attempts_left=30, actions_left=3, attempt=1)


def drawn(story: str = "any", positions: int = 7, seed: int = 0) -> Wording:
    return Wording.draw(positions, np.random.default_rng(seed), story)  # type: ignore[arg-type]


@pytest.mark.parametrize("story", STORIES)
@pytest.mark.parametrize("positions", [7, 12])
def test_every_action_can_be_written_and_no_two_are_written_alike(
    story: str, positions: int
) -> None:
    words = drawn(story, positions)
    assert [words.read(text) for text in words.actions] == [*range(2 * positions + 1)]
    assert sorted(words.choices) == sorted(words.actions)
    assert len({*words.actions}) == 2 * positions + 1
    assert all(choice in words.instructions(3, 30) for choice in words.choices)


@pytest.mark.parametrize("story", STORIES)
def test_an_observation_can_be_recovered_from_its_words(story: str) -> None:
    words, generator = drawn(story, seed=3), np.random.default_rng(0)
    told_of: dict[str, tuple[int, ...]] = {}
    for _ in range(300):
        bits = tuple(generator.integers(2, size=16).tolist())
        text = words.room(bits, NOW)
        assert told_of.setdefault(text, bits) == bits
    vocabulary = STORIES[story]
    assert vocabulary.locked in words.room([0] * 14 + [1, 0], NOW)
    assert f"{vocabulary.unlocked} and {vocabulary.open}" in words.room([0] * 14 + [0, 1], NOW)


def test_names_order_and_story_are_drawn() -> None:
    tellings = [drawn(seed=seed) for seed in range(60)]
    assert {words.story for words in tellings} == {*STORIES}
    assert len({words.names for words in tellings}) == 60
    assert len({words.order for words in tellings}) > 50
    assert drawn(seed=5) == drawn(seed=5)
    with pytest.raises(OpenLockError, match="there is no story 'lever'; did you mean levers"):
        drawn("lever")


@pytest.mark.parametrize(
    ("text", "action"),
    [
        ("push oak", 0),
        ("  PUSH   Oak. ", 0),
        ("Action: `pull elm`", 4),
        ("I know it.\n\n**push the door**\n", 8 - 2),
        ("__push oak__", 0),
        ("I will not push oak", None),
        ("push oak\nor perhaps not", None),
        ("push oak, push elm", None),
        ("push", None),
        ("", None),
        ("\n", None),
    ],
)
def test_what_is_read_as_an_action(text: str, action: int | None) -> None:
    assert Wording("levers", ("oak", "elm", "fir"), (2, 0, 1)).read(text) == action


def test_a_course_in_words() -> None:
    """CC3 in trial1, whose first lever enables the other two."""
    layout = Layout.of(CC3, "trial1")
    first, second, _ = layout.places
    condition = Condition("room", (Trials(CC3, (layout,)),))
    session = Session(condition, Protocol("t", 3, True, baseline_trials=1), 1)
    words = drawn("levers")
    name = words.names

    def does(action: int) -> list[str]:
        return feedback(words, session.step(np.array([action])), 0, 1).splitlines()

    start = room_now(words, session.view, 0, 1)
    assert start.startswith("Room 1 of 1, attempt 1. Left: 2 combinations, 3 attempts, 3 actions")
    assert does(second)[0] == "Nothing moved."
    assert does(first)[0] == f"{name[first].capitalize()} is pushed now."
    ended = does(second)
    assert ended[0] == f"{name[second].capitalize()} is pushed now and the door is unlocked now."
    assert ended[1] == "The attempt is over; the room goes back to where it began."
    assert ended[2].startswith("Room 1 of 1, attempt 2. Left: 2 combinations, 2 attempts, 3")
    for action in (first, second):
        does(action)
    assert does(14)[0] == "The door is open, by a new combination!"
    for action in (first, second):
        does(action)
    assert does(14) == [
        "The door is open, but by no new combination.",
        "No attempts are left; 1 combination stayed hidden.",
    ]


def test_how_a_solved_trial_ends() -> None:
    words = drawn("symbols")
    assert (
        words.ending(7, True, 0)
        == "You found every combination! The page is over after 7 attempts."
    )
    locked = words.outcome([1, *[0] * 15], [0] * 14 + [1, 0])
    assert locked == f"{words.names[0].capitalize()} is low now and the seal is fixed now."


def test_what_is_said_is_true_where_a_trial_goes_on_after_it_is_solved() -> None:
    words = drawn("levers")
    rules, ending = words.instructions(3, 300), words.ending(300, trial_over=True, solutions_left=0)
    assert "Find all of them; you have at most 300 attempts with each room." in rules
    assert ending == "You found every combination! The room is over after 300 attempts."
    before = [0] * 14 + [0, 0]
    assert words.outcome(before, [0] * 15 + [1]) == "The door is open, but by no new combination."
