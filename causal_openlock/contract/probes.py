"""How to see whether a learner keeps its contract.

:mod:`causal_openlock.testing` plays learners with views that cannot be written to, with rows that
mean nothing, and under an eye on the generators that everything in a process shares.
:mod:`causal_openlock.experiment.learner_check` does some of that before a comparison.
"""

from __future__ import annotations

import pickle
import random
import sys
from collections import deque
from collections.abc import Callable, Iterator
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Learner


class WrittenTo(Exception):  # noqa: N818 - it says what a learner did
    """A learner changed what it was shown."""


def watch(learner: Learner) -> None:
    """From now on, show a learner copies that cannot be written to.

    NumPy refuses to write to them. Other libraries ignore that, and a learner may keep an array for
    later, so the last copies are compared with what they were after every call. ``act`` and
    ``learn`` raise :class:`WrittenTo` if something has changed.
    """
    kept: deque[tuple[Any, Any]] = deque(maxlen=6)

    def watched(method: Callable[[Any], Any]) -> Callable[[Any], Any]:
        fault = f"{method.__name__} changes an array that it is given"

        def call(given: Any) -> Any:
            copied = deepcopy(given)
            for _, array in _arrays(copied):
                array.flags.writeable = False
            kept.append((copied, deepcopy(given)))
            try:
                answer = method(copied)
            except ValueError as error:
                # Compiled code may ask for a writable buffer only to read it.
                if "read-only" in str(error) and "buffer source" not in str(error):
                    raise WrittenTo(f"{fault} ({error})") from error
                raise
            for now, before in kept:
                for (name, one), (_, other) in zip(_arrays(now), _arrays(before), strict=True):
                    if not np.array_equal(one, other):
                        raise WrittenTo(f"{fault} ({name})")
            return answer

        return call

    for name in ("act", "learn"):
        setattr(learner, name, watched(getattr(learner, name)))


def _arrays(given: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """All arrays in a view or a step, with their names."""
    for field in fields(given):
        value = getattr(given, field.name)
        if isinstance(value, np.ndarray):
            yield field.name, value
        else:
            yield from _arrays(value)


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
        """Their states now; torch's counts once torch is imported."""
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
        """Put these states back."""
        random.setstate(self.states["random"])
        np.random.set_state(self.states["numpy.random"])  # noqa: NPY002
        if torch := sys.modules.get("torch"):
            # One that was imported since then had the state of every new generator.
            held = self.states.get("torch")
            fresh = torch.Generator().get_state() if held is None else torch.from_numpy(held)
            torch.random.set_rng_state(fresh)

    def differs_from(self, other: GlobalRandomness) -> list[str]:
        """Names of the generators whose state has changed."""
        return [
            name
            for name, state in self.states.items()
            if pickle.dumps(state) != pickle.dumps(other.states[name])
        ]
