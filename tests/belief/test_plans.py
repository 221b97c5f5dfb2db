"""Plans, optimal play, regret and the worth of a schema, against plain recursion."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import causal_openlock as ol
from causal_openlock.belief.hypotheses import RoomSight, enumerate_space, strengths
from causal_openlock.belief.observer import Observer
from causal_openlock.belief.optimal import Optimum, Point, bits
from causal_openlock.belief.placements import TooLargeError, mixture, placements
from causal_openlock.belief.planning import Objective, Planner, Situation
from causal_openlock.belief.worth import listed_schemas
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Gate, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.room import Layout
from oracle import (
    DOOR,
    NOTHING,
    Plans,
    Rules,
    branches,
    entropy,
    least_attempts,
    schema_worth,
    worth_of,
)
from oracle import placements as placed
from support.belief_arrays import mask, rules_in

CERTAIN = strengths(0.0)
UNSURE = strengths(0.5, nodes=2)
BRANCHES = "A -> B; B -> door; C -> door"


def mixed(names, limit=3, positions=None):
    """Hypotheses and weights of who holds these schemas equally probable."""
    return mixture([(find_schema(name), 1 / len(names)) for name in names], limit, positions)


# -- plans of the structure learner ----------------------------------------------------------------


class Thinker:
    """Some hypotheses as arrays and as the oracle's rules."""

    def __init__(self, hypotheses, how):
        self.hypotheses, self.how = hypotheses, how
        strength = how.value[hypotheses.strength].tolist()
        self.rules = [rules_in(hypotheses, i, s) for i, s in enumerate(strength)]
        self.slots = [*range(hypotheses.causes.shape[1] - 1), DOOR]

    def values(self, belief, pushed, unlocked, left, found, objective):
        """The planner's values, by node; levers that are pushed and a locked door have none."""
        planner = Planner(self.hypotheses[[*map(self.rules.index, belief)]], self.how, objective)
        at = Situation(mask(pushed), unlocked, left, tuple(map(mask, found)))
        values = planner.values(np.array([*belief.values()]), at)
        return dict(zip(self.slots, values.tolist(), strict=True))

    def moments(self, rng, attempts, limit=3):
        """What a subject believes, and where it stands, in attempts of random actions."""
        weights = rng.dirichlet(np.full(len(self.rules), 0.7)).tolist()
        belief = dict(zip(self.rules, weights, strict=True))
        truth, found = self.rules[rng.choice(len(weights), p=weights)], NOTHING
        for _ in range(attempts):
            pushed, unlocked, left = NOTHING, False, limit
            while left:
                yield belief, pushed, unlocked, left, found
                nodes = [slot for slot in self.slots[:-1] if slot not in pushed]
                node = nodes[rng.integers(len(nodes))] if nodes else DOOR
                node = DOOR if unlocked and rng.random() < 0.6 else node
                own = truth.outcomes(pushed, node, found)
                seen = [*own][rng.choice(len(own), p=[*own.values()])]
                belief = branches(belief, pushed, node, found)[seen]
                found |= {pushed} if seen.new else NOTHING
                pushed, unlocked = seen.pushed, seen.unlocked
                left = 0 if seen.opened else left - 1


def some_room(seed, unsure, many=8):
    """Some hypotheses about a few levers of which not all need be active."""
    rng, how = np.random.default_rng(seed), UNSURE if unsure else CERTAIN
    sight = [RoomSight(3, 3, 2, 3), RoomSight(3, 2, 1, 3), RoomSight(4, 4, 3, 3)][seed % 3]
    space = enumerate_space(sight, how, 0.7)
    chosen = np.sort(rng.choice(len(space), size=min(many, len(space)), replace=False))
    return Thinker(space.hypotheses[chosen], how), rng


@pytest.mark.parametrize("unsure", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_values_of_actions_are_those_of_plain_recursion(seed, unsure):
    thinker, rng = some_room(seed, unsure)
    for belief, pushed, unlocked, left, found in thinker.moments(rng, attempts=2):
        may = [slot for slot in thinker.slots[:-1] if slot not in pushed] + [DOOR] * unlocked
        for information, beta, horizon in ((1.0, 3.0, None), (1.0, 0.0, 9), (0.0, 1.0, 1)):
            objective = Objective(information, beta, horizon)
            values = thinker.values(belief, pushed, unlocked, left, found, objective)
            ahead = min(left, horizon or left)
            for slot, value in values.items():
                expected = -math.inf
                if slot in may:
                    expected = worth_of(belief, pushed, slot, found, ahead, information, beta)
                assert value == pytest.approx(expected, abs=1e-7)


# -- optimal play ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "positions", "attempts"),
    [
        (("CC3",), None, 8 / 3),
        (("CC4",), None, 3.75),
        (("CE4",), None, 3.75),
        (("CC4", "CE4"), None, 3.875),
        (("CC3",), 7, 4.905),
        (("CE3",), 7, 4.400),
        (("CC4",), 7, 5.836),
        (("CE4",), 7, 5.214),
        (("CC3", "CE3"), 7, 4.810),
        (("CC4", "CE4"), 7, 5.643),
    ],
)
def test_the_least_expected_attempts_that_are_published(names, positions, attempts):
    assert Optimum(*mixed(names, 3, positions), 3).attempts() == pytest.approx(attempts, abs=5e-4)


