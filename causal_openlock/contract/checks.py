"""Checks of learners: their failures, their probabilities, and the random numbers of others."""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from causal_openlock.errors import LearnerError, OpenLockError, in_short


@contextmanager
def failures_of(name: str) -> Iterator[None]:
    """A block that calls a learner; what the learner raises becomes a LearnerError that names it.

    Raises:
        LearnerError: If the block raises anything but an error of this package.
    """
    try:
        yield
    except OpenLockError:
        raise
    except Exception as error:
        what = f"{type(error).__name__}: {in_short(error)}".removesuffix(": ")
        raise LearnerError(
            f"the learner {name} failed in the place of a subject: {what}; its contract tests say "
            "more (causal_openlock.testing)"
        ) from error


def are_probabilities(found: Any, actions: int) -> bool:
    """Whether ``found`` holds rows of probabilities of ``actions`` actions.

    >>> are_probabilities(np.full((2, 4), 0.25), 4), are_probabilities(np.ones((2, 4)), 4)
    (True, False)
    """
    if not (isinstance(found, np.ndarray) and found.dtype.kind in "fiu"):
        return False
    if found.ndim != 2 or found.shape[1] != actions:
        return False
    return bool((found >= 0).all() and np.allclose(found.sum(axis=1), 1.0, atol=1e-6))


@dataclass(frozen=True)
class GlobalRandomness:
    """States of the random generators that all code of a process shares, by their modules."""

    states: dict[str, Any]

    @classmethod
    def now(cls) -> GlobalRandomness:
        """The states now; torch's included if torch is imported."""
        states: dict[str, Any] = {
            "random": random.getstate(),
            "numpy.random": np.random.get_state(),  # noqa: NPY002
        }
        if torch := sys.modules.get("torch"):
            states["torch"] = torch.random.get_rng_state().numpy()
        return cls(states)

    @staticmethod
    def seed(seed: int) -> None:
        """Seed all of them."""
        random.seed(seed)
        np.random.seed(seed % 2**32)  # noqa: NPY002
        if torch := sys.modules.get("torch"):
            torch.manual_seed(seed)

    @classmethod
    @contextmanager
    def seeded(cls, seed: int) -> Iterator[GlobalRandomness]:
        """A block that begins with all of them seeded, and after which they are as before.

        Yields:
            The states at the beginning of the block.
        """
        before = cls.now()
        cls.seed(seed)
        try:
            yield cls.now()
        finally:
            before.restore()

    def restore(self) -> None:
        """Put these states in place."""
        random.setstate(self.states["random"])
        np.random.set_state(self.states["numpy.random"])  # noqa: NPY002
        if "torch" in self.states:
            import_module("torch")
        if torch := sys.modules.get("torch"):
            torch.random.set_rng_state(torch.from_numpy(self._of_torch(torch)))

    def differs_from(self, other: GlobalRandomness) -> list[str]:
        """Names of the modules whose generator has another state."""
        states = self.states
        if "torch" in other.states:
            states = {**states, "torch": self._of_torch(sys.modules["torch"])}
        return [
            name
            for name, state in states.items()
            if pickle.dumps(state) != pickle.dumps(other.states[name])
        ]

    def _of_torch(self, torch: Any) -> Any:
        """Torch's state; if torch has been imported since then, the one that it began with."""
        fresh = torch.Generator().manual_seed(torch.initial_seed()).get_state().numpy()
        return self.states.get("torch", fresh)
