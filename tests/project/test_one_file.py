"""The example in one file is equal to the package: rooms, plans, posteriors."""

from __future__ import annotations

import ast
import importlib.util
from collections import defaultdict
from itertools import permutations
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from causal_openlock.analysis.results.bounds import ideal_attempts
from causal_openlock.belief.hypotheses import strengths
from causal_openlock.belief.likelihoods import DOOR, Event, likelihood
from causal_openlock.belief.optimal import Optimum, Point, bits
from causal_openlock.belief.placements import mixture
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.world.room import Layout, Room
from support.places import ROOT
from support.session_play import SCHEMAS

PATH = ROOT / "examples" / "openlock_in_one_file.py"
NOTHING = frozenset[int]()
ODDS = (0.5, 0.75, 1.0)


@pytest.fixture(scope="module")
def one() -> ModuleType:
    spec = importlib.util.spec_from_file_location("openlock_in_one_file", PATH)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def prior(odds: float) -> tuple[tuple[str, float], ...]:
    return tuple((name, share) for name, share in (("CC", odds), ("CE", 1 - odds)) if share)


def of_package(odds: float, levers: int) -> tuple[Hypotheses, Any]:
    return mixture([(SCHEMAS[f"{name}{levers}"], share) for name, share in prior(odds)], 3)


def structures(hypotheses: Hypotheses) -> list[tuple[frozenset[int], ...]]:
    """The causes of each slot, and of the door, under each hypothesis."""
    return [
        tuple(frozenset(np.flatnonzero(mask >> np.arange(12) & 1).tolist()) for mask in causes)
        for causes in hypotheses.causes
    ]


def structure(own: dict[int, set[int]]) -> tuple[frozenset[int], ...]:
    return tuple(frozenset(own[node]) for node in sorted(own))  # the door is 7: the last


def test_it_is_short_and_needs_numpy_alone():
    text = PATH.read_text(encoding="utf-8")
    imported = {
        name.name if isinstance(node, ast.Import) else node.module
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in node.names
    }
    assert imported == {"functools", "itertools", "numpy"}
    assert len(text.splitlines()) <= 200


# -- rooms ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["CC3", "CE3", "CC4", "CE4"])
def test_every_sequence_of_three_actions_leads_to_what_it_leads_to_in_the_package(one, name):
    schema, levers = SCHEMAS[name], len(SCHEMAS[name].levers)
    places = np.random.default_rng(levers).permutation(7)[:levers].tolist()
    theirs, ours = Room.of(schema, Layout(tuple(places))), one.Room(name[:2], places)
    solutions = {
        frozenset(places[schema.levers.index(lever)] for lever in found)
        for found in schema.solutions
    }
    opened: set[frozenset[int]] = set()

    def go_through(state: int, actions: list[int]) -> None:
        ours.reset()
        for action in actions:
            ours.step(action)
        assert ours.observation().tolist() == theirs.observation[state].tolist(), actions
        if ours.opened:
            opened.add(ours.pushed)
        elif len(actions) < 3:
            for action in range(15):
                go_through(int(theirs.next_state[state, action]), [*actions, action])

    go_through(0, [])
    assert opened == ours.found == solutions


def test_long_walks_are_the_same_too(one):
    """In three actions no lever can be pulled back and the door be opened after it."""
    generator = np.random.default_rng(0)
    for name in ("CC4", "CE4"):
        places = generator.permutation(7)[:4].tolist()
        theirs, ours = Room.of(SCHEMAS[name], Layout(tuple(places))), one.Room(name[:2], places)
        state, useful = 0, [*places, *(7 + np.array(places)), *places]
        for action in generator.choice(useful, 500).tolist():
            ours.step(action)
            state = theirs.next_state[state, action]
            assert ours.observation().tolist() == theirs.observation[state].tolist()


# -- plans ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("levers", [3, 4])
@pytest.mark.parametrize("name", ["CC", "CE"])
def test_the_ideal_observer_needs_as_many_attempts(one, name, levers):
    beliefs = one.Beliefs(((name, 1.0),), levers)
    exact = ideal_attempts(SCHEMAS[f"{name}{levers}"], 3)
    assert exact == pytest.approx({3: 8 / 3, 4: 3.75}[levers])
    assert beliefs.attempts(tuple(range(levers)), NOTHING) == pytest.approx(exact)


@pytest.mark.parametrize("odds", ODDS)
@pytest.mark.parametrize("levers", [3, 4])
def test_plans_of_who_does_not_know_the_schema_are_worth_as_much_in_every_state(one, odds, levers):
    own, weight = of_package(odds, levers)
    optimum = Optimum(own, weight, 3, pulls=True)
    beliefs = one.Beliefs(prior(odds), levers)
    theirs = structures(own)
    flags = [[structure(made) == other for other in theirs] for _, made in beliefs.hypotheses]
    assert np.sum(flags, axis=1).tolist() == [1] * len(theirs)
    everything = tuple(range(len(flags)))
    value = beliefs.attempts(everything, NOTHING)
    assert value == pytest.approx(optimum.attempts())
    if odds == 0.5 and levers == 4:
        assert value == pytest.approx(3.75 + 0.125)  # what it is worth to know the schema
    generator, seen = np.random.default_rng(1), set()
    for _ in range(60):  # wherever anything may lead
        possible, found = everything, NOTHING
        for _ in range(3):
            pushed = NOTHING
            for left in (3, 2, 1):
                seen.add((possible, found, pushed, left))
                action = tuple(generator.integers([2, levers]).tolist())
                action = (2, 0) if generator.random() < 0.4 else action
                outcomes = beliefs.outcomes(possible, pushed, *action)
                (pushed, _, opens), possible = [*outcomes.items()][
                    generator.integers(len(outcomes))
                ]
                if opens:
                    found |= {pushed}
                    break
    assert len(seen) > 30
    for possible, found, pushed, left in seen:
        state = Point(
            bits(np.any([flags[h] for h in possible], axis=0)),
            tuple(sorted(sum(1 << slot for slot in each) for each in found)),
            sum(1 << slot for slot in pushed),
            left,
        )
        ours = min(beliefs.expected(possible, found, pushed, left).values())
        assert ours == pytest.approx(optimum.value(state))


