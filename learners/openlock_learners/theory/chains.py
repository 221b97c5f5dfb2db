"""All chains and causal schemas of a room, which the theory-based model reasons over.

A *chain* is what one attempt may do: an action on one lever, on another, ..., the push of the door.
Which levers it goes through is its *path*; a path of n levers has 2^n chains, as each lever is
pushed or pulled. Schemas, from the most general to those of one room:

* An *atomic* schema is one of the three ways in which two causal relations can meet: common cause
  (Y <- X -> Z), chain (X -> Y -> Z) and common effect (X -> Z <- Y).
* An *abstract* schema says how the N solutions of a room share their levers, whichever these are:
  both begin with the same lever, both end with the same one, they have none in common, and so on.
* An *instantiated* schema is a set of N paths of the room; it has the abstract schema that is left
  when its levers lose their names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
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
    """All instantiated schemas of a room with N solutions.

    Attributes:
        paths: ``[N, M]`` the paths of each.
        abstract: ``[M]`` its abstract schema, one of G.
        distance: ``[G, 3]`` edit distance of each abstract schema from each of :data:`ATOMIC`.
    """

    paths: IntArray
    abstract: IntArray
    distance: FloatArray


def edit_distances(paths: IntArray) -> FloatArray:
    """``[3]`` graph edit distance of the structure of some solutions from each atomic schema.

    The door, which all schemas have, is left out. With N nodes and M edges in the atomic schema,
    and n and m in the structure, of which k edges can be laid upon each other, the distance is
    ``|n - N| + (M - k) + (m - k)``.

    >>> edit_distances(np.array([[0, 1], [0, 2], [0, 3]]))  # three levers that one lever frees
    array([2., 4., 4.])

    Args:
        paths: ``[N, length]`` the levers of each solution.
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
