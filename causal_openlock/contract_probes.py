"""What contract tests handle a learner with: marked copies, and watched generators.

:mod:`causal_openlock.testing` plays learners with views that cannot be written to, with rows that
mean nothing, and under an eye on the generators that everything in a process shares.
"""

from __future__ import annotations

import pickle
import random
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray


def arrays(given: Any) -> Iterator[NDArray[Any]]:
    """All arrays in a view or a step."""
    for field in fields(given):
        value = getattr(given, field.name)
        if isinstance(value, np.ndarray):
            yield value
        else:
            yield from arrays(value)


def read_only(given: Any) -> Any:
    """A copy of a view or a step that cannot be written to."""
    copied = pickle.loads(pickle.dumps(given))
    for array in arrays(copied):
        array.flags.writeable = False
    return copied


def without(given: Any, gone: NDArray[Any], garble: bool) -> Any:
    """A view or a step in which some subjects have finished.

    Args:
        given: The view or step as it was.
        gone: ``[B]`` which subjects have finished.
        garble: Whether their rows hold nonsense, which a careless learner would learn from.
    """
    changed = {}
    for field in fields(given):
        value = getattr(given, field.name)
        if not isinstance(value, np.ndarray):
            changed[field.name] = without(value, gone, garble)
            continue
        value = value.copy()
        if field.name == "playing":
            value[gone] = False
        elif field.name in ("attempt_over", "trial_over", "new_solution"):
            value[gone] = garble
        elif garble:
            value[gone] = 1 - value[gone] if value.ndim == 2 else 1 + value[gone]
        changed[field.name] = value
    return replace(given, **changed)


@dataclass(frozen=True)
class GlobalRandomness:
    """The state of the generators that everything in a process shares."""

    states: dict[str, Any]

    @classmethod
    def now(cls) -> GlobalRandomness:
        """Where they stand; torch's counts once torch is imported."""
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
        np.random.seed(seed)  # noqa: NPY002
        if torch := sys.modules.get("torch"):
            torch.manual_seed(seed)

    def restore(self) -> None:
        """Put them back to where they stood."""
        random.setstate(self.states["random"])
        np.random.set_state(self.states["numpy.random"])  # noqa: NPY002
        if "torch" in self.states:
            torch = sys.modules["torch"]
            torch.random.set_rng_state(torch.from_numpy(self.states["torch"]))

    def differs_from(self, other: GlobalRandomness) -> list[str]:
        """Names of the generators that do not stand where they stood."""
        return [
            name
            for name, state in self.states.items()
            if pickle.dumps(state) != pickle.dumps(other.states[name])
        ]
