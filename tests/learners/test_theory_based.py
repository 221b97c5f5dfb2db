"""The theory-based model: its spaces, its equations by plain enumeration, and its paper."""

from itertools import combinations, permutations, product

import numpy as np
import pandas as pd
import pytest

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.session import Session
from causal_openlock.paper.likeness import distance, points_of
from causal_openlock.paper.published import model
from openlock_learners.chains import chains_of, edit_distances, schemas_of
from openlock_learners.theory_based import TheoryBased
from support.session_play import HUMAN, named, one_room, play

pytestmark = pytest.mark.slow

PLAIN = {"beliefs": "mean", "local_gain": 1.0, "global_gain": 2.0, "schema_gain": 1.0,
         "edit_weight": 0.7}  # fmt: skip


def shown(actions, **parameters):
    """A subject in a room of CC3 that has learned from these actions."""
    learner = create("theory_based", {**PLAIN, **parameters})
    assert isinstance(learner, TheoryBased)
    session = Session(one_room("CC3", "trial1"), HUMAN, 1, seed=1)
    session.begin(learner)
    learner.act(session.view)
    for action in actions:
        learner.learn(session.step(np.array([action])))
    return learner, session


def levers():
    """The cause, its two effects, and a white lever."""
    room = Session(one_room("CC3", "trial1"), HUMAN, 1).truth.rooms[0]
    (first, one, _), (_, other, _) = (room.action_of(own) for own in room.schema.solutions)
    return first, one, other, int(np.flatnonzero(~room.active)[0])


@pytest.mark.parametrize(
    ("paths", "distances"),
    [
        ([[0, 1], [0, 2]], [0, 2, 2]),  # common cause, itself
        ([[0, 1], [1, 2]], [2, 0, 2]),
        ([[1, 0], [2, 0]], [2, 2, 0]),
        ([[0, 1], [0, 2], [0, 3]], [2, 4, 4]),  # CC4 has a node and an edge more
        ([[1, 0], [2, 0], [3, 0]], [4, 4, 2]),
        ([[0, 1], [2, 3]], [3, 3, 3]),  # two edges that do not meet
        ([[0, 1], [1, 2], [0, 2]], [1, 1, 1]),  # all three atoms are in it
    ],
)
def test_distances_from_the_atomic_schemas(paths, distances):
    assert edit_distances(np.array(paths)).tolist() == distances


def test_abstract_schemas_are_the_ways_to_share_levers():
    # Digraphs without names, of two and of three arrows: 5 and 17.
    for solutions, abstract, instances in ((2, 5, 861), (3, 17, 11480)):
        schemas = schemas_of(7, 2, solutions)
        assert schemas is not None
        assert schemas.distance.shape == (abstract, 3)
        assert schemas.paths.shape == (solutions, instances)
    assert schemas_of(7, 2, 6) is None


def kind(paths):
    """An abstract schema, by its arrows under the best of all names."""
    nodes = sorted({lever for path in paths for lever in path})
    renamed = (dict(zip(nodes, order, strict=True)) for order in permutations(range(len(nodes))))
    return min((frozenset((to[a], to[b]) for a, b in paths) for to in renamed), key=sorted)


@pytest.mark.parametrize("with_solution", [False, True])
def test_chains_are_as_likely_as_the_schemas_that_they_complete(with_solution):
    first, one, other, white = levers()
    failed = [white, white, white, first, white, 14, other, white, white]
    learner, _ = shown([*failed, *([first, one, 14] if with_solution else [])])
    room = learner._rooms[0]
    found = (first, one) if with_solution else None

    def removed(chain):
        return chain[0] in (white, other) or chain[:2] == (first, white)

    paths = [*permutations(range(7), 2)]
    chains = {path: [(path[0] + 7 * a, path[1] + 7 * b) for a, b in product((0, 1), repeat=2)]
              for path in paths}  # fmt: skip
    left = {path: [one for one in own if not removed(one)] for path, own in chains.items()}
    if found:
        left[found] = [found]
    by_kind = {}
    for pair in combinations(paths, 2):
        if found is None or found in pair:
            by_kind.setdefault(kind(pair), []).extend(product(*(left[path] for path in pair)))
    # Equations 3 to 5, one schema after another.
    schemas = schemas_of(7, 2, 2)
    near = {kind(tuple(paths[path] for path in schemas.paths[:, m])): schemas.distance[g]
            for m, g in enumerate(schemas.abstract)}  # fmt: skip
    every = np.exp(-0.7 * np.array([*near.values()]))
    belief = {g: (np.exp(-0.7 * d) / every.sum(axis=0)).mean() for g, d in near.items()}
    expected = dict.fromkeys([chain for own in chains.values() for chain in own], 0.0)
    for g, instances in by_kind.items():
        for instance in instances:
            for chain in instance:
                expected[chain] += belief[g] / len(instances)
    likely = learner._top_down(0, room)
    for chain, value in zip(chains_of(7, 2).actions.tolist(), likely.tolist(), strict=True):
        wanted = 0.0 if tuple(chain) == found else expected[tuple(chain)]
        assert value == pytest.approx(wanted), chain


