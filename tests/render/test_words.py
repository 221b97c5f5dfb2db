"""A room in words: what is seen is told, nothing else is, and every action can be written."""

import numpy as np
import pytest

from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.render.words import STORIES, Wording, feedback, room_now
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout

CC3 = find_schema("CC3")
NOW = {"solutions_left": 2, "attempts_left": 30, "actions_left": 3}, 1, "1 of 1"
each_story = pytest.mark.parametrize("story", STORIES)


def drawn(story="any", positions=7, seed=0):
    return Wording.draw(positions, np.random.default_rng(seed), story)


@each_story
@pytest.mark.parametrize("positions", [7, 12])
def test_every_action_can_be_written_and_no_two_are_written_alike(story, positions):
    words = drawn(story, positions)
    assert [words.read(text) for text in words.actions] == [*range(2 * positions + 1)]
    assert sorted(words.choices) == sorted(words.actions)
    assert len({*words.actions}) == 2 * positions + 1
    assert all(choice in words.instructions(3, 30) for choice in words.choices)


@each_story
def test_an_observation_can_be_recovered_from_its_words(story):
    words, told = drawn(story, seed=3), {}
    for bits in np.random.default_rng(0).integers(2, size=(300, 16)).tolist():
        assert told.setdefault(words.room(bits, *NOW), bits) == bits
    vocabulary = STORIES[story]
    assert vocabulary.locked in words.room([0] * 14 + [1, 0], *NOW)
    assert f"{vocabulary.unlocked} and {vocabulary.open}" in words.room([0] * 14 + [0, 1], *NOW)


def test_names_order_and_story_are_drawn():
    tellings = [drawn(seed=seed) for seed in range(60)]
    assert {words.story for words in tellings} == {*STORIES}
    assert len({words.names for words in tellings}) == 60
    assert len({words.order for words in tellings}) > 50
    assert drawn(seed=5) == drawn(seed=5)


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
def test_what_is_read_as_an_action(text, action):
    assert Wording("levers", ("oak", "elm", "fir"), (2, 0, 1)).read(text) == action


def test_a_course_in_words():
    layout = Layout.of(CC3, "trial1")
    first, second, _ = layout.places  # the first lever enables the other two
    condition = Condition("room", (Trials(CC3, (layout,)),))
    session = Session(condition, Protocol("t", 3, True, baseline_trials=1), 1)
    words = drawn("levers")
    oak, elm = words.names[first], words.names[second]

    def does(action):
        return feedback(words, session.step(np.array([action])), 0, 1).lower().splitlines()

    start = room_now(words, session.view, 0, 1)
    assert start.startswith("Room 1 of 1, attempt 1. Left: 2 combinations, 3 attempts, 3 actions")
    assert does(second)[0] == "nothing moved."
    assert does(first)[0] == f"{oak} is pushed now."
    unlocks, over, again, *_ = does(second)
    assert unlocks == f"{elm} is pushed now and the door is unlocked now."
    assert "attempt is over" in over
    assert again.startswith("room 1 of 1, attempt 2. left: 2 combinations, 2 attempts, 3")
    for new in (True, False):
        does(first), does(second)
        opens, *rest = does(14)
        assert opens.startswith("the door is open")
        assert ("no new combination" not in opens) == new
    assert rest == ["no attempts are left; 1 combination stayed hidden."]


def test_the_end_of_a_trial_is_told_in_the_words_of_its_story():
    words = drawn("symbols")
    ending = words.ending(7, trial_over=True, solutions_left=0)
    assert "every combination" in ending
    assert ending.endswith("The page is over after 7 attempts.")
    locked = words.outcome([1, *[0] * 15], [0] * 14 + [1, 0])
    assert locked == f"{words.names[0].capitalize()} is low now and the seal is fixed now."
    assert "at most 300 attempts" in words.instructions(3, 300)
