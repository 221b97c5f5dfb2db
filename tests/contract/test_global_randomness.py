"""A learner that draws from the random numbers of all is named, and does nothing to others."""

import random
import warnings

import numpy as np
import pytest
import rich.style  # noqa: F401 - draws a number when it is imported

import causal_openlock as ol
from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import OneSubjectLearner
from support.command import modules_of
from support.documents import DOCS, code


class Tidy(Learner):
    """Draws from its own generators and leaves everything as it is."""

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


class Writes(Tidy):
    def learn(self, step):
        step.next.console.attempts_left[0] = 9


def played(learner):
    """What was done in a comparison in this process, and what it warns of, once a process."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        results = ol.compare(["CC3", "CE3"], learner, subjects=2, workers=0)
    said = [str(one.message) for one in caught if issubclass(one.category, UserWarning)]
    assert not said or said == [one for one in results.warnings if "random numbers" in one]
    return results.attempts.drop(columns="wall_time"), said


@pytest.mark.parametrize(
    ("kind", "generators"),
    [(Tidy, []), (Draws, ["numpy.random"]), (DrawsForOne, ["random"]), (DrawsWithTorch, ["torch"])],
)
def test_a_learner_that_uses_global_generators_is_named_and_reproducible(kind, generators):
    before = GlobalRandomness.now()
    attempts, said = played(kind)
    assert before.differs_from(GlobalRandomness.now()) == []
    assert len(said) == len(generators)
    for sentence, name in zip(said, generators, strict=True):
        assert f"{kind.__name__}: " in sentence
        assert f"random numbers of {name}," in sentence
    random.random(), np.random.random()  # noqa: NPY002
    assert played(kind)[0].equals(attempts)


def test_what_a_learner_is_given_cannot_be_changed():
    with pytest.raises(ol.OpenLockError, match=r"read-only.*copy.*\(test_.*py:\d+\)"):
        ol.compare("CC3", Writes, subjects=1, workers=0)


def test_the_network_of_the_guide_keeps_to_its_own_randomness(tmp_path, monkeypatch):
    guide = (DOCS / "howto" / "learner.md").read_text(encoding="utf-8")
    (text,) = [one for one in code(guide, "python") if "class Network" in one]
    (tmp_path / "my_network.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with modules_of(tmp_path):
        assert played("my_network:Network")[1] == []
