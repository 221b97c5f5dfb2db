"""A random generator for each subject.

Every subject has generators of its own, derived from the experiment's seed and the subject's
number, so its data depend neither on the other subjects in its batch nor on the number of workers.
Rooms are drawn from :func:`generators`. A NumPy generator carries the seed that it was made from,
and with the seed of an experiment its rooms can be drawn again; so learners get
:func:`unrelated_generators`, whose seeds are hashes from which no other seed can be computed.
:class:`Streams` draws ahead, so that giving a number to each of B subjects does not take B calls.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import FloatArray


def generators(seed: int, key: str, subjects: Iterable[int]) -> tuple[np.random.Generator, ...]:
    """One generator for each subject; ``key`` says what they are for, another one draws others.

    >>> alone, (_, among) = generators(1, "room", [7]), generators(1, "room", [3, 7])
    >>> alone[0].random() == among.random()
    True
    """
    words = np.frombuffer(hashlib.sha256(key.encode()).digest()[:16], ">u4").tolist()
    seeds = (np.random.SeedSequence(seed, spawn_key=(*words, subject)) for subject in subjects)
    return tuple(np.random.Generator(np.random.PCG64(seed)) for seed in seeds)


def unrelated_generators(
    seed: int, key: str, subjects: Iterable[int]
) -> tuple[np.random.Generator, ...]:
    """Like :func:`generators`, with neither the seed nor the subject's number in them.

    Each is seeded with 256 bits of SHA-256 over seed, key and subject, and so are those spawned
    from it.

    >>> (generator,) = unrelated_generators(1, "learner", [7])
    >>> generator.bit_generator.seed_seq.spawn_key
    ()
    >>> generator.bit_generator.seed_seq.entropy.bit_length() > 200
    True
    """
    # The key comes last, so that no two inputs give the same text.
    digests = (hashlib.sha256(f"{seed} {subject} {key}".encode()).digest() for subject in subjects)
    seeds = (int.from_bytes(digest, "big") for digest in digests)
    return tuple(np.random.Generator(np.random.PCG64(seed)) for seed in seeds)


def pick(odds: FloatArray, draw: float) -> int:
    """An index drawn in proportion to odds, ``[N]``, by a uniform number in [0, 1).

    >>> pick(np.array([1.0, 0.0, 3.0]), 0.9)
    2
    """
    sums = odds.cumsum()
    # Rounding may take the draw to the total.
    return min(int(np.searchsorted(sums, draw * sums[-1], side="right")), len(sums) - 1)


class Streams:
    """Uniform numbers for B subjects at once, each from its own generator.

    The t-th call gives each subject the t-th numbers of its own stream, whatever the others are.

    Args:
        generators: One for each subject.
        width: How many numbers a subject gets at a time; ``None`` gives a single one.
        block: How many calls to draw ahead for.

    Example:
        >>> Streams(generators(seed=1, key="actions", subjects=[0, 1])).integers(6).shape
        (2,)
    """

    def __init__(
        self, generators: Sequence[np.random.Generator], width: int | None = None, block: int = 512
    ) -> None:
        self._generators = tuple(generators)
        self._shape = (block,) if width is None else (block, width)
        self._drawn: FloatArray = np.zeros((0, len(self._generators)))
        self._next = 0

    def uniform(self) -> FloatArray:
        """``[B]`` or ``[B, width]`` numbers in [0, 1)."""
        if self._next == len(self._drawn):
            drawn = np.stack([generator.random(self._shape) for generator in self._generators], 1)
            # The numbers of one call are contiguous.
            self._drawn = np.ascontiguousarray(drawn)
            self._next = 0
        self._next += 1
        numbers: FloatArray = self._drawn[self._next - 1]
        return numbers

    def integers(self, high: int) -> NDArray[np.int64]:
        """``[B]`` or ``[B, width]`` integers in [0, high), uniformly distributed."""
        return (self.uniform() * high).astype(np.int64)
