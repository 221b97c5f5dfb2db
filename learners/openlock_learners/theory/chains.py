"""Causal chains: every way to move levers one after another before the door.

A chain is what one attempt may do: an action on one lever, an action on another, ..., the push of
the door. Which levers it goes through is its *path*; a path of n levers has 2^n chains, as each
lever is pushed or pulled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import permutations, product

import numpy as np

from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import BoolArray, IntArray

CHAIN_LIMIT = 100_000
"""The most chains that are listed."""


def number_of_chains(positions: int, length: int) -> int:
    """Number of chains through ``length`` of a room's levers.

    >>> number_of_chains(7, 2)  # 42 paths
    168
    """
    return math.perm(positions, length) << length


@dataclass(frozen=True, eq=False)
class Chains:
    """All chains through ``length`` different levers of a room.

    Attributes:
        paths: ``[S, length]`` the levers of each path.
        actions: ``[C, length]`` the actions of each chain, without the door.
        path: ``[C]`` the path of each chain.
    """

    paths: IntArray
    actions: IntArray
    path: IntArray

    def beginning_with(self, actions: list[int]) -> BoolArray:
        """``[C]`` which chains begin with these actions."""
        same: BoolArray = (self.actions[:, : len(actions)] == actions[: self.paths.shape[1]]).all(
            axis=1
        )
        return same


@lru_cache(maxsize=8)
def chains_of(positions: int, length: int) -> Chains:
    """The chains of a room.

    Raises:
        LearnerError: If they are too many to be listed.
    """
    if number_of_chains(positions, length) > CHAIN_LIMIT:
        raise LearnerError(
            f"the theory-based model lists every chain of {length} levers, more than "
            f"{CHAIN_LIMIT:,} in a room of {positions} positions; leave this learner or this "
            "schema out"
        )
    paths = np.array([*permutations(range(positions), length)], dtype=np.int64)
    verbs = np.array([*product((0, positions), repeat=length)], dtype=np.int64)
    actions = (paths[:, None] + verbs).reshape(-1, length)
    return Chains(paths, actions, np.repeat(np.arange(len(paths)), len(verbs)))
