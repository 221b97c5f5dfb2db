"""A room to try out by hand is the room that learners play, and shows itself."""

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.notebook import seen_html
from causal_openlock.world.room import action_index

# Solutions of CC4 in trial7, and an attempt that finds nothing.
FIRST = ("push LOWERLEFT", "push_upperright", "door")
SECOND = ("LOWERLEFT", 6, "push door")
THIRD = ("LOWERLEFT", "UPPERLEFT", "DOOR")
NOTHING = ("pull LOWERLEFT", "UPPER", "door")


def test_a_room_goes_as_the_environment_does():
    room = ol.room("CC4", layout="trial7", attempt_limit=5)
    env = OpenLockEnv("CC4", "trial7", reward="paper", episode="trial", attempt_limit=5)
    env.reset(seed=0)
    for action in (*NOTHING, *FIRST, *SECOND, *FIRST, *THIRD):
        seen = room.step(action)
        after, reward, solved, spent, info = env.step(action_index(action, 7))
        np.testing.assert_array_equal(seen.observation, info.get("outcome", after))
        assert (seen.reward, seen.attempt_over) == (reward, "outcome" in info)
        assert seen.trial_over == (solved or spent) == room.over
        assert len(room.solutions_found) == info["console"]["solutions_found"]
    assert room.over
    with pytest.raises(OpenLockError, match="reset"):
        room.step("door")
    assert room.reset() is room
    assert (room.over, room.solutions_found) == (False, ())


def test_what_was_seen_is_said():
    room = ol.room("CC4", layout="trial7")
    seen = [room.step(action) for action in (*NOTHING, *FIRST, *FIRST, "LOWERLEFT")]
    assert [one.outcome for one in seen] == [
        *["nothing moves"] * 3,
        *("the lever moves", "the door unlocks", "the door opens: a new solution"),
        *("the lever moves", "the door unlocks", "the door opens: nothing new"),
        "the lever moves",
    ]
    assert [one.panel.attempts_left for one in seen] == [30, 30, 29, 29, 29, 28, 28, 28, 27, 27]
    assert ["this is" in one.title for one in seen[:6]] == [True, False, False, True, True, False]
    assert [one.new_solution for one in seen].index(True) == 5
    done = [action.name for action in seen[5].panel.actions]  # those of its own attempt
    assert done == ["push LOWERLEFT", "push UPPERRIGHT", "push door"]
    assert room.solutions_found == (("LOWERLEFT", "UPPERRIGHT"),)
    assert "door open, unlocked" in repr(seen[5])
    assert "1 of 3 solutions found; 27 attempts and 2 actions left" in repr(room)
    assert "4[#]" in repr(room)
    assert "found: LOWERLEFT, UPPERRIGHT" in repr(room)


@pytest.mark.parametrize("reveal", [True, False])
def test_a_room_to_solve_does_not_name_its_levers(reveal):
    room = ol.room("CC4", layout="trial7", reveal=reveal)
    seen = [room.step(action) for action in FIRST]
    for shown in (repr(seen[0]), seen_html(seen[0])):
        assert ("this is L0" in shown) == ("hidden" in shown) == reveal


def test_rooms_of_chance_and_random_layouts_follow_their_seed():
    def outcomes(seed):
        room = ol.room("A (0.5) -> B -> door", layout="random", seed=seed)
        places = dict(zip(("A", "B"), room.layout.name.split(), strict=True))
        return [room.layout.name, *(room.step(places[x]).outcome for x in "ABABABAB")]

    assert outcomes(1) == outcomes(1)
    assert len({tuple(outcomes(seed)) for seed in range(6)}) == 6
    room = ol.room("CC3", layout="random", seed=2)
    assert len({room.reset().layout.name for _ in range(6)}) > 3


def test_by_default_levers_are_where_the_authors_put_them_first():
    assert ol.room("CC3").layout.name == "trial1"
    assert ol.room("A -> door").layout.name == "UPPERRIGHT"
    twelve = ol.room(" | ".join("ABCDEFGH") + " -> door")
    assert twelve.step("P7").outcome == "the door unlocks"


def test_an_unknown_action_changes_nothing():
    room = ol.room("CC4")
    for action in ("UPER", "", 15, -1, 1.0, None, True):
        with pytest.raises(OpenLockError):
            room.step(action)
    assert "30 attempts and 3 actions left" in repr(room)
