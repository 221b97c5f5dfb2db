"""The simple rivals, against their rules worked out by hand."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.session import Session
from support.session_play import HUMAN, one_room, play

LAYOUT = "trial1"  # CC3: UPPERRIGHT 0 frees LOWERLEFT 4 and LOWER 5, which unlock the door


def shown(learner, actions, schema="CC3"):
    """A session in one room whose only subject learns from these actions, whatever it wants."""
    session = Session(one_room(schema, LAYOUT), HUMAN, 1, seed=1)
    session.begin(learner)
    for action in actions:
        learner.act(session.view)
        learner.learn(session.step(np.array([action])))
    return session


def levers_of_cc3():
    room = Session(one_room("CC3", LAYOUT), HUMAN, 1).truth.rooms[0]
    (first, one, _), (_, other, _) = (room.action_of(own) for own in room.schema.solutions)
    return first, one, other


def test_it_never_carries_out_a_sequence_twice_in_a_room():
    record = play(create("win_stay"), "CC4", subjects=12)
    for _, rows in record.groupby(["subject", "trial"]):
        done = [tuple(actions) for actions in rows["actions"]]
        assert len(set(done)) == len(done)
        assert all(len({*levers}) == 2 and door == 14 for *levers, door in done)
    assert record["solutions_found"].max() == 3


def test_after_a_success_it_keeps_one_of_the_two_levers_in_its_place():
    first, one, other = levers_of_cc3()
    learner = create("win_stay")
    shown(learner, [])
    won = [tuple(pair) for pair in learner._sequences].index((first, one))
    learner._tried[0, won] = learner._won[0, won] = True
    tried = {tuple(learner._sequences[index]) for index in np.flatnonzero(learner._odds(0))}
    assert (first, other) in tried
    assert tried == {(a, b) for a, b in permutations(range(7), 2) if (a == first) != (b == one)}


def test_it_starts_over_when_nothing_is_left():
    learner = create("win_stay")
    shown(learner, [])
    learner._tried[:] = True
    assert learner._odds(0).all()


def test_what_worked_in_a_room_is_tried_first_in_the_next():
    room = one_room("CC3", LAYOUT, trials=2)
    learner = create("win_stay")
    record = Session(room, replace(HUMAN, attempt_limit=42), 30).play(learner).to_pandas()
    begins = record[(record["trial"] == 2) & (record["attempt"] == 1)]
    assert begins["new_solution"].all()  # the same room again; by luck a pair is right once in 21


def test_a_prediction_error_is_shared_by_the_cues_that_are_present():
    first, one, _ = levers_of_cc3()
    given = {"lever": 0.3, "position": 0.1, "colour": 0.2, "partial": 0.5}
    learner = create("associative", given)
    shown(learner, [first])
    assert learner.lever[0, first] == pytest.approx(0.3 * 0.5)
    assert learner.position[0, first] == pytest.approx(0.1 * 0.5)
    assert learner.colour[0].tolist() == pytest.approx([0, 0.2 * 0.5, 0, 0, 0, 0])
    # Another grey lever: its colour predicts .1 of the effect, so .4 is unexpected; then the door,
    # whose unlocked lock is new.
    learner = create("associative", given)
    session = shown(learner, [first, one, 14])
    assert learner.lever[0, one] == pytest.approx(0.3 * 0.4)
    assert learner.colour[0].tolist() == pytest.approx([0, 0.1 + 0.2 * 0.4, 0, 0, 0, 0.2])
    assert learner.strength(session.view.observation)[0, 14] == pytest.approx(0.3 + 0.1)  # locked


def test_levers_of_another_room_are_new_and_colours_are_not():
    learner = create("associative")
    record = play(learner, "CC3", subjects=3)
    assert record["solutions_found"].max() > 0
    assert not learner.lever.any()
    assert learner.colour.any(axis=1).all()


def test_what_is_seen_to_be_impossible_is_not_done():
    record = play(create("associative", {"temperature": 50.0}), "two_of_four", subjects=6)
    for actions, moved in zip(record["actions"], record["moved"], strict=True):
        out = set()
        for action, did in zip(actions, moved, strict=True):
            assert action not in out
            assert action == 14 or action < 7 or action - 7 in out
            if did and action < 14:
                out ^= {action % 7}


def test_q_values_are_watkins_own():
    first, one, _ = levers_of_cc3()
    learner = create("tabular_q", {"learning_rate": 0.5, "gamma": 0.8})
    session = shown(learner, [])
    start = session.view.observation

    def attempt(last=14):
        values = []
        for action in (first, one, last):
            before = session.view.observation
            learner.learn(session.step(np.array([action])))
            values.append(float(learner.values(before)[0, action]))
        return values

    assert attempt() == pytest.approx([0.5, 5.0, 25.0])  # half of 1, 10 and 50
    # 1 + .8 * 5, 10 + .8 * 25, and 50 alone.
    assert attempt() == pytest.approx([0.25 + 2.5, 2.5 + 15.0, 12.5 + 25.0])
    # The door could be opened next, but the attempt is over: no value reaches beyond it.
    assert attempt(last=first)[2] == pytest.approx(0.5 * -0.5)
    assert np.flatnonzero(learner.values(start)[0]).tolist() == [first]


def test_a_greedy_one_draws_among_equals_and_its_epsilon_follows_the_paper():
    learner = create("tabular_q", {"epsilon_start": 0.0, "epsilon_min": 0.0, "gamma": 0.0,
                                   "learning_rate": 0.0, "epsilon_after_trial": None})  # fmt: skip
    record = play(learner, "CC3", subjects=20)
    assert set(np.concatenate(record["actions"].to_numpy())) == {*range(15)}
    learner = create("tabular_q", {"epsilon_decay": 0.9})
    shown(learner, [0, 0, 0])
    assert learner.exploration.epsilon[0] == pytest.approx(0.9**3)
    learner = create("tabular_q")
    play(learner, "CC3", subjects=2)
    assert (learner.exploration.epsilon == 0.5).all()  # as every trial has ended


def test_the_posterior_is_the_prior_and_what_was_counted():
    first, one, _ = levers_of_cc3()
    # The prior's mean by looks: of three grey levers that were pushed, two came out and left the
    # lock as it was, and one unlocked it.
    learner = create("posterior_sampling", {"concentration": 0.7})
    session = shown(learner, [first, one, 14, first])
    grey = session.view.observation[0, 7:14].astype(int)
    model = learner.model(0, grey)
    start, after = 0, int(learner._number[1 << first])
    assert model[start, 0, first].tolist() == pytest.approx([0.1, 0.1, 2.3, 0.2])
    assert model[after, 0, one].tolist() == pytest.approx([0.1, 0.1, 0.3, 1.2])
    untried = next(lever for lever in range(7) if grey[lever] and lever not in (first, one))
    assert model[start, 0, untried].tolist() == pytest.approx([0.1, 0.1, 0.3, 0.2])
    assert model[after, 1, 14].tolist() == pytest.approx([0.14, 0.14, 0.14, 0.28])  # opened once


def test_the_table_grows_with_what_is_met():
    condition = find_condition("CE3-CE4")
    learner = create("tabular_q")
    Session(condition, HUMAN, 100, seed=2018).play(learner)
    assert learner._values.shape[1] > 64