LONG = Schema("long", ["A", "B", "C"], {"A": ["door"], "C": ["A"]}, inert=["B"])
SHORT = Schema("short", ["A", "B", "C"], {"B": ["door"], "C": ["A"]}, inert=["A", "C"])


@settings(max_examples=30, deadline=None)
@example(drawn=[LONG, SHORT], weights=[1.0] * 4, more=0)
@given(
    drawn=st.lists(schemas(max_levers=3), min_size=1, max_size=4),
    weights=st.lists(st.sampled_from([0.2, 1.0, 3.0]), min_size=4, max_size=4),
    more=st.integers(0, 1),
)
def test_the_optimum_of_random_schemas_is_that_of_a_search_of_everything(drawn, weights, more):
    def shape(schema):
        return len(schema.levers), len(schema.solutions)

    own = {one: w for one, w in zip(drawn, weights, strict=False) if shape(one) == shape(drawn[0])}
    limit = max(schema.least_action_limit for schema in own) + more
    shares = [(schema, weight / sum(own.values())) for schema, weight in own.items()]
    least = least_attempts(own, limit)
    for pulls in [True, False][: 2 if limit <= 3 else 1]:  # within three actions none helps
        optimum = Optimum(*mixture(shares, limit), limit, pulls=pulls)
        assert optimum.attempts() == pytest.approx(least)


@pytest.mark.parametrize(
    ("names", "limit"), [(("CC3", "CE3"), 3), (("CC4", "CE4"), 3), (("chain3",), 5)]
)
def test_values_and_best_actions_in_every_state_that_may_come(names, limit):
    hypotheses, weight = mixed(names, limit)
    optimum = Optimum(hypotheses, weight, limit, pulls=True)
    belief = placed({find_schema(name): 1.0 for name in names})
    keys = [rules_in(hypotheses, index).key for index in range(len(hypotheses))]
    assert {rules.key for rules, _ in belief} == set(keys)
    assert len(belief) == len(keys)
    plans, rng = Plans(limit, hypotheses.solutions.shape[1]), np.random.default_rng(1)
    levers, seen_states = hypotheses.causes.shape[1] - 1, set()
    for _ in range(40):
        possible, found = belief, NOTHING
        for _ in range(3):
            pushed, left = NOTHING, limit
            while left and len(found) < plans.find:
                seen_states.add((possible, found, pushed, left))
                node = DOOR if rng.random() < 0.4 else int(rng.integers(levers))
                parts = branches(dict(possible), pushed, node, found)
                seen = [*parts][rng.integers(len(parts))]
                possible = tuple(parts[seen].items())
                found |= {pushed} if seen.new else NOTHING
                pushed, left = seen.pushed, 0 if seen.opened else left - 1
    assert len(seen_states) > 30
    for possible, found, pushed, left in seen_states:
        which = np.isin(np.arange(len(keys)), [keys.index(rules.key) for rules, _ in possible])
        point = Point(bits(which), tuple(sorted(map(mask, found))), mask(pushed), left)
        values = plans.after(possible, found, pushed, left)
        total = sum(weight for _, weight in possible)
        least = min(values.values())
        assert optimum.value(point) == pytest.approx(least / total)
        does = {
            node
            for node, value in values.items()
            if value <= least + 1e-9
            and any(seen.moved for seen in branches(dict(possible), pushed, node, found))
        }
        best = {
            DOOR if action == 2 * levers else (action % levers, action >= levers)
            for action in optimum.best(point)
        }
        assert best == {n if n == DOOR else (n, n in pushed) for n in does or {DOOR}}


def test_regret_and_information_of_attempts_in_a_room():
    for name, limit in (("CC4", 3), ("CE3", 3), ("chain3", 4)):
        schema = find_schema(name)
        belief = placed({schema: 1.0})
        plans = Plans(limit, len(schema.solutions))
        rng = np.random.default_rng(2)
        for _ in range(4):
            layout = Layout.random(schema, rng)
            grey = sorted(layout.places)
            attempts = rng.choice([*grey, *grey, *(7 + g for g in grey), 14, 14, 0], (4, limit))
            place = dict(zip(schema.levers, map(grey.index, layout.places), strict=True))
            truth = Rules.of(schema).at(place)
            worths = Observer(schema, limit).trial(layout, attempts.tolist())
            possible, found = belief, NOTHING
            for attempt, worth in zip(attempts.tolist(), worths, strict=False):
                pushed, left, told = NOTHING, limit, np.zeros(2)
                for action in attempt:
                    whole = dict(possible)
                    every = [*range(len(grey)), DOOR]
                    parts = [branches(whole, pushed, node, found) for node in every]
                    pull, position = divmod(action, 7)
                    node = DOOR if pull == 2 else grey.index(position) if position in grey else None
                    does = node == DOOR or (node is not None and pull == (node in pushed))
                    cost = plans.regret(possible, found, pushed, left, node if does else None)
                    seen = None
                    if does:
                        (seen,) = truth.outcomes(pushed, node, found)
                        possible = tuple(parts[every.index(node)][seen].items())
                        found |= {pushed} if seen.new else NOTHING
                        pushed = seen.pushed
                    gained = entropy(whole) - entropy(dict(possible))
                    told += [cost, gained]
                    left -= 1
                    if seen and seen.opened:
                        break
                got = [worth.regret, worth.gained]
                assert got == pytest.approx(told.tolist(), abs=1e-8)


