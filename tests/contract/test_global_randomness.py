"""A learner that draws from the random numbers of all is named, and does nothing to others."""

import random
import warnings

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import OneSubjectLearner
from support.command import modules_of
from support.documents import DOCS, code


class Tidy(Learner):
    """Draws from its own generators and leaves everything as it is."""

    def begin(self, brief):
        self.brief = brief

    def act(self, view):
        actions = self.brief.actions
        return np.array([int(own.integers(actions)) for own in self.brief.generators])


class Draws(Tidy):
    def act(self, view):
        return np.random.randint(0, self.brief.actions, self.brief.subjects)  # noqa: NPY002


class DrawsForOne(OneSubjectLearner):
    def act(self, observation):
        observation[0] = 1  # which is a copy of its own
        return random.randrange(self.brief.actions)


class DrawsWithTorch(Tidy):
    def act(self, view):
        import torch

        return torch.randint(0, self.brief.actions, (self.brief.subjects,)).numpy()


def warned(learner):
    """What a comparison in this process warns of a learner, once."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        results = ol.compare(["CC3", "CE3"], learner, subjects=2, workers=0)
    said = [str(one.message) for one in caught if issubclass(one.category, UserWarning)]
    assert [one for one in results.warnings if "random numbers" in one] == said
    return said


def attempts(learner):
    """The attempts of a comparison in this process."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return ol.compare("CC3", learner, subjects=2, workers=0).attempts.drop(columns="wall_time")


@pytest.mark.parametrize(
    ("kind", "generators"),
    [
        (Tidy, []),
        (Draws, ["numpy.random"]),
        (DrawsForOne, ["random"]),
        (DrawsWithTorch, ["torch"]),
    ],
)
def test_a_learner_that_uses_global_generators_is_named(kind, generators):
    before = GlobalRandomness.now()
    found = warned(kind)
    assert before.differs_from(GlobalRandomness.now()) == []
    assert len(found) == len(generators)
    for sentence, name in zip(found, generators, strict=True):
        assert f"{kind.__name__}: " in sentence
        assert f"random numbers of {name}," in sentence


@pytest.mark.parametrize("kind", [Draws, DrawsForOne, DrawsWithTorch])
def test_its_results_are_the_same_whatever_was_drawn_before(kind):
    first = attempts(kind)
    for _ in range(3):
        random.random(), np.random.random()  # noqa: NPY002
    assert attempts(kind).equals(first)


class Writes(Tidy):
    def learn(self, step):
        step.next.console.attempts_left[0] = 9


def test_what_a_learner_is_given_cannot_be_changed():
    with pytest.raises(ol.OpenLockError, match=r"read-only \(test_.*py:\d+\).*copy"):
        ol.compare("CC3", Writes, subjects=1, workers=0)


def test_the_network_of_the_guide_keeps_to_its_own_randomness(tmp_path, monkeypatch):
    guide = (DOCS / "howto" / "learner.md").read_text(encoding="utf-8")
    (text,) = [one for one in code(guide, "python") if "class Network" in one]
    (tmp_path / "my_network.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with modules_of(tmp_path):
        assert warned("my_network:Network") == []
