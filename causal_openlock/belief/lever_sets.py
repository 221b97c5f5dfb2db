"""Families of sets of levers, a bit for each set.

A *family* is a set of subsets of n levers as 2^n bits, 64 to a word: bit ``s`` is 1 if the subset
``s``, itself a bit mask of levers, is a member. A gate is the family of subsets that meet it, "all
of these gates hold" is a bitwise ``and``, and adding a lever to every subset is a shift. Twelve
levers take 64 words.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from causal_openlock.world.fsm import BoolArray

Families = NDArray[np.uint64]
"""``[..., W]`` families of sets of n levers; W is 2^n / 64, and at least one."""

_WORDS = np.dtype("<u8")
_WORD = 6
"""Levers whose sets fit into a word."""
_HOLDING = [sum(1 << bit for bit in range(64) if bit >> lever & 1) for lever in range(_WORD)]
"""For each of these, the bits of the sets that hold it."""
_THRESHOLDS = 16


def family(members: BoolArray) -> Families:
    """``[..., W]`` the family with these members, ``[..., 2^n]``.

    >>> members(family(np.array([False, True, True, False])), 2).tolist()
    [False, True, True, False]
    """
    packed = np.packbits(members, axis=-1, bitorder="little")
    short = [(0, 0)] * (packed.ndim - 1) + [(0, -packed.shape[-1] % 8)]
    return np.pad(packed, short).view(_WORDS)


def members(families: Families, levers: int) -> BoolArray:
    """``[..., 2^n]`` whether each set belongs to each family."""
    packed = np.ascontiguousarray(families).view(np.uint8)
    found = np.unpackbits(packed, axis=-1, count=1 << levers, bitorder="little")
    return found.view(np.bool_)


@cache
def meeting(levers: int) -> Families:
    """``[2^n, 16, W]`` for a set of causes and a threshold, the sets that push enough of them."""
    every = np.arange(1 << levers)
    holding = with_lever(levers)
    table = np.zeros((len(every), _THRESHOLDS, holding.shape[1]), dtype=_WORDS)
    table[0, 0] = family(np.ones(len(every), dtype=bool))
    for lever in range(levers):
        few, more = table[: 1 << lever], table[1 << lever : 2 << lever]
        more[:, 0] = few[:, 0]
        more[:, 1:] = few[:, 1:] | (few[:, :-1] & holding[lever])
    return table


@cache
def with_lever(levers: int) -> Families:
    """``[n, W]`` the sets that hold each lever."""
    return family(np.arange(1 << levers) >> np.arange(levers)[:, None] & 1 == 1)


def raised(families: Families, lever: int) -> Families:
    """``[M, W]`` the sets without a lever, after it is added to them."""
    if lever < _WORD:
        without = families & ~np.uint64(_HOLDING[lever])
        shifted: Families = without << np.uint64(1 << lever)
        return shifted
    result = np.zeros_like(families)
    step = 1 << (lever - _WORD)
    blocks = (len(families), families.shape[1] // (2 * step), 2, step)
    result.reshape(blocks)[:, :, 1] = families.reshape(blocks)[:, :, 0]
    return result


def minimal(families: Families, levers: int) -> Families:
    """``[M, W]`` the sets of each family of which no proper subset belongs to it."""
    above = families.copy()
    for lever in range(levers):
        above |= raised(above, lever)
    larger = np.zeros_like(families)
    for lever in range(levers):
        larger |= raised(above, lever)
    fewest: Families = families & ~larger
    return fewest
