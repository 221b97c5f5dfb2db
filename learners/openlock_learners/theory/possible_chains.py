"""Chains and schemas that are still possible in a room.

A schema is possible while every path of it has a chain left and all solutions found are among its
paths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise

import numpy as np

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from openlock_learners.theory.chains import chains_of, schemas_of


@dataclass(frozen=True, eq=False)
class Possible:
    """What failures and solutions have left of a room's chains and schemas.

    Attributes:
        left: ``[C]`` chains that may be solutions still to be found.
        paths: ``[N, M]`` paths of the schemas that are possible; none if there are too many to
            list.
        abstract: ``[M]`` the abstract schema of each, one of G.
        share: ``[M]`` its probability among those with this abstract schema.
        likely: ``[G, C]`` how likely each chain is, by the abstract schema.
    """

    left: BoolArray
    paths: IntArray
    abstract: IntArray
    share: FloatArray
    likely: FloatArray


@lru_cache(maxsize=1024)  # copies of a subject, and many subjects at first, have the same left
def possible(
    positions: int, length: int, solutions: int, allowed: bytes, found: tuple[int, ...]
) -> Possible:
    """What is possible in a room.

    Args:
        positions: The levers of the room.
        length: Levers in a chain.
        solutions: Solutions of the room.
        allowed: ``[C]`` chains that were not removed, as bytes.
        found: Solutions that were found, as chains.
    """
    chains, schemas = chains_of(positions, length), schemas_of(positions, length, solutions)
    solved = chains.path[[*found]]
    left = np.frombuffer(allowed, dtype=bool) & ~np.isin(chains.path, solved)
    if schemas is None:
        none = np.zeros((solutions, 0), dtype=np.int64)
        return Possible(left, none, none[0], np.zeros(0), np.zeros((0, len(left))))
    # How many chains each path may have; one, if it is a solution found.
    versions = np.bincount(chains.path[left], minlength=len(chains.paths)).astype(float)
    versions[solved] = 1.0
    # How many sets of chains each schema has that hold what was found.
    forms: FloatArray = math.prod(versions[paths] for paths in schemas.paths)
    for solution in solved:
        forms *= (schemas.paths == solution).any(axis=0)
    paths, abstract = schemas.paths[:, forms > 0], schemas.abstract[forms > 0]
    forms = forms[forms > 0]
    share = forms / np.bincount(abstract, forms)[abstract]
    by_path = np.zeros((len(schemas.distance), len(versions)))
    for of_each in paths:
        np.add.at(by_path, (abstract, of_each), share)
    likely = left * (by_path / np.maximum(versions, 1))[:, chains.path]
    return Possible(left, paths, abstract, share, likely)


@dataclass(eq=False)
class RoomHypotheses:
    """A subject's hypotheses about its current room, and its attempt there.

    Attributes:
        length: Levers in a chain.
        solutions: Solutions of the room.
        grey: ``[P]`` 1 where the lever is grey.
        chains: All chains of the room.
        schemas: All schemas of the room; None if there are too many to list.
        allowed: ``[C]`` chains that were not removed.
        found: Solutions that were found, as chains.
        done: Actions of the attempt that stand in the chain.
        likely: ``[C]`` probability of the chains, until something changes.
        over: Whether the trial has ended.
    """

    length: int
    solutions: int
    grey: IntArray
    found: list[int] = field(default_factory=list)
    done: list[int] = field(default_factory=list)
    likely: FloatArray | None = None
    over: bool = False

    def __post_init__(self) -> None:
        self.chains = chains_of(len(self.grey), self.length)
        self.schemas = schemas_of(len(self.grey), self.length, self.solutions)
        self.allowed: BoolArray = np.ones(len(self.chains.actions), dtype=bool)

    @property
    def lost(self) -> bool:
        """Whether no chain is left that begins as the attempt has begun."""
        begun = self.chains.beginning_with(self.done)
        return len(self.done) > 0 and not (begun & self.allowed).any()

    def remove(self, actions: list[int]) -> None:
        """Remove the chains that begin with these actions."""
        gone = self.chains.beginning_with(actions) & self.allowed
        if gone.any():
            self.allowed = self.allowed & ~gone
            self.likely = None
            self._begin_again()

    def end_attempt(self, opened: bool, new: bool) -> None:
        """Take note of whether the attempt opened the door, and with a new solution."""
        whole = np.flatnonzero(self.chains.beginning_with(self.done))
        if new and len(self.done) == self.length and len(whole):
            self.found.append(int(whole[0]))
        elif opened:  # it opens the door, and counts no more
            self.remove(self.done)
        self.done, self.likely = [], None
        self._begin_again()

    def _begin_again(self) -> None:
        """Allow everything if nothing is left: the room does not always obey."""
        if not self.lost and not self._possible().left.any():
            self.allowed = np.ones_like(self.allowed)

    def _possible(self) -> Possible:
        allowed, found = self.allowed.tobytes(), tuple(self.found)
        return possible(len(self.grey), self.length, self.solutions, allowed, found)

    @property
    def structured(self) -> bool:
        """Whether any schema holds all solutions found, and nothing that failed."""
        return len(self._possible().share) > 0

    def likelihood(self, belief: FloatArray | None) -> FloatArray:
        """``[C]`` how likely each chain is, by a belief ``[G]`` in the abstract schemas.

        None stands for no belief in schemas: all chains that are left are equally likely.
        """
        if belief is None:
            return self._possible().left.astype(float)
        likely: FloatArray = belief @ self._possible().likely
        return likely

    def edges(self, belief: FloatArray) -> FloatArray:
        """``[P, P + 1]`` probabilities of edges, by a belief ``[G]`` in the abstract schemas."""
        left = self._possible()
        probability = left.share * belief[left.abstract]
        positions, levers = len(self.grey), self.chains.paths
        steps = np.hstack([levers, np.full((len(levers), 1), positions)])
        has = np.zeros((len(probability), positions, positions + 1), dtype=bool)
        for of_each in left.paths:
            for cause, effect in pairwise(steps[of_each].T):
                has[np.arange(len(has)), cause, effect] = True
        edges: FloatArray = np.tensordot(probability / probability.sum(), has, axes=1)
        return edges
