"""Global random generators of one's own, for a library that draws from the global ones.

Some libraries draw from the global generators of Python, NumPy and torch, and seed them. A learner
that wraps one lets it run with generators of its own in their place: what it draws depends on
nobody else, and everyone else finds theirs as they were.
"""

from __future__ import annotations

import random
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np

_global: Any = np.random
"""NumPy's module of global random functions; type stubs lack those that replace the generator."""


class _State(NamedTuple):
    python: tuple[Any, ...]
    torch: Any
    numpy: Any
    ahead: dict[str, Any] | None
    """NumPy's whole state, if it has drawn a normal number ahead; these come in pairs."""

    @classmethod
    def now(cls) -> _State:
        import torch

        numpy = _global.get_state(legacy=False)
        return cls(
            random.getstate(),
            torch.random.get_rng_state(),
            _global.get_bit_generator(),
            numpy if numpy["has_gauss"] else None,
        )

    def put(self) -> None:
        """Put these in place.

        NumPy's generator itself is exchanged: writing its state takes as long as all the rest.
        """
        import torch

        random.setstate(self.python)
        torch.random.set_rng_state(self.torch)
        _global.set_bit_generator(self.numpy)
        if self.ahead:
            _global.set_state(self.ahead)


class OwnRandomness:
    """Global generators as some library left them.

    They begin as ``random.seed``, ``numpy.random.seed`` and ``torch.manual_seed`` would set them.

    Example:
        >>> one, other = OwnRandomness(7), OwnRandomness(7)
        >>> with one.in_place():
        ...     first = np.random.random(2)
        >>> drawn_by_somebody_else = np.random.random(3)
        >>> with one.in_place():
        ...     second = np.random.random(2)
        >>> with other.in_place():
        ...     bool((np.random.random(4) == [*first, *second]).all())
        True
    """

    def __init__(self, seed: int) -> None:
        import torch

        numpy = np.random.MT19937()
        numpy.state = _global.RandomState(seed).get_state(legacy=False)
        torch_state = torch.Generator().manual_seed(seed).get_state()
        self._state = _State(random.Random(seed).getstate(), torch_state, numpy, None)

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """A block in which these are the global generators."""
        outside = _State.now()
        self._state.put()
        try:
            yield
        finally:
            self._state = _State.now()
            outside.put()
