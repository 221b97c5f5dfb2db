"""Checks of learners: their failures, their probabilities, and the random numbers of others."""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from importlib import import_module
from typing import Any

import numpy as np

from causal_openlock.errors import LearnerError, failures_as

_NUMPY: Any = np.random


def failures_of(name: str) -> AbstractContextManager[None]:
    """A block that calls a learner; what it raises becomes a LearnerError with its name."""
    remedy = "; its contract tests say more (causal_openlock.testing)"
    return failures_as(LearnerError, f"the learner {name} fails", remedy)


def are_probabilities(found: Any, actions: int) -> bool:
    """Whether ``found`` holds rows of probabilities of ``actions`` actions.

    >>> are_probabilities(np.full((2, 4), 0.25), 4), are_probabilities(np.ones((2, 4)), 4)
    (True, False)
    """
    return (
        isinstance(found, np.ndarray)
        and found.dtype.kind in "fiu"
        and found.shape[1:] == (actions,)
        and bool((found >= 0).all() and np.allclose(found.sum(axis=1), 1.0, atol=1e-6))
    )


class GlobalRandomness(dict[str, Any]):
    """States of the random generators that all code of a process shares, by their modules."""

    @classmethod
    def now(cls) -> GlobalRandomness:
        """The states now; torch's included if torch is imported."""
        states = cls({"random": random.getstate(), "numpy.random": _NUMPY.get_state()})
        if torch := sys.modules.get("torch"):
            states["torch"] = torch.get_rng_state().numpy()
        return states

    @classmethod
    @contextmanager
    def seeded(cls, seed: int) -> Iterator[GlobalRandomness]:
        """A block that begins with all of them seeded, in the states it yields; then restores."""
        before = cls.now()
        random.seed(seed)
        _NUMPY.seed(seed % 2**32)
        if torch := sys.modules.get("torch"):
            torch.manual_seed(seed)
        try:
            yield cls.now()
        finally:
            before.restore()

    def restore(self) -> None:
        """Put these states in place."""
        random.setstate(self["random"])
        _NUMPY.set_state(self["numpy.random"])
        if "torch" in self or "torch" in sys.modules:
            torch = import_module("torch")  # in a process that continues from a checkpoint
            torch.set_rng_state(torch.from_numpy(self["torch"]))

    def differs_from(self, later: GlobalRandomness) -> list[str]:
        """Names of the modules whose generator has another state later."""
        return [name for name in later if pickle.dumps(self[name]) != pickle.dumps(later[name])]

    def __missing__(self, name: str) -> Any:
        torch = sys.modules[name]  # imported since; its generator began so
        return torch.Generator().manual_seed(torch.initial_seed()).get_state().numpy()