def test_a_solved_room_favours_the_nearest_atomic_schema():
    first, one, other, _ = levers()
    learner, _ = shown([first, one, 14, first, other, 14], schema_gain=2.5)
    assert learner._atomic[0].tolist() == [3.5, 1.0, 1.0]
    flat, session = shown([first, one, 14], top_down=False)
    flat.act(session.view)
    likely = flat._rooms[0].likely
    assert set(likely[likely > 0].tolist()) == {1.0}
    assert (likely == 0).sum() == 4  # the chains of the path that was found


def test_its_structure_holds_what_was_found_and_shares_the_rest_by_its_schemas():
    first, one, other, _ = levers()
    learner, _ = shown([first, one, 14])
    learner._atomic[0] = 1e9, 1.0, 1.0  # it is all but sure of a common cause
    sure = learner.structure(0).edges
    assert sure[[first, one], [one, -1]] == pytest.approx([1.0, 1.0])
    learner._atomic[0] = 1.0, 1.0, 1e9
    unsure = learner.structure(0).edges
    assert sure[first, other] > unsure[first, other]
    assert sure[other, one] < unsure[other, one]


def test_nothing_that_failed_is_begun_with_again():
    record = play(create("theory_based"), "CE4", subjects=8)
    for _, rows in record.groupby(["subject", "trial"]):
        dead = set()
        for actions, moved in zip(rows["actions"], rows["moved"], strict=True):
            begins = [tuple(actions[:length].tolist()) for length in (1, 2, 3)]
            assert not dead & {*begins}
            if not all(moved):
                dead.add(begins[list(moved).index(False)])


def test_changes_speak_for_their_attributes_in_the_room_and_beyond():
    first, one, other, white = levers()
    learner, _ = shown([white, first, one], local_gain=0.5)
    white_grey, push_pull, positions = np.split(learner._local[0], [2, 4])
    assert white_grey.tolist() == push_pull[::-1].tolist() == [1.0, 2.0]
    assert np.flatnonzero(positions > 1).tolist() == sorted((first, one))
    share = learner._theta[0, 1] * learner._theta[0, 2] * learner._theta[0, 4 + first]
    assert learner._bottom_up(0, learner._rooms[0])[first] == pytest.approx(share)
    # Four changes in the trial, shared out: a gain of two for grey, half of it for the cause.
    learner, session = shown([first, one, 14, first, other, 14])
    assert session.over
    assert learner._global[0, :4].tolist() == [1.0, 3.0, 3.0, 1.0]
    assert learner._global[0, 4 + first] == 2.0
    plain, _ = shown([first], bottom_up=False)
    assert (plain._bottom_up(0, plain._rooms[0]) == 1).all()


def test_asking_changes_nothing_where_no_chain_is_left():
    """As in a room that does not always obey: every chain was removed."""

    def played(asked):
        learner, session = shown([0])
        for first in range(14):
            learner._rooms[0].remove([first])
        done = []
        for _ in range(12):
            if asked:
                learner.probabilities(session.view)
            done.append(int(learner.act(session.view)[0]))
            learner.learn(session.step(np.array(done[-1:])))
        return done

    assert played(asked=True) == played(asked=False)


def test_it_does_what_was_published_of_the_model():
    played = []
    for name in PAPER_CONDITIONS:
        session = Session(named(name), HUMAN, 12, seed=7, learner="theory_based")
        played.append(attempts_to_solve(session.play(create("theory_based"))))
    # Means of so few subjects are off by about one attempt; the fit has more.
    assert distance(points_of(pd.concat(played), model()))[0] < 2.0