def test_the_most_attempts_that_it_may_come_to():
    for name, most in (("CC4", 4), ("CE4", 4), ("CC3", 3), ("two_of_four", 6)):
        assert Optimum(*mixed([name]), 3).most() == most


def test_a_room_of_924_solutions_takes_924_attempts():
    levers = [f"L{index}" for index in range(12)]
    free = Schema("free", levers, {lever: [DOOR] for lever in levers},
                  gates={DOOR: Gate("at_least", 6)})  # fmt: skip
    assert Optimum(*mixture([(free, 1.0)], 7), 7).attempts() == 924


def test_placements_that_act_alike_are_one():
    many = [len(placements(find_schema(name), 3)) for name in ("CC3", "CE4", "two_of_four")]
    assert many == [3, 4, 1]
    twice, weight = mixture([(find_schema("CC3"), 0.25), (find_schema("CC3"), 0.75)], 3, 7)
    assert len(twice) == 105
    assert weight == pytest.approx(1 / 105)


def test_what_takes_too_long_is_given_up():
    with pytest.raises(TooLargeError):
        Optimum(*mixed(["CC4", "CE4"], 3, 7), 3, node_limit=50).attempts()
    wide = ol.schema("; ".join(f"L{i} -> L{i + 1}" for i in range(9)) + "; L9 -> door")
    with pytest.raises(TooLargeError, match="3,628,800 ways"):
        placements(wide, 11)


# -- what a schema is worth ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("first", "among", "options"),
    [
        ("CC4", "CE4", {}),
        ("CC3", "A -> door; B -> C; C -> door", {"action_limit": 4}),
        (BRANCHES, {"CC3": 2.0, "A -> B; C -> B; B -> door; A -> door": 0.5}, {}),
        ("A -> door; B -> C; C -> door", "A -> B; B -> door; C -> door", {"action_limit": 5}),
        ("A -> B; B -> door", "A & B -> door", {"levers_known": False}),
        ("CC3", "all", {}),
    ],
)
def test_worth_is_that_of_a_plain_search_over_policies(first, among, options):
    found = ol.schema_worth(first, among, **options)
    positions = None if found.levers_known else 7
    known, unknown = schema_worth(dict(found.among), found.action_limit, positions)
    assert found.known.attempts == pytest.approx(known, abs=1e-9)
    assert found.unknown.attempts == pytest.approx(unknown, abs=1e-9)
    assert found.worth == pytest.approx(unknown - known, abs=1e-9)
    for observer in (found.known, found.unknown):
        assert sum(observer.each) == pytest.approx(observer.attempts, abs=1e-9)


def test_the_worth_of_schemas_solution_by_solution_and_by_weight():
    paper = ol.schema_worth("CC4", "CE4")
    assert paper.known.each == paper.known.here == paper.unknown.here == (1.75, 1, 1)
    assert paper.states == paper.known.states + paper.unknown.states > 20
    keys = ol.schema_worth("shared_key", ["same_keys", "own_keys"])
    assert keys.worth == pytest.approx(0.699074, abs=1e-6)
    assert sum(keys.unknown.here) - sum(keys.known.here) == pytest.approx(1.186111, abs=1e-6)
    # Whichever schema is named first, weights are those of the schemas.
    first, other = (
        ol.schema_worth("CC4", {"CE4": 3.0}),
        ol.schema_worth("CE4", {"CC4": 1, "CE4": 3}),
    )
    assert [chance for _, chance in first.among] == [0.25, 0.75]
    assert other.worth == pytest.approx(first.worth)
    whole = 0.25 * sum(first.unknown.here) + 0.75 * sum(other.unknown.here)
    assert whole <= first.unknown.attempts + 1e-9


def test_possible_schemas_are_listed_once_and_known_rooms_sharpen_the_grammar():
    schemas = [schema for schema, _ in listed_schemas(ol.schema("CC3"), 3)]
    assert len(schemas) == 12
    assert schemas[0] == ol.schema("CC3")
    chances = [chance for _, chance in listed_schemas(ol.schema("CE4"), 3, ())]
    assert len(chances) == 44
    assert sum(chances) == pytest.approx(1)
    own = [
        listed_schemas(ol.schema("CC4"), 3, [ol.schema("CC3")] * rooms)[0][1] for rooms in (0, 1, 5)
    ]
    assert own[0] < own[1] < own[2]
