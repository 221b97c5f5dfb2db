"""The exact optimum, and the learner that plays by it."""

from __future__ import annotations

import math
from functools import cache
from itertools import combinations, permutations

import numpy as np
import pytest

from causal_openlock.belief.optimal import Optimum, Symmetry
from causal_openlock.belief.placements import TooLargeError, mixture, placements
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.fsm import compile_schema as machine
from causal_openlock.schemas.schema import Gate, Schema
from support.checkpoints import same
from support.session_play import SCHEMAS, named, play, trials_of

pytestmark = pytest.mark.slow

MIXED = Schema(
    "mixed",
    ["A", "B", "C", "D"],
    {"A": ["C", "D"], "B": ["C"], "C": ["door"], "D": ["door"]},
)


def optimum(*names, limit=3, positions=None, **options):
    """The optimum of somebody who holds these schemas equally probable."""
    found = [(find_schema(name), 1 / len(names)) for name in names]
    return Optimum(*mixture(found, limit, positions), limit, **options)


# -- the numbers -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("schemas", "positions", "attempts"),
    [
        (("CC3",), None, 8 / 3),
        (("CE3",), None, 8 / 3),
        (("CC4",), None, 3.75),
        (("CE4",), None, 3.75),
        (("CC3", "CE3"), None, 2 + 5 / 6),
        (("CC4", "CE4"), None, 3.875),
        (("CC3",), 7, 4.905),
        (("CE3",), 7, 4.400),
        (("CC4",), 7, 5.836),
        (("CE4",), 7, 5.214),
        (("CC3", "CE3"), 7, 4.810),
        (("CC4", "CE4"), 7, 5.643),
    ],
)
def test_the_least_expected_number_of_attempts(schemas, positions, attempts):
    assert optimum(*schemas, positions=positions).attempts() == pytest.approx(attempts, abs=5e-4)


def test_an_unequal_prior_is_worth_up_to_what_knowing_is_worth():
    attempts = [
        Optimum(*mixture([(find_schema("CC4"), p), (find_schema("CE4"), 1 - p)], 3), 3).attempts()
        for p in (0.5, 0.9, 0.99)
    ]
    assert attempts == pytest.approx([3.875, 3.775, 3.7525])


# -- an independent way ----------------------------------------------------------------------------


def naive(rooms, limit):
    """Expectimax with every push, every pull and the door, without symmetry and without a bound.

    Args:
        rooms: Of each equally probable room its schema and, for each position, the lever there.
    """
    machines = [machine(schema) for schema, _ in rooms]
    positions = len(rooms[0][1])

    def act(room, state, action):
        """The machine's state after an action at a position."""
        roles, own = rooms[room][1], machines[room]
        if action == 2 * positions:
            return own.next_state[state, -1] if own.chance[state, -1] else state
        lever, pull = roles[action % positions], action >= positions
        if lever is None:
            return state
        column = lever + pull * len(own.schema.levers)
        return own.next_state[state, column] if own.chance[state, column] else state

    def seen(room, state):
        own, roles = machines[room], rooms[room][1]
        pushed = tuple(r is not None and bool(state >> r & 1) for r in roles)
        return pushed, bool(own.unlocked[state]), bool(own.opened[state])

    @cache
    def attempt(possible, found):
        """Further attempts of all possible rooms together, as an attempt begins."""
        if all(
            len(done) == len(rooms[room][0].solutions)
            for room, done in zip(possible, found, strict=True)
        ):
            return 0.0
        whole = (possible, found, (0,) * len(possible), limit)
        return len(possible) + go(*whole, True)

    @cache
    def go(possible, found, states, left, idle):
        """The same within an attempt; idle if it told nothing and found nothing so far."""
        if not left:
            return math.inf if idle else attempt(possible, found)
        best = math.inf
        for action in range(2 * positions + 1):
            outcomes = {}
            for room, done, state in zip(possible, found, states, strict=True):
                after = int(act(room, state, action))
                sight, new = seen(room, after), False
                if sight[-1]:
                    solution = int(machines[room].solution[after])
                    new = solution >= 0 and solution not in done
                    done = done | {solution} if new else done
                outcomes.setdefault((sight, new), []).append((room, done, after))
            value = 0.0
            for (sight, new), part in outcomes.items():
                who, dones, now = (tuple(column) for column in zip(*part, strict=True))
                still = idle and len(outcomes) == 1 and not new
                if sight[-1]:
                    value += math.inf if still else attempt(who, dones)
                else:
                    value += go(who, dones, now, left - 1, still)
            best = min(best, value)
        return best

    every = tuple(range(len(rooms)))
    return attempt(every, (frozenset(),) * len(rooms)) / len(rooms)


