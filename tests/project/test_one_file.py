"""The example in one file against the oracle: rooms, plans, posteriors, and its table."""

import ast
import runpy
from types import SimpleNamespace

import numpy as np
import pytest

from causal_openlock.schemas.finding import find_schema
from oracle import DOOR, Rules, placements, posterior
from oracle import Room as Trial
from support.belief_arrays import seen_in
from support.places import ROOT

PATH = ROOT / "examples" / "openlock_in_one_file.py"


@pytest.fixture(scope="module")
def one():
    return SimpleNamespace(**runpy.run_path(str(PATH)))


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


def key(structure):
    """A structure of the example as the oracle's key."""
    return frozenset(
        (DOOR if node == 7 else node, frozenset((c, 1.0) for c in causes), min(1, len(causes)))
        for node, causes in structure.items()
    )


@pytest.mark.parametrize("levers", [3, 4])
@pytest.mark.parametrize("name", ["CC", "CE"])
def test_rooms_and_posteriors_are_the_oracles(one, name, levers):
    generator = np.random.default_rng(levers)
    names = [find_schema(f"{kind}{levers}") for kind in ("CC", "CE")]
    narrowed = 0
    for _ in range(25):
        places = generator.permutation(7)[:levers].tolist()
        rules = Rules.of(find_schema(f"{name}{levers}"))
        trial = Trial(rules.at(dict(zip(rules.levers, places, strict=True))), 7)
        room, player = one.Room(name, places), one.Bayes(generator)
        player.rooms = {"CC": 8.0, "CE": 2.0}
        player.enter(room.observation())
        prior = dict(placements(dict(zip(names, (0.8, 0.2), strict=True))))
        happened = []
        for _ in range(6):
            room.reset()
            trial.begin()
            while not trial.over:
                before, known = room.observation(), room.found
                assert before.tolist() == trial.observation()
                player.act(before, 3 - trial.used)
                action = int(generator.choice([*player.grey, *player.grey, *range(15), 14, 14]))
                trial.step(action)
                room.step(action)
                player.learn(action, room.observation())
                pull, place = divmod(action, 7)
                door, slots = pull == 2, [*player.grey, 14, 15]
                after, new = room.observation()[slots], room.found != known
                if door and not before[-2]:
                    happened.append((DOOR, *seen_in(before[slots], after, levers, new, True)))
                elif not door and place in player.grey and pull == before[place]:
                    told = seen_in(before[slots], after, levers, new, False)
                    happened.append((player.grey.index(place), *told))
            assert room.found == frozenset(trial.found)
            events = [(pushed, node, seen) for node, pushed, seen in happened]
            expected = {rules.key: p for rules, p in posterior(prior, events).items()}
            odds = player.beliefs.probability(player.possible)
            ours = {
                key(player.beliefs.hypotheses[h][1]): player.beliefs.odds[h] / odds
                for h in player.possible
            }
            assert ours == pytest.approx(expected)
        narrowed += len(ours) < len(prior)
    assert narrowed > 15


def test_a_room_counts_for_its_schema_and_that_is_what_transfers(one):
    generator = np.random.default_rng(5)
    player = one.Bayes(generator)
    for _ in range(6):
        one.play(one.Room("CE", generator.permutation(7)[:3].tolist()), player)
    assert player.rooms == pytest.approx({"CC": 1.0, "CE": 7.0})


def test_the_table_has_people_the_ideal_observer_and_the_learner(one, capsys):
    one.main(subjects=2)
    head, *rows = capsys.readouterr().out.splitlines()
    assert head.split() == ["condition", "people", "ideal", "bayes"]
    means = {row.split()[0]: [*map(float, row.split()[1:])] for row in rows}
    published = {"CC4": 6.45, "CE4": 9.43, "CC3-CC4": 5.53, "CE3-CC4": 8.18, "CC3-CE4": 13.75}
    assert {name: row[0] for name, row in means.items()} == published | {"CE3-CE4": 7.72}
    assert all(3 <= mean <= 4 for row in means.values() for mean in row[1:])
