"""Beliefs as edges, networks and models: by the oracle over every structure, and by pgmpy."""

from collections import Counter, defaultdict
from dataclasses import replace

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.belief.grammar import class_prior
from causal_openlock.belief.hypotheses import Strengths, at_least, strengths
from causal_openlock.belief.marginals import Posterior, model_of
from causal_openlock.belief.structure_schemas import structure_of
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.testing import schemas
from causal_openlock.world.room import position_names
from openlock_learners.bayes import Bayes
from oracle import Rules, likelihood, normalised, structure
from support.belief_arrays import fits, of_classes
from support.belief_play import KNOWN, Played
from support.session_play import HUMAN, SCHEMAS, named, one_room

pytestmark = pytest.mark.slow

NAMES = position_names(7)


def unlocked_by_walk(rules, up, down, push):
    """Levers are set, the others pushed one after another, causes first: is the door unlocked?"""
    states = Counter({frozenset(up) & frozenset(rules.levers): 1.0})
    causes = nx.DiGraph([(c, lever) for lever in rules.levers for c in rules.causes[lever]])
    causes.add_nodes_from(rules.levers)
    for lever in nx.topological_sort(causes):
        if lever in up | down:
            continue
        after = Counter()
        for pushed, likely in states.items():
            moves = push * rules.chance(lever, pushed)
            after[pushed | {lever}] += likely * moves
            after[pushed] += likely * (1.0 - moves)
        states = after
    return sum(likely for pushed, likely in states.items() if rules.holds(DOOR, pushed))


@settings(max_examples=40, deadline=None)
@given(
    data=st.data(),
    schema=schemas(max_levers=5) | st.sampled_from([*SCHEMAS.values()]),
    strength=st.sampled_from([0.3, 0.8, 1.0]),
    push=st.sampled_from([0.0, 0.3, 1.0]),
)
def test_interventions_on_any_lock(data, schema, strength, push):
    do = data.draw(st.dictionaries(st.sampled_from(schema.levers), st.booleans()))
    up = {lever for lever, state in do.items() if state}
    edges = {cause: dict.fromkeys(schema.graph[cause], strength) for cause in schema.levers}
    gates = {node: schema.gate(node) for node in (*schema.levers, DOOR) if schema.causes(node)}
    expected = unlocked_by_walk(
        Rules.of(Schema("all_equal", schema.levers, edges, gates=gates, inert=schema.inert)),
        up, do.keys() - up, push,
    )  # fmt: skip
    chance = np.stack([at_least(1.0), at_least(strength)])
    how = Strengths(np.array([1.0, strength]), np.array([0.0, 1.0]), chance)
    states = {schema.levers.index(lever): int(state) for lever, state in do.items()}
    posterior = Posterior(structure_of(schema), np.zeros(1, int), how, np.array([[0.0, 1.0]]))
    assert posterior.unlocked(states, push) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("noise", [0.0, 0.4])
def test_edges_and_models_are_averages_over_all_structures(noise):
    schema, prior = SCHEMAS["noisy_CC3" if noise else "CC3"], replace(KNOWN, noise=noise)
    played = Played(one_room(schema, "trial1"), prior, HUMAN)
    layout = played.session.truth.rooms[0].layout
    grey, (l0, l1, l2) = sorted(layout.places), layout.places
    white = min({*range(7)} - {*grey})
    how = strengths(noise)
    chances = defaultdict(float)
    for _, key, chance in of_classes(
        class_prior(prior.simplicity, prior.free_form), 3, prior.simplicity
    ):
        chances[key] += chance * fits(key, 2, 3)
    rooms = {
        structure(*key, float(strength)).at(dict(enumerate(grey))): (key, chance * surely)
        for key, chance in chances.items()
        for strength, surely in zip(how.value, how.prior, strict=True)
        if chance
    }
    told = []
    # One of the two solutions is found.
    script = iter([l1, l2, l0, l0, l1, 14, white, l0, l2])
    played._action = lambda view, row: next(script)
    for _ in played.moments(9):
        posterior = Posterior.of(played.belief(), played.beliefs.knowledge.classes(0))
        model = model_of(posterior)
        held = normalised({r: p * likelihood(r, played.happened[0]) for r, (_, p) in rooms.items()})
        expected, structures = np.zeros((7, 8)), Counter()
        for rules, probability in held.items():
            structures[rooms[rules][0]] += probability
            for node, causes in rules.causes.items():
                for cause in causes:
                    expected[cause, 7 if node == DOOR else node] += probability
        edges = posterior.expected().edges
        np.testing.assert_allclose(edges, expected, rtol=0, atol=1e-10)
        np.testing.assert_array_equal(model.edges.to_numpy(), edges)
        assert model.probability >= max(structures.values()) - 1e-10  # with all that act alike
        told.append(model.probability)
        for up, down, push in [({grey[0]}, set(), 0.0), ({grey[2]}, {grey[0]}, 0.6),
                               (set(), set(), 1.0), ({white}, set(), 0.0)]:  # fmt: skip
            by_hand = sum(p * unlocked_by_walk(r, up, down, push) for r, p in held.items())
            names = [[NAMES[place] for place in places] for places in (up, down)]
            assert model.expected_unlocked(*names, push) == pytest.approx(by_hand, abs=1e-10)
    assert told[0] < 0.2 < 0.5 < told[-1] < 0.9


def test_a_learner_tells_its_belief_as_a_network():
    from pgmpy.inference import VariableElimination

    session = Session(named("CC4"), HUMAN, 2, seed=2)
    learner = Bayes()
    learner.begin(session.brief)
    for _ in range(7):
        learner.learn(session.step(learner.act(session.view)))
    models = [learner.model(subject) for subject in range(2)]
    before = [model.expected_unlocked([name]) for model in models for name in NAMES]
    for subject, model in enumerate(models):
        schema = model.schema
        assert (schema, model.probability) == learner.most_probable(subject)
        assert model.network.check_model()
        assert {*model.network.nodes} == {*schema.levers, DOOR} <= {*NAMES, DOOR}
        assert set(model.network.edges) == set(schema.graph.edges)
        assert model.posterior.chance.sum() == pytest.approx(1, abs=1e-12)
        assert {*model.graph.nodes} == {*NAMES, DOOR}
        for cause, effect in schema.graph.edges:
            assert model.graph.edges[cause, effect]["probability"] == model.edges.loc[cause, effect]
        # The network can be asked, as well as the model.
        answer = VariableElimination(model.network).query([DOOR], show_progress=False)
        assert answer.get_value(**{DOOR: 1}) == pytest.approx(1.0)
        assert model.expected_unlocked() == 0.0
    for _ in range(3):
        learner.learn(session.step(learner.act(session.view)))
    after = [model.expected_unlocked([name]) for model in models for name in NAMES]
    assert before == after  # a model is of its moment
    now = [learner.model(s).expected_unlocked([name]) for s in range(2) for name in NAMES]
    assert now != after
