"""Checks of learners: their failures, their probabilities, and the random numbers of others."""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any, NamedTuple

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
    return (
        isinstance(found, np.ndarray)
        and found.dtype.kind in "fiu"
        and found.shape[1:] == (actions,)
        and bool((found >= 0).all() and np.allclose(found.sum(axis=1), 1.0, atol=1e-6))
    )


class _Generator(NamedTuple):
    """A random generator that all code of a process shares."""

    state: Callable[[], Any]
    put: Callable[[Any], None]
    seed: Callable[[int], Any]


def _generators() -> dict[str, _Generator]:
    """The generators of Python, NumPy and, if it is imported, torch, by their modules."""
    legacy: Any = np.random
    shared = {
        "random": _Generator(random.getstate, random.setstate, random.seed),
        "numpy.random": _Generator(
            legacy.get_state, legacy.set_state, lambda seed: legacy.seed(seed % 2**32)
        ),
    }
    if torch := sys.modules.get("torch"):
        shared["torch"] = _Generator(
            lambda: torch.random.get_rng_state().numpy(),
            lambda state: torch.random.set_rng_state(torch.from_numpy(state)),
            torch.manual_seed,
        )
    return shared


class GlobalRandomness(dict[str, Any]):
    """States of the random generators that all code of a process shares, by their modules."""

    @classmethod
    def now(cls) -> GlobalRandomness:
        """The states now; torch's included if torch is imported."""
        return cls({name: one.state() for name, one in _generators().items()})

    @classmethod
    @contextmanager
    def seeded(cls, seed: int) -> Iterator[GlobalRandomness]:
        """A block that begins with all of them seeded, and after which they are as before.

        Yields:
            The states at the beginning of the block.
        """
        before = cls.now()
        for generator in _generators().values():
            generator.seed(seed)
        try:
            yield cls.now()
        finally:
            before.restore()

    def restore(self) -> None:
        """Put these states in place."""
        for name, state in self._since().items():
            import_module(name)  # torch, in a process that continues from a checkpoint
            _generators()[name].put(state)

    def differs_from(self, other: GlobalRandomness) -> list[str]:
        """Names of the modules whose generator has another state."""
        states = self._since()
        return [name for name in states if pickle.dumps(states[name]) != pickle.dumps(other[name])]

    def _since(self) -> dict[str, Any]:
        """These states; if torch has been imported since, also the one that it began with."""
        torch = sys.modules.get("torch")
        if torch is None or "torch" in self:
            return self
        fresh = torch.Generator().manual_seed(torch.initial_seed()).get_state().numpy()
        return {**self, "torch": fresh}
