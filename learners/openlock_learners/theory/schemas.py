"""Causal schemas, from the most general to those of one room.

* An *atomic* schema is one of the three ways in which two causal relations can meet: common cause
  (Y <- X -> Z), chain (X -> Y -> Z) and common effect (X -> Z <- Y).
* An *abstract* schema says how the N solutions of a room share their levers, whichever these are:
  both begin with the same lever, both end with the same one, they have none in common, and so on.
* An *instantiated* schema is a set of N paths of the room; it has the abstract schema that is left
  when its levers lose their names.

The distance of an abstract schema from an atomic one is the least number of nodes and edges that
have to be added or taken away (graph edit distance) to make one of the other, in the graph of the
levers alone: the door, which all schemas have, is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, pairwise, permutations

import numpy as np

from causal_openlock.schemas.fsm import FloatArray, IntArray
from openlock_learners.theory.chains import chains_of

ATOMIC = ("common cause", "chain", "common effect")
ATOMIC_NODES, ATOMIC_EDGES = 3, 2
"""Nodes and edges of every structure in :data:`ATOMIC`."""
SCHEMA_LIMIT = 30_000
"""The most instantiated schemas that are listed."""


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
    """``[3]`` how far the structure of some solutions is from each atomic schema.

    With N nodes and M edges in the atomic schema, and n and m in the structure, of which k
    edges can be laid upon each other, the distance is ``|n - N| + (M - k) + (m - k)``.

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
