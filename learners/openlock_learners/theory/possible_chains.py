"""Chains and schemas that are still possible in a room.

A schema is possible while every path of it has a chain left and all solutions found are among its
paths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from openlock_learners.theory.chains import Schemas, chains_of, schemas_of


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
        if not self.lost and not self._left().any():
            self.allowed = np.ones_like(self.allowed)

    @property
    def structured(self) -> bool:
        """Whether any schema holds all solutions found, and nothing that failed."""
        return self.schemas is not None and bool(self._forms(self.schemas).any())

    def likelihood(self, belief: FloatArray | None) -> FloatArray:
        """``[C]`` how likely each chain is, by a belief ``[G]`` in the abstract schemas.

        None stands for no belief in schemas: all chains that are left are equally likely.
        """
        left, versions = self._left(), self._versions()
        if belief is None:
            return left.astype(float)
        by_path = np.zeros(len(versions))
        paths, probability = self._instances(belief)
        for of_each in paths:
            by_path += np.bincount(of_each, probability, len(versions))
        likely: FloatArray = left * (by_path / np.maximum(versions, 1))[self.chains.path]
        return likely

    def edges(self, belief: FloatArray) -> FloatArray:
        """``[P, P + 1]`` probabilities of edges, by a belief ``[G]`` in the abstract schemas."""
        paths, probability = self._instances(belief)
        positions, levers = len(self.grey), self.chains.paths
        steps = np.hstack([levers, np.full((len(levers), 1), positions)])
        has = np.zeros((len(probability), positions, positions + 1), dtype=bool)
        for of_each in paths:
            for cause, effect in pairwise(steps[of_each].T):
                has[np.arange(len(has)), cause, effect] = True
        edges: FloatArray = np.tensordot(probability / probability.sum(), has, axes=1)
        return edges

    def _instances(self, belief: FloatArray) -> tuple[IntArray, FloatArray]:
        """``[N, M]`` paths of the schemas that are possible, and ``[M]`` their probabilities."""
        assert self.schemas is not None
        forms = self._forms(self.schemas)
        possible = forms > 0
        forms, abstract = forms[possible], self.schemas.abstract[possible]
        share = forms / np.bincount(abstract, forms)[abstract]
        return self.schemas.paths[:, possible], share * belief[abstract]

    def _forms(self, schemas: Schemas) -> FloatArray:
        """``[M]`` how many sets of chains each schema has that hold what was found."""
        versions = self._versions()
        forms: FloatArray = math.prod(versions[paths] for paths in schemas.paths)
        for solution in self.chains.path[self.found]:
            forms *= (schemas.paths == solution).any(axis=0)
        return forms

    def _left(self) -> BoolArray:
        """``[C]`` chains that may be solutions still to be found."""
        path = self.chains.path
        left: BoolArray = self.allowed & ~np.isin(path, path[self.found])
        return left

    def _versions(self) -> FloatArray:
        """``[S]`` how many chains each path may have; one, if it is a solution found."""
        path = self.chains.path
        versions = np.bincount(path[self._left()], minlength=len(self.chains.paths)).astype(float)
        versions[path[self.found]] = 1.0
        return versions
