"""How far what a subject takes the structure of a room to be is from the schema, edge by edge."""

from __future__ import annotations

import numpy as np

from causal_openlock.contract.learner import Structure
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.world.room import Layout

LIKELY = 0.5  #: an edge that is more probable is taken to be in the graph


def structure_distance(believed: Structure, schema: Schema, layout: Layout) -> dict[str, float]:
    """Distance of a believed structure from the true one.

    Edges count between the active levers, and from these to the door.

    >>> from causal_openlock import find_schema
    >>> edges = np.zeros((7, 8))
    >>> edges[0, 1] = edges[0, 2] = edges[1, 7] = 1.0  # one edge to the door is missing
    >>> believed = Structure(edges, np.full(8, np.nan))
    >>> found = structure_distance(believed, find_schema("CC3"), Layout((0, 1, 2)))
    >>> {name: round(value, 2) for name, value in found.items()}
    {'shd': 1, 'f1': 0.86, 'brier': 0.11, 'gate_brier': nan}

    Returns:
        Numbers by name:

        - ``shd``: structural Hamming distance, the fewest edges to be added, taken away or turned
          round, where edges more probable than :data:`LIKELY` count as believed.
        - ``f1``: harmonic mean of the shares of believed edges that are true and of true ones that
          are believed; 0 if none is both.
        - ``brier``: mean squared difference of probability and truth over all edges there could be;
          of people, who tick or do not, the share of wrong edges.
        - ``gate_brier``: the same of gates: whether all causes are needed, where the schema has
          several; NaN where it has not, or nothing is believed about them.
    """
    place = {**dict(zip(schema.levers, layout.places, strict=True)), DOOR: layout.positions}
    truth = np.zeros(believed.edges.shape, dtype=bool)
    for cause, effect in schema.graph.edges:
        truth[place[cause], place[effect]] = True
    at = np.array(layout.places)
    counts = np.ix_(at, np.append(at, layout.positions))
    possible = ~np.eye(len(at), len(at) + 1, dtype=bool)
    true, probability = truth[counts], believed.edges[counts]
    said = (probability > LIKELY) & possible
    wrong = said != true
    both = int((said & true).sum())
    gates = []
    for node in (*schema.levers, DOOR):
        several = len(schema.causes(node)) > 1
        if several and np.isfinite(chance := believed.gates[place[node]]):
            needs_all = schema.threshold(node) == len(schema.causes(node))
            gates.append((chance - needs_all) ** 2)
    return {
        "shd": int(wrong.sum()) - _turned(said, true),
        "f1": 2 * both / max(int(said.sum() + true.sum()), 1),
        "brier": float(((probability - true)[possible] ** 2).mean()),
        "gate_brier": float(np.mean(gates)) if gates else float("nan"),
    }


def _turned(said: BoolArray, true: BoolArray) -> int:
    """How many edges are believed the other way round; each is one fault and not two."""
    levers = said.shape[0]
    extra, missing = said & ~true, true & ~said
    return int((extra[:, :levers] & missing[:, :levers].T).sum())
