"""Chains and schemas that are still possible in a room.

Chains that failed are removed. A schema is possible while every path of it has a chain left and all
solutions found are among its paths; a chain is as likely as the schemas that it completes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from openlock_learners.theory.chains import Chains, chains_of
from openlock_learners.theory.schemas import Schemas, schemas_of


@dataclass(eq=False)
class RoomHypotheses:
    """A subject's hypotheses about its current room, and its attempt there."""

    length: int  # levers in a chain
    solutions: int
    grey: IntArray  # [P] 1 where the lever is grey
    considered: BoolArray  # [C] chains that there can be
    allowed: BoolArray  # [C] those that were not removed
    found: list[int] = field(default_factory=list)  # solutions, as chains
    done: list[int] = field(default_factory=list)  # actions of the attempt that stand in the chain
    chain: list[int] = field(default_factory=list)  # settled on for the attempt (CogSci 2019)
    likely: FloatArray | None = None  # [C] probability of the chains, until something changes
    schemas: IntArray | None = None  # those that are still possible
    structured: bool = False  # whether any is

    @property
    def chains(self) -> Chains:
        """All chains of the room."""
        return chains_of(len(self.grey), self.length)

    @property
    def every_schema(self) -> Schemas | None:
        """All schemas of the room; None if there are too many to list."""
        return schemas_of(len(self.grey), self.length, self.solutions)

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

    def end_attempt(self, opened: bool, new: bool) -> None:
        """Take note of whether the attempt opened the door, and with a new solution."""
        whole = np.flatnonzero(self.chains.beginning_with(self.done))
        if new and len(self.done) == self.length and len(whole):
            self.found.append(int(whole[0]))
        elif opened:  # it opens the door, and counts no more
            self.remove(self.done)
        self.done, self.chain, self.likely = [], [], None

    def likelihood(self, structural: bool) -> FloatArray:
        """``[C, G]`` probability of each chain under each abstract schema that is possible.

        What failed and what was found is taken into account. Where schemas are not believed in
        (``structural``), or none is possible, there is a single column.
        """
        left = self._left()
        if not left.any():  # the room does not always obey, or is of another kind than believed
            self.schemas = None
            self.allowed = self.considered
            left = self._left()
        versions, schemas = self._versions(left), self.every_schema
        worth, self.structured = versions[:, None], False
        if structural and schemas:
            which, of_each, abstract = self.schemas, schemas.paths, schemas.abstract
            if which is None:
                which = np.arange(len(abstract))
            else:
                of_each, abstract = of_each[:, which], abstract[which]
            forms = self._forms(of_each, versions)
            if not (left_over := forms > 0).all():
                which, of_each = which[left_over], of_each[:, left_over]
                forms, abstract = forms[left_over], abstract[left_over]
            self.schemas = which
            self.structured = len(forms) > 0
            if self.structured:
                kinds = len(schemas.distance)
                many = np.bincount(abstract, forms, kinds)
                forms /= many[abstract]
                size = len(versions) * kinds
                both = (np.bincount(paths * kinds + abstract, forms, size) for paths in of_each)
                worth = np.add.reduce([*both]).reshape(-1, kinds)
        by_path: FloatArray = worth / np.maximum(versions, 1)[:, None]
        likely: FloatArray = left[:, None] * by_path[self.chains.path]
        return likely

    def edges(self, schemas: Schemas, belief: FloatArray) -> FloatArray | None:
        """``[P, P + 1]`` probabilities of edges, by a belief ``[G]`` in the abstract schemas.

        A lever of a path enables the next one, and its last the door. None if no schema can be.
        """
        likely = self._forms(schemas.paths, self._versions(self._left()))
        many = np.bincount(schemas.abstract, likely, len(schemas.distance))
        likely *= (belief / np.where(many > 0, many, 1.0))[schemas.abstract]
        if not likely.any():  # the room is of another kind than can be believed in
            return None
        possible, positions = np.flatnonzero(likely), len(self.grey)
        paths = self.chains.paths
        steps = np.hstack([paths, np.full((len(paths), 1), positions)])
        has = np.zeros((len(possible), positions, positions + 1), dtype=bool)
        for own in schemas.paths[:, possible]:
            for cause, effect in pairwise(steps[own].T):
                has[np.arange(len(possible)), cause, effect] = True
        edges: FloatArray = np.tensordot(likely[possible] / likely.sum(), has, axes=1)
        return edges

    def _left(self) -> BoolArray:
        """``[C]`` chains that may be solutions still to be found."""
        path = self.chains.path
        left: BoolArray = self.allowed & ~np.isin(path, path[self.found])
        return left

    def _versions(self, left: BoolArray) -> FloatArray:
        """``[S]`` how many chains each path may have; one, if it is a solution found."""
        chains = self.chains
        versions = np.bincount(chains.path[left], minlength=len(chains.paths)).astype(float)
        versions[chains.path[self.found]] = 1.0
        return versions

    def _forms(self, of_each: IntArray, versions: FloatArray) -> FloatArray:
        """``[M]`` how many sets of chains each schema ``[N, M]`` has that hold what was found."""
        forms: FloatArray = math.prod(versions[paths] for paths in of_each)
        for one in self.chains.path[self.found]:
            forms *= (of_each == one).any(axis=0)
        return forms
