"""A trial to watch: what the film shows, moment by moment, with the belief of a trace beside it."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.belief.trace import trace_trial
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.render.film import shots
from causal_openlock.render.watch import BELIEVED, TRUE, WatchedTrial, belief_svg
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import position_coordinates


@pytest.fixture(scope="module")
def watched() -> WatchedTrial:
    return ol.watch("bayes", "CC3", layout="trial3", seed=4)


class Doorward(ol.OneSubjectLearner):
    """Pushes the door."""

    def act(self, observation: Any) -> int:
        return len(observation) - 2


class Lockward(ol.Learner):
    """Pushes the first lever."""

    def begin(self, brief: Any) -> None:
        self.subjects = brief.subjects

    def act(self, view: Any) -> Any:
        return np.zeros(self.subjects, dtype=np.int64)


@pytest.mark.parametrize("chance", [False, True])
def test_moments_are_those_at_which_a_film_rests(watched: WatchedTrial, chance: bool) -> None:
    if chance:  # some actions fail
        watched = ol.watch("oracle", "A (0.4) -> B, C -> door", seed=1, attempts=8)
    film = [shot for shot in shots(watched.trial) if not shot.moving]
    assert len(film) == len(watched.shots)
    for moment, shot in zip(watched.shots, film, strict=True):
        assert (moment.attempt, moment.action) == (shot.attempt, shot.action)
        assert moment.panel == shot.panel
        assert np.allclose(moment.look.levers, np.round(shot.look.levers))
        assert (moment.look.locked, moment.look.grey) == (shot.look.locked, shot.look.grey)


def test_a_belief_is_the_one_of_the_same_moment(watched: WatchedTrial) -> None:
    assert watched.trace is not None
    actions = [action for attempt in watched.trial.attempts for action in attempt.actions]
    assert len(watched.trace.actions) == len(actions)
    for shot in watched.shots:
        belief = watched.belief(shot)
        if shot.action:
            done = [one for one in watched.trace.actions if one.attempt == shot.attempt]
            action = done[shot.action - 1]
            assert belief is action.after
            name = (shot.panel.actions or ())[-1].name
            assert action.name.replace("_", " ", 1) == name
    first = watched.shots[0]
    assert watched.belief(first) is watched.trace.snapshots[0]


def test_a_trial_is_the_one_of_trace_and_film() -> None:
    condition = Condition.named("CC3-CC4", find_schema)
    there: Any = {"trial": 2, "subject": 3, "seed": 7, "label": "bayes"}
    seen = ol.watch("bayes", "CC3-CC4", trial=2, subject=3, seed=7)
    assert seen.trial == ol.play_trial(create("bayes"), condition, PROTOCOLS["human"], **there)
    trace = trace_trial(create("bayes"), condition, PROTOCOLS["human"], **there)
    assert seen.trace is not None
    assert [one.name for one in seen.trace.actions] == [one.name for one in trace.actions]
    np.testing.assert_array_equal(seen.trace.entropies, trace.entropies)


def test_arrows_are_as_dark_as_they_are_probable(watched: WatchedTrial) -> None:
    assert watched.trace is not None
    for shot in (watched.shots[0], watched.shots[-1]):
        belief = watched.belief(shot)
        assert belief is not None
        svg = belief_svg(belief, watched.trace)
        ET.fromstring(svg)
        shades = [float(x) for x in re.findall(f'opacity="([0-9.]+)" stroke="{BELIEVED}"', svg)]
        expected = sorted(p for p in belief.edges.flat if p >= 0.02)
        np.testing.assert_allclose(shades, expected, atol=0.00501)
        darkest = re.findall(r'd="M(\S+),(\S+) Q\S+ (\S+),(\S+)" fill="none" stroke-width="6"', svg)
        ends = np.array(darkest[-1], float).reshape(2, 2)
        spots = position_coordinates(7) * [100, -100]
        spots = np.vstack([spots, [spots[:, 0].max() + 150, 0]])
        nearest = [int(np.hypot(*(spots - end).T).argmin()) for end in ends]
        assert belief.edges[tuple(nearest)] == belief.edges.max()
        assert svg.count(TRUE) == len(watched.trace.truth.graph.edges)


@pytest.mark.parametrize(
    ("learner", "label"),
    [
        ("random", "random"),
        (Doorward, "Doorward"),
        (Lockward, "Lockward"),
        (Lockward(), "Lockward"),
        (ol.learner("bayes", label="mine", lapse=1.0), "mine"),
    ],
)
def test_learners_are_given_by_name_class_or_entry(learner: Any, label: str) -> None:
    seen = ol.watch(learner, "A -> B -> door", attempts=2)
    assert seen.title.startswith(f"{label} in schema, trial 1 of ")
    assert (seen.trace is not None) == (label == "mine")
    assert len(repr(seen).splitlines()) == 1 + 2 * 3
    assert "attempt 2, " in repr(seen)
    if label == "Doorward":
        assert repr(seen).count("push door: nothing moves") == 6


def test_conditions_are_given_by_name_schema_text_or_as_such() -> None:
    chosen = [ol.find_schema("CC3"), "CC3", Condition.named("CC3", find_schema)]
    seen = [repr(ol.watch("oracle", one, layout="trial2")) for one in chosen]
    assert len({*seen}) == 1
    assert "(CC3 in trial2)" in seen[0]


@pytest.mark.parametrize(
    ("words", "options", "says"),
    [
        (("bays", "CC4"), {}, "did you mean bayes?"),
        (("oracle", "CC5"), {}, "did you mean CC4?"),
        (("oracle", "A -> dor"), {}, "did you mean door?"),
        (("oracle", "CC4"), {"layout": "trial77"}, "did you mean trial7?"),
        (("oracle", "CC4"), {"attempts": 0}, "at least 1, and this is 0"),
        (("oracle", "CC4"), {"trial": 6}, "has no trial 6"),
        (("oracle", "CC3-CC4"), {"layout": "trial1"}, "has rooms of several kinds"),
        (("oracle", "CC4"), {"protocol": "humans"}, "did you mean human?"),
    ],
)
def test_mistakes_are_answered_with_one_sentence(words: Any, options: Any, says: str) -> None:
    with pytest.raises(OpenLockError) as caught:
        ol.watch(*words, **options)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_it_is_saved_as_a_film_of_the_attempts_shown(tmp_path: Path) -> None:
    seen = ol.watch("random", "CC3", attempts=1)
    frames = seen.save(tmp_path / "film.gif", size=60, fps=5)
    assert frames == sum(shot.frames for shot in shots(seen.trial, fps=5, attempts=1))
    assert (tmp_path / "film.gif").read_bytes()[:6] == b"GIF89a"
    with pytest.raises(OpenLockError, match=r"a film is a \.gif or \.mp4"):
        seen.save(tmp_path / "film.avi")
