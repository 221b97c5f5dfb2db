"""A trial to watch: what the film shows, moment by moment, with the belief of a trace beside it."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.render.film import play_trial, shots
from causal_openlock.render.watch import BELIEVED, TRUE, belief_svg


@pytest.fixture(scope="module")
def watched():
    return ol.watch("bayes", "CC3", layout="trial3", seed=4)


class Doorward(ol.OneSubjectLearner):
    """Pushes the door."""

    def act(self, observation):
        return len(observation) - 2


@pytest.mark.parametrize("chance", [False, True])
def test_moments_are_those_at_which_a_film_rests(watched, chance):
    if chance:  # some actions fail
        watched = ol.watch("oracle", "A (0.4) -> B, C -> door", seed=1, attempts=8)
    film = shots(watched.trial)
    film = [shot for shot in film if all(action.outcome for action in shot.panel.actions)]
    assert len(film) == len(watched.shots)
    for moment, shot in zip(watched.shots, film, strict=True):
        assert (moment.attempt, moment.action) == (shot.attempt, shot.action)
        assert moment.panel == shot.panel
        assert np.allclose(moment.look.levers, np.round(shot.look.levers))
        assert (moment.look.locked, moment.look.grey) == (shot.look.locked, shot.look.grey)


def test_a_belief_is_the_one_of_the_same_moment(watched):
    actions = [action for attempt in watched.trial.attempts for action in attempt["actions"]]
    assert len(watched.trace.actions) == len(actions)
    for shot in watched.shots:
        if shot.action:
            traced = [one for one in watched.trace.actions if one.attempt == shot.attempt]
            action = traced[shot.action - 1]
            assert watched.belief(shot) is action
            assert action.action.replace("_", " ", 1) == shot.panel.actions[-1].name
    assert watched.belief(watched.shots[0]) is watched.trace.moments[0]


def test_a_trial_is_the_one_of_trace_and_film():
    condition = find_condition("CC3-CC4")
    where = {"trial": 2, "subject": 3, "seed": 7, "label": "bayes"}
    seen = ol.watch("bayes", "CC3-CC4", trial=2, subject=3, seed=7)
    film = play_trial(ol.create("bayes"), condition, PROTOCOLS["human"], **where)
    for one, other in zip(seen.trial.attempts, film.attempts, strict=True):
        assert {**one, "wall_time": 0} == {**other, "wall_time": 0}
    trace = ol.trace_trial(ol.create("bayes"), condition, PROTOCOLS["human"], **where)
    assert [one.action for one in seen.trace.actions] == [one.action for one in trace.actions]
    np.testing.assert_array_equal(seen.trace.entropies, trace.entropies)


def test_arrows_are_as_dark_as_they_are_probable(watched):
    for shot in (watched.shots[0], watched.shots[-1]):
        belief = watched.belief(shot)
        svg = belief_svg(belief, watched.trace)
        ET.fromstring(svg)
        shades = [float(x) for x in re.findall(f'opacity="([0-9.]+)" stroke="{BELIEVED}"', svg)]
        expected = sorted(p for p in belief.edges.flat if p >= 0.02)
        np.testing.assert_allclose(shades, expected, atol=0.00501)
        assert svg.count(TRUE) == len(watched.trace.truth.graph.edges)


def test_learners_are_given_by_name_class_or_entry():
    for learner, label in (
        ("random", "random"),
        (Doorward, "Doorward"),
        (ol.learner("bayes", label="mine", lapse=1.0), "mine"),
    ):
        seen = ol.watch(learner, "A -> B -> door", attempts=2)
        assert seen.title.startswith(f"{label} in schema, trial 1 of ")
        assert (seen.trace is not None) == (label == "mine")
        assert len(repr(seen).splitlines()) == 1 + 2 * 3
        assert label != "Doorward" or repr(seen).count("push door: nothing moves") == 6


def test_conditions_are_given_by_name_schema_or_as_such():
    chosen = [ol.find_schema("CC3"), "CC3", find_condition("CC3")]
    seen = [repr(ol.watch("oracle", one, layout="trial2")) for one in chosen]
    assert len({*seen}) == 1
    assert "(CC3 in trial2)" in seen[0]


def test_it_is_saved_as_a_film_of_the_attempts_shown(tmp_path):
    seen = ol.watch("random", "CC3", attempts=1)
    frames = seen.save(tmp_path / "film.gif", size=60, fps=5)
    assert frames == sum(shot.frames for shot in shots(seen.trial, fps=5, attempts=1))
    assert (tmp_path / "film.gif").read_bytes()[:6] == b"GIF89a"
