"""All chains and causal schemas of a room, which the theory-based model reasons over.

A *chain* is what one attempt may do: an action on one lever, on another, ..., the push of the door.
Which levers it goes through is its *path*; a path of n levers has 2^n chains, as each lever is
pushed or pulled. Schemas, from the most general to those of one room:

* An *atomic* schema is one of the three ways in which two causal relations can meet: common cause
  (Y <- X -> Z), chain (X -> Y -> Z) and common effect (X -> Z <- Y).
* An *abstract* schema says how the N solutions of a room share their levers, whichever these are:
  both begin with the same lever, both end with the same one, they have none in common, and so on.
* An *instantiated* schema is a set of N paths of the room; it has the abstract schema that is left
  when its levers lose their names. It is possible while all its paths have a chain left and all
  solutions found are among its paths.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import combinations, pairwise, permutations, product

import numpy as np

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

CHAIN_LIMIT = 100_000
"""The most chains that are listed."""
SCHEMA_LIMIT = 30_000
"""The most instantiated schemas that are listed."""
ATOMIC = ("common cause", "chain", "common effect")
ATOMIC_NODES, ATOMIC_EDGES = 3, 2


@dataclass(frozen=True, eq=False)
class Chains:
    """All chains through ``length`` different levers of a room."""

    paths: IntArray  #: ``[S, length]`` the levers of each path
    actions: IntArray  #: ``[C, length]`` the actions of each chain, without the door
    path: IntArray  #: ``[C]`` the path of each chain

    def beginning_with(self, actions: list[int]) -> BoolArray:
        """``[C]`` which chains begin with these actions."""
        begun = self.actions[:, : len(actions)]
        same: BoolArray = (begun == actions[: begun.shape[1]]).all(axis=1)
        return same


@lru_cache(maxsize=8)
def chains_of(positions: int, length: int) -> Chains:
    """The chains of a room."""
    paths = np.array([*permutations(range(positions), length)], dtype=np.int64)
    verbs = np.array([*product((0, positions), repeat=length)], dtype=np.int64)
    actions = (paths[:, None] + verbs).reshape(-1, length)
    return Chains(paths, actions, np.repeat(np.arange(len(paths)), len(verbs)))


@dataclass(frozen=True, eq=False)
class Schemas:
    """All instantiated schemas of a room with N solutions."""

    paths: IntArray  #: ``[N, M]`` the paths of each
    abstract: IntArray  #: ``[M]`` its abstract schema, one of G
    distance: FloatArray  #: ``[G, 3]`` edit distance of each abstract schema from the atomic ones


def edit_distances(paths: IntArray) -> FloatArray:
    """``[3]`` edit distance of the graph of some paths, ``[N, length]``, from each atomic schema.

    The door, which all schemas have, is left out. With N nodes and M edges in the atomic schema,
    and n and m in the structure, of which k edges can be laid upon each other, the distance is
    ``|n - N| + (M - k) + (m - k)``.

    >>> edit_distances(np.array([[0, 1], [0, 2], [0, 3]]))  # three levers that one lever frees
    array([2., 4., 4.])
    """
    edges = {edge for path in paths.tolist() for edge in pairwise(path)}
    nodes = set(np.unique(paths).tolist())
    # Two edges are an atomic schema if they leave one lever, are a chain, or enter one lever.
    fits = [False, False, False]
    for (a, b), (c, d) in permutations(edges, 2):
        fits[0] |= a == c
        fits[1] |= b == c and a != d
        fits[2] |= b == d
    common = np.array([min(len(edges), 1) + fit for fit in fits])
    return abs(len(nodes) - ATOMIC_NODES) + ATOMIC_EDGES + len(edges) - 2.0 * common


@lru_cache(maxsize=8)
def schemas_of(positions: int, length: int, solutions: int) -> Schemas | None:
    """The schemas of a room; None if there are too many to list, or no solution."""
    paths = chains_of(positions, length).paths
    if not solutions or math.comb(len(paths), solutions) > SCHEMA_LIMIT:
        return None
    chosen = np.array([*combinations(range(len(paths)), solutions)], dtype=np.int64)
    codes = []
    for order in permutations(range(solutions)):
        levers = paths[chosen[:, order]].reshape(len(chosen), -1)
        # Where each lever was first named: the same for schemas that differ in names alone.
        first = (levers[:, :, None] == levers[:, None]).argmax(axis=2)
        codes.append(first @ (levers.shape[1] ** np.arange(levers.shape[1])))
    _, example, abstract = np.unique(np.min(codes, axis=0), return_index=True, return_inverse=True)
    distance = np.array([edit_distances(paths[chosen[one]]) for one in example])
    return Schemas(np.ascontiguousarray(chosen.T), abstract, distance)


@dataclass(frozen=True, eq=False)
class Possible:
    """What failures and solutions have left of a room's chains and schemas."""

    left: BoolArray  #: ``[C]`` chains that may be solutions still to be found
    paths: IntArray  #: ``[N, M]`` paths of the possible schemas; none if there are too many to list
    abstract: IntArray  #: ``[M]`` the abstract schema of each, one of G
    share: FloatArray  #: ``[M]`` its probability among those with this abstract schema
    likely: FloatArray  #: ``[G, C]`` how likely each chain is, by the abstract schema


@lru_cache(maxsize=128)  # shared by copies of a subject, and by subjects in their first attempts
def possible_of(
    positions: int, length: int, solutions: int, allowed: bytes, found: tuple[int, ...]
) -> Possible:
    """What is possible in a room after some solutions were ``found``, as chains.

    ``allowed`` are, as bytes, ``[C]`` whether each chain was not removed.
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
    """A subject's hypotheses about its current room, and its attempt there."""

    length: int  #: levers in a chain
    solutions: int  #: solutions of the room
    grey: IntArray  #: ``[P]`` 1 where the lever is grey
    found: list[int] = field(default_factory=list)  #: solutions that were found, as chains
    done: list[int] = field(default_factory=list)  #: actions of the attempt that stand in the chain
    likely: FloatArray | None = None  #: ``[C]`` probability of the chains, until something changes
    over: bool = False  #: whether the trial has ended

    def __post_init__(self) -> None:
        self.chains = chains_of(len(self.grey), self.length)  #: all chains of the room
        #: all schemas of the room; None if there are too many to list
        self.schemas = schemas_of(len(self.grey), self.length, self.solutions)
        #: ``[C]`` chains that were not removed
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
        if not self.lost and not self.possible.left.any():
            self.allowed = np.ones_like(self.allowed)

    @property
    def possible(self) -> Possible:
        """What is possible now."""
        allowed, found = self.allowed.tobytes(), tuple(self.found)
        return possible_of(len(self.grey), self.length, self.solutions, allowed, found)

    def edges(self, belief: FloatArray) -> FloatArray:
        """``[P, P + 1]`` probabilities of edges, by a belief ``[G]`` in the abstract schemas."""
        left = self.possible
        probability = left.share * belief[left.abstract]
        positions, levers = len(self.grey), self.chains.paths
        steps = np.hstack([levers, np.full((len(levers), 1), positions)])
        has = np.zeros((len(probability), positions, positions + 1), dtype=bool)
        for of_each in left.paths:
            for cause, effect in pairwise(steps[of_each].T):
                has[np.arange(len(has)), cause, effect] = True
        edges: FloatArray = np.tensordot(probability / probability.sum(), has, axes=1)
        return edges
