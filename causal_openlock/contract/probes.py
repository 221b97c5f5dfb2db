"""Checks of the contract of learners.

:mod:`causal_openlock.testing` plays learners with read-only views and with meaningless rows of
finished subjects, and compares the states of global random generators.
:mod:`causal_openlock.running.learner_check` does some of that before a comparison.
"""

from __future__ import annotations

import pickle
import random
import sys
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Learner, Structure
from causal_openlock.errors import LearnerError, OpenLockError, in_short


class InputChangedError(Exception):
    """A learner changed its input."""


def watch(learner: Learner) -> None:
    """Give a learner read-only copies of its input from now on.

    NumPy refuses to write to them. Other libraries may write all the same, and a learner may keep
    an array for later, so the last copies are compared with the originals after every call. ``act``
    and ``learn`` raise :class:`InputChangedError` if something has changed.
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
                    raise InputChangedError(f"{fault} ({error})") from error
                raise
            for now, before in kept:
                for (name, one), (_, other) in zip(_arrays(now), _arrays(before), strict=True):
                    if not np.array_equal(one, other):
                        raise InputChangedError(f"{fault} ({name})")
            return answer

        return call

    for name in ("act", "learn"):
        # A frozen dataclass allows it in this way alone.
        object.__setattr__(learner, name, watched(getattr(learner, name)))


def _arrays(given: Any) -> Iterator[tuple[str, NDArray[Any]]]:
    """All arrays in a view or a step, with their names."""
    for field in fields(given):
        value = getattr(given, field.name)
        if isinstance(value, np.ndarray):
            yield field.name, value
        else:
            yield from _arrays(value)


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


def is_structure(found: Any, positions: int) -> bool:
    """Whether ``found`` is a structure over ``positions`` positions.

    >>> from causal_openlock.contract.learner import Structure
    >>> is_structure(Structure(np.zeros((2, 3)), np.full(3, np.nan)), 2), is_structure("a -> b", 2)
    (True, False)
    """
    if not isinstance(found, Structure):
        return False
    shapes = {"edges": (positions, positions + 1), "gates": (positions + 1,)}
    for name, shape in shapes.items():
        values = getattr(found, name)
        if not (isinstance(values, np.ndarray) and values.shape == shape):
            return False
        if values.dtype.kind not in "fiub":
            return False
        known = values[~np.isnan(values)] if name == "gates" else values
        if not ((known >= -1e-6) & (known <= 1 + 1e-6)).all():
            return False
    return True


def with_finished(given: Any, gone: NDArray[Any], garble: bool) -> Any:
    """A view or a step in which some subjects have finished.

    Args:
        given: The view or step.
        gone: ``[B]`` which subjects have finished.
        garble: Whether to fill their rows with nonsense, from which a learner must not learn.
    """
    changed = {}
    for field in fields(given):
        value = getattr(given, field.name)
        if not isinstance(value, np.ndarray):
            changed[field.name] = with_finished(value, gone, garble)
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
    """The state of the global random generators of Python, NumPy and torch."""

    states: dict[str, Any]

    @classmethod
    def now(cls) -> GlobalRandomness:
        """States of the global generators now; torch's included if torch is imported."""
        states: dict[str, Any] = {
            "random": random.getstate(),
            "numpy.random": np.random.get_state(),  # noqa: NPY002
        }
        if torch := sys.modules.get("torch"):
            states["torch"] = torch.random.get_rng_state().numpy()
        return cls(states)

    @staticmethod
    def seed(seed: int) -> None:
        """Seed all global generators."""
        random.seed(seed)
        np.random.seed(seed)  # noqa: NPY002
        if torch := sys.modules.get("torch"):
            torch.manual_seed(seed)

    def restore(self) -> None:
        """Restore these states."""
        random.setstate(self.states["random"])
        np.random.set_state(self.states["numpy.random"])  # noqa: NPY002
        if torch := sys.modules.get("torch"):
            # If torch was imported since then, its generator was in its initial state.
            held = self.states.get("torch")
            fresh = torch.Generator().get_state() if held is None else torch.from_numpy(held)
            torch.random.set_rng_state(fresh)

    def differs_from(self, other: GlobalRandomness) -> list[str]:
        """Names of the generators with a different state."""
        return [
            name
            for name, state in self.states.items()
            if pickle.dumps(state) != pickle.dumps(other.states[name])
        ]