class First:
    """In the place of a generator: the first of what is as good."""

    def integers(self, _: int) -> int:
        return 0


@pytest.mark.parametrize(("odds", "expected"), [(1.0, 3.75), (0.5, 3.875)])
def test_the_player_needs_what_is_planned_over_all_rooms_that_it_holds_possible(
    one, odds, expected
):
    names = [name for name, _ in prior(odds)]
    played = [
        one.play(one.Room(name, places), one.Bayes(First(), names))
        for name in names
        for places in permutations([0, 2, 3, 6])
    ]
    assert np.mean(played) == pytest.approx(expected)


def test_equally_good_actions_are_drawn_and_the_mean_is_the_same(one):
    played = [one.last_trial("CC4", True, seed) for seed in range(150)]
    assert abs(np.mean(played) - 3.75) < 3.5 * np.std(played) / np.sqrt(len(played))
    firsts = {one.Bayes(np.random.default_rng(s), ["CC"]) for s in range(20)}
    room = one.Room("CC", [1, 2, 4, 6])
    for player in firsts:
        player.enter(room.observation())
    assert {player.act(room.observation(), 3) for player in firsts} == {1, 2, 4, 6}


# -- posteriors -----------------------------------------------------------------------------------


@pytest.mark.parametrize("odds", [0.5, 0.8])
@pytest.mark.parametrize("levers", [3, 4])
def test_posteriors_after_anything_at_all_are_the_packages(one, odds, levers):
    own, weight = of_package(odds, levers)
    theirs, certain = structures(own), strengths(0.0, 1.0, 1.0, 1)
    generator = np.random.default_rng(levers)
    narrowed = 0
    for name in ("CC", "CE") * 10:
        room = one.Room(name, generator.permutation(7)[:levers].tolist())
        player = one.Bayes(generator)
        player.rooms = {"CC": 10 * odds, "CE": 10 * (1 - odds)}
        player.enter(room.observation())
        posterior, found = weight / weight.sum(), ()
        for _ in range(6):
            room.reset()
            for left in (3, 2, 1):
                before, known = room.observation(), room.found
                player.act(before, left)
                action = int(generator.choice([*player.grey, *range(15), 14, 14]))
                room.step(action)
                after = room.observation()
                player.learn(action, after)
                event = event_of(player.grey, before, action, after, room.found != known, found)
                if event is not None:
                    every = np.arange(len(own))
                    posterior = posterior * likelihood(own, every, certain, event)
                    posterior /= posterior.sum()
                    found = (*found, event.pushed) if event.new else found
                ours = defaultdict(float)
                for h in player.possible:
                    share = player.beliefs.odds[h] / player.beliefs.probability(player.possible)
                    ours[structure(player.beliefs.hypotheses[h][1])] += share
                assert [ours[each] for each in theirs] == pytest.approx(posterior.tolist())
                if room.opened:
                    break
        narrowed += len(player.possible) < len(own)
    assert narrowed > 15


def event_of(
    grey: list[int], before: Any, action: int, after: Any, new: bool, found: tuple[int, ...]
) -> Event | None:
    """What the package calls an event; None for what teaches nothing."""
    verb, place = divmod(action, 7)
    pushed = sum(1 << slot for slot, one in enumerate(grey) if before[one])
    if verb == 2:
        locked = bool(before[-2])
        return None if locked else Event(DOOR, pushed, bool(after[-1]), True, new, found)
    if place not in grey or bool(before[place]) != (verb == 1):
        return None
    moved = bool(before[place] != after[place])
    return Event(grey.index(place), pushed, moved, not after[-2], False, found)


def test_a_room_counts_for_its_schema_and_that_is_what_transfers(one):
    generator = np.random.default_rng(5)
    player = one.Bayes(generator)
    for _ in range(6):
        one.play(one.Room("CE", generator.permutation(7)[:3].tolist()), player)
    assert player.rooms == pytest.approx({"CC": 1.0, "CE": 7.0})
    player.enter(one.Room("CE", [0, 1, 2, 3]).observation())
    own, weight = of_package(1 / 8, 4)
    everything = tuple(range(len(own)))
    expected = Optimum(own, weight, 3).attempts()
    assert player.beliefs.attempts(everything, NOTHING) == pytest.approx(expected)


def test_the_table_has_people_the_ideal_observer_and_the_learner(one, capsys):
    one.main(subjects=2)
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["condition", "people", "ideal", "bayes"]
    means = {row.split()[0]: [*map(float, row.split()[1:])] for row in rows}
    published = {"CC4": 6.45, "CE4": 9.43, "CC3-CC4": 5.53, "CE3-CC4": 8.18, "CC3-CE4": 13.75}
    assert {name: row[0] for name, row in means.items()} == published | {"CE3-CE4": 7.72}
    assert all(3 <= mean <= 4 for row in means.values() for mean in row[1:])
