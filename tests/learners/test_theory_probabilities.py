"""The theory-based model's probabilities, against enumeration, integrals and Bayes' rule."""

from copy import deepcopy

import numpy as np
import pytest

from causal_openlock.contract.registry import create
from causal_openlock.experiment.session import Session
from openlock_learners.theory.draws import DRAWS, AttemptDraws, Moment
from openlock_learners.theory_based import TheoryBased
from support.session_play import HUMAN, one_room

pytestmark = pytest.mark.slow

PLAIN = {"beliefs": "mean", "local_gain": 1.0}


def shown(actions, **parameters):
    """A subject that was asked for its probabilities, and told that it did these actions."""
    learner = create("theory_based", parameters)
    assert isinstance(learner, TheoryBased)
    session = Session(one_room("CC3", "trial1"), HUMAN, 1, seed=1)
    session.begin(learner)
    for action in actions:
        learner.probabilities(session.view)
        learner.learn(session.step(np.array([action])))
    return learner, session


# Of CC3 in this layout, 0 frees 4 and 5; 1 is white.
@pytest.mark.parametrize("actions", [[], [1], [0], [1, 0], [0, 4, 14], [8, 14, 3, 0, 4]])
@pytest.mark.parametrize("changed", [{}, {"bottom_up": False}, {"top_down": False}])
def test_without_samples_they_are_those_of_ties(actions, changed):
    learner, session = shown(actions, **PLAIN, **changed)
    (found,) = learner.probabilities(session.view)
    assert learner.sample_size() is None
    many = np.count_nonzero(found)

    class Fixed:
        def __init__(self, number):
            self.number = number

        def random(self):
            return self.number

    done = np.zeros_like(found)
    for number in (np.arange(many) + 0.5) / many:  # all that its generator can come to
        again = deepcopy(learner)
        again.brief = type("Brief", (), {**vars(learner.brief), "generators": [Fixed(number)],
                                         "actions": 15})  # fmt: skip
        done[again.act(session.view)[0]] += 1.0 / many
    assert found == pytest.approx(done, abs=1e-9)


def test_with_samples_they_are_integrals():
    """The greatest of attributes, and then the greatest that is left, all of flat beliefs."""
    given = {"top_down": False, "foresight": False, "retries": False}
    learner, session = shown([], **given)
    (first,), many = learner.probabilities(session.view), learner.sample_size()
    grey = learner._rooms[0].grey
    learner.learn(session.step(np.array([1])))  # nothing moves: what is left is for attributes
    (second,), left = learner.probabilities(session.view), learner.sample_size()

    # A lever's worth is exponential, by its colour; v times as much if it is pulled.
    nodes, weights = np.polynomial.legendre.leggauss(14)
    x = np.geomspace(1e-6, 40, 1500)
    colour, verb = (nodes + 1) / 2, (3 - nodes) / 4  # of white; of push, where that is greater
    scale = np.where(grey == 1, 1 - colour[:, None], colour[:, None])[..., None, None]
    v = ((1 - verb) / verb)[:, None]

    def below(lever, x):
        return 1 - np.exp(-x / scale[:, lever])

    def mean(integrand, lever):
        by_colour_and_verb = np.trapezoid(
            integrand * np.exp(-x / scale[:, lever]) / scale[:, lever], x
        )
        return float(weights @ by_colour_and_verb @ weights / 8)

    levers = range(7)
    greatest = [mean(np.prod([below(o, x) for o in levers if o != one], axis=0) + 0 * v, one)
                for one in levers]  # fmt: skip
    assert sum(greatest) == pytest.approx(0.5, abs=1e-3)
    expected = np.array([*greatest, *greatest, 0.0])
    assert first == pytest.approx(expected, abs=4 * np.sqrt(0.25 / many[0]))
    assert many[0] == DRAWS

    then = np.zeros(15)  # of all that is worth less than the push of lever 1
    for one in (0, 2, 3, 4, 5, 6):
        others = np.prod([below(o, x) for o in levers if o not in (1, one)], axis=0)
        then[one] = mean(others * (below(1, x / v) - below(1, x)), one)
    then[8] = mean(np.prod([below(o, x * v) for o in levers if o != 1], axis=0), 1)
    assert then.sum() == pytest.approx(greatest[1], abs=1e-3)
    assert second == pytest.approx(then / then.sum(), abs=4 * np.sqrt(0.25 / left[0]))
    assert second[[1, 14]].tolist() == [0.0, 0.0]
    assert 256 <= left[0] <= DRAWS


def test_what_was_done_tells_what_was_drawn():
    """Attributes that are one of four, schemas that are one of two: all can be enumerated."""
    generator, chances = np.random.default_rng(0), np.array([0.02, 0.3, 0.3, 0.38])
    prefers = np.array([[0, 1], [1, 1], [1, 2], [2, 1]])  # by attribute and schema

    def attributes(many):
        return generator.choice(4, size=(many, 1), p=chances)

    def schemas(many):
        return generator.integers(2, size=(many, 1))

    def worth(theta, belief):
        return (prefers[theta[:, 0], belief[:, 0]][:, None] == np.arange(3)).astype(float)

    def moment(removed):
        return Moment(worth, schemas, removed, np.ones(3, dtype=bool))

    drawn, weight = AttemptDraws(attributes), chances[:, None] * np.full(2, 0.5)
    for removed, action in ((0, 0), (0, 0), (1, 1), (2, 1)):
        if removed:  # schemas are drawn anew
            weight = weight.sum(axis=1, keepdims=True) * np.full(2, 0.5)
        expected = [weight[prefers == one].sum() / weight.sum() for one in range(3)]
        odds = drawn.ask(moment(removed))
        assert odds == drawn.ask(moment(removed))
        assert odds.of == pytest.approx(expected, abs=4 * np.sqrt(0.25 / odds.draws) + 0.01)
        drawn.acted(action)
        weight = weight * (prefers == action)
    # Of the first batch about twenty were left: it drew again.
    assert odds.draws > 100


@pytest.mark.parametrize("form", ["aaai_2020", "cogsci_2019"])
@pytest.mark.parametrize("left", [True, False])
def test_asking_changes_nothing_even_where_no_chain_is_left(form, left):
    """As in a room that does not always obey: every chain was removed."""

    def played(asked):
        learner, session = shown([] if left else [0], form=form)
        learner.act(session.view)
        if not left:
            (room,) = learner._rooms
            room.allowed = np.zeros_like(room.allowed)
            room.schemas, room.likely = np.zeros(0, dtype=np.int64), None
        done = []
        for _ in range(25 if left else 12):
            if asked:
                learner.probabilities(session.view)
            done.append(int(learner.act(session.view)[0]))
            learner.learn(session.step(np.array(done[-1:])))
        return done

    assert played(asked=True) == played(asked=False)