def rooms_of(names, positions=None):
    found = []
    for name in names:
        schema = find_schema(name) if isinstance(name, str) else name
        levers = len(schema.levers)
        for slots in combinations(range(positions or levers), levers):
            for order in permutations(range(levers)):
                room = [None] * (positions or levers)
                for slot, lever in zip(slots, order, strict=True):
                    room[slot] = lever
                found.append((schema, tuple(room)))
    return found


@pytest.mark.parametrize(
    ("schemas", "limit", "positions"),
    [
        (("CC3",), 3, None),
        (("CE3",), 4, None),
        (("CC3", "CE3"), 3, None),
        (("CC3", "CE3"), 4, None),
        (("CC3", "CE3"), 5, None),
        (("CE3",), 3, 4),
        (("two_keys",), 3, None),
        (("two_keys",), 5, None),
        (("chain3",), 4, None),
        (("chain3",), 5, None),
        (("chain3",), 6, None),
        (("CC4",), 3, None),
        (("CE4",), 3, None),
        ((MIXED,), 3, None),
    ],
)
def test_it_agrees_with_a_search_of_everything(schemas, limit, positions):
    expected = naive(rooms_of(schemas, positions), limit)
    assert optimum(*schemas, limit=limit, positions=positions).attempts() == pytest.approx(expected)
    if limit < 5:  # pulls are left out there, and would not have helped
        pulling = optimum(*schemas, limit=limit, positions=positions, pulls=True)
        assert pulling.attempts() == pytest.approx(expected)


def test_symmetry_and_canonical_names_change_nothing_but_the_work(monkeypatch):
    whole = optimum("CC3", "CE3", positions=5)
    expected, nodes = whole.attempts(), whole.nodes
    monkeypatch.setattr(Symmetry, "swappable", lambda *_: False)
    monkeypatch.setattr(Symmetry, "_renamed", lambda _, *state: state)
    plain = optimum("CC3", "CE3", positions=5, node_limit=math.inf)
    assert plain.attempts() == pytest.approx(expected)
    assert plain.nodes > 5 * nodes


@pytest.mark.parametrize(
    ("schemas", "most"), [(("CC4",), 4), (("CE4",), 4), (("CC3",), 3), (("two_of_four",), 6)]
)
def test_the_most_that_it_may_come_to(schemas, most):
    assert optimum(*schemas).most() == most


def test_all_levers_are_equally_good_at_first():
    for name in ("CC4", "CE4", "CC3"):
        best = optimum(name)
        assert best.best(best.start) == list(range(len(find_schema(name).levers)))


# -- what is too large -----------------------------------------------------------------------------


def test_what_takes_too_long_is_given_up():
    with pytest.raises(TooLargeError):
        optimum("CC4", "CE4", positions=7, node_limit=50).attempts()
    wide = Schema("wide", [f"L{i}" for i in range(10)],
                  {f"L{i}": [f"L{i + 1}"] for i in range(9)} | {"L9": ["door"]})  # fmt: skip
    with pytest.raises(TooLargeError, match="wide can be placed in 3,628,800 ways"):
        placements(wide, 11)
    session = Session(Condition("wide", (Trials(wide),)), Protocol("p", 3, True), 2)
    with pytest.raises(LearnerError, match="leave this learner or this schema out"):
        session.play(create("ideal"))


def test_placements_that_act_alike_are_one():
    assert [len(placements(SCHEMAS[name], 3)) for name in ("CC3", "CE4", "two_of_four")] == [
        3,
        4,
        1,
    ]
    same_twice, weight = mixture([(SCHEMAS["CC3"], 0.25), (SCHEMAS["CC3"], 0.75)], 3, 7)
    assert len(same_twice) == 105
    assert weight == pytest.approx(1 / 105)


# -- the learner -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("condition", "phase", "attempts"),
    [
        ("CC4", "train", 3.75),
        ("CE4", "train", 3.75),
        ("CC3-CE4", "train", 8 / 3),
        ("CE3-CC4", "train", 8 / 3),
        ("chain3", "train", optimum("chain3", limit=4).attempts()),
        ("two_keys", "train", optimum("two_keys").attempts()),
    ],
)
def test_it_needs_as_many_attempts_as_the_optimum(condition, phase, attempts):
    trials = trials_of(play(create("ideal"), condition, subjects=400))
    assert (trials["found"] == trials["solutions"]).all()
    taken = trials.xs(phase, level="phase")["attempts"]
    assert taken.mean() == pytest.approx(attempts, abs=4 * taken.std() / math.sqrt(len(taken)))


def test_what_is_equally_good_is_drawn_by_chance():
    record = play(create("ideal"), "CC4", subjects=400)
    first = record[(record["attempt"] == 1) & (record["trial"] == 1)]
    places = first.groupby("layout", observed=True)["actions"].agg(
        lambda actions: np.unique([a[0] for a in actions], return_counts=True)[1]
    )
    for counts in places:
        assert len(counts) == 4
        assert counts.min() > counts.max() / 3


@pytest.mark.parametrize("name", ["noisy_CC3", "seven"])
def test_where_the_optimum_is_out_of_reach_it_plans_ahead(name, monkeypatch):
    monkeypatch.setattr("causal_openlock.belief.optimal.HYPOTHESIS_LIMIT", 100)
    from openlock_learners.ideal import _solver

    _solver.cache_clear()
    trials = trials_of(play(create("ideal"), name, subjects=5 if name == "seven" else 40))
    _solver.cache_clear()
    assert (trials["found"] == trials["solutions"]).all()
    assert trials["attempts"].mean() < {"noisy_CC3": 4.3, "seven": 8}[name]


def test_it_repeats_solutions_when_there_is_nothing_left_to_find():
    protocol = Protocol("on", 12, stop_when_solved=False, baseline_trials=1)
    record = play(create("ideal"), "CC4", protocol, subjects=20)
    assert record[record["attempt"] > 8]["opened"].all()


def test_it_is_told_no_layout():
    class Blind:
        """A room that tells its schema and nothing else."""

        def __init__(self, room):
            self.schema = room.schema

    def told(hide):
        session = Session(named("CC3-CE4"), Protocol("p", 8, True), 5)
        learner = create("ideal")
        learner.begin(session.brief)
        actions = []
        while not session.over:
            truth = session.truth
            if hide:
                truth = type(truth)(tuple(map(Blind, truth.rooms)), truth.room)
            learner.inform(truth)
            actions.append(learner.act(session.view).tolist())
            learner.learn(session.step(np.array(actions[-1])))
        return actions

    assert told(hide=True) == told(hide=False)


def test_unequal_strengths_and_gates_are_played():
    uneven = Schema(
        "uneven",
        ["A", "B", "C"],
        {"A": {"C": 0.6}, "B": {"C": 0.9}, "C": {"door": 1.0}},
        gates={"C": Gate("all")},
    )
    trials = trials_of(play(create("ideal"), Condition("uneven", (Trials(uneven),)), subjects=30))
    assert (trials["found"] == trials["solutions"]).all()


def test_a_checkpoint_is_a_copy():
    session = Session(named("CC4"), Protocol("p", 8, True), 3)
    learner = create("ideal")
    learner.begin(session.brief)
    learner.inform(session.truth)
    learner.learn(session.step(learner.act(session.view)))
    kept = learner.state_dict()
    assert same(kept["draws"]["drawn"], learner.state_dict()["draws"]["drawn"])
    weights = [room["weight"].copy() for room in kept["rooms"]]
    found = [room["found"] for room in kept["rooms"]]
    while not session.over and session.view.trial.max() == 1:
        learner.learn(session.step(learner.act(session.view)))
    assert same(weights, [room["weight"] for room in kept["rooms"]])
    assert found == [room["found"] for room in kept["rooms"]]
