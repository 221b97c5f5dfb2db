"""Arrange the figure of a schema: nodes, edges and labels.

Causes stand above their effects: a lever's row is the length of the longest path to it, and the
door has the last row for itself. An edge that skips rows runs through a free slot in each of them;
edges from one lever through the same row share their slot. Slots and levers are ordered so that
few edges cross, then shifted sideways until edges are as upright as the order allows. Rows move
apart until every edge keeps clear of every node that it does not belong to.

Lengths are in units of which a lever's circle has 0.72 in diameter.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from causal_openlock.schemas.schema import DOOR, Schema

Points = NDArray[np.float64]
Slot = tuple[str, int]  # the lever an edge comes from, and the row that it passes
Place = str | Slot
Paths = dict[tuple[str, str], list[Place]]

RADIUS = 0.36
GAP = 0.34  # free space between neighbours in a row
CLEARANCE = 0.10  # between an edge and a node that it does not belong to
LABEL = np.array([0.24, 0.10])  # half the size of a strength written at an edge
PIECE = 24  # points in each piece of an edge


@dataclass
class Arrangement:
    """Positions of everything in the figure of a schema.

    Attributes:
        centre: ``[2]`` centre of each node, y up, and of each slot.
        half_width: Half the width of each node; levers with long names are wider than high.
        edges: ``[N, 2]`` points along each edge, from the border of the cause to the tip.
        labels: Centre of each strength that is written at an edge.
        limits: Left, right, bottom and top.
    """

    centre: dict[Place, Points]
    half_width: dict[str, float]
    edges: dict[tuple[str, str], Points] = field(default_factory=dict)
    labels: dict[tuple[str, str], Points] = field(default_factory=dict)
    limits: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0)


def arrange(schema: Schema) -> Arrangement:
    """Find a place for every node, edge and label of a schema."""
    graph = schema.graph
    row = {
        node: index
        for index, generation in enumerate(nx.topological_generations(graph))
        for node in generation
    }
    row[DOOR] = max(row[lever] for lever in schema.levers) + 1
    paths: Paths = {
        (cause, effect): [
            cause,
            *((cause, passed) for passed in range(row[cause] + 1, row[effect])),
            effect,
        ]
        for cause, effect in graph.edges
    }
    links = sorted({pair for path in paths.values() for pair in pairwise(path)}, key=str)
    rows: list[list[Place]] = [[] for _ in range(row[DOOR] + 1)]
    for node in [*schema.levers, DOOR]:
        rows[row[node]].append(node)
    for slot in sorted({place for path in paths.values() for place in path[1:-1]}, key=str):
        rows[int(slot[1])].append(slot)
    rows = _with_few_crossings(rows, links)

    half = {lever: max(RADIUS, 0.09 * len(lever) + 0.09) for lever in schema.levers}
    half[DOOR] = RADIUS
    x = _upright(rows, links, half)
    widest = max(abs(x[cause] - x[effect]) for cause, effect in links)
    height = max(1.25 if schema.deterministic else 1.6, 0.35 * widest)
    while True:
        y = {place: -height * index for index, places in enumerate(rows) for place in places}
        centre = {place: np.array([x[place], y[place]]) for place in x}
        drawing = Arrangement(centre, half)
        if _route(drawing, paths) or height > 12.0:
            break
        height *= 1.15
    _place_labels(schema, drawing, paths)
    outer = [centre[node] + [side * half[node], 0.0] for node in half for side in (-1, 1)]
    outer += [label + side * LABEL for label in drawing.labels.values() for side in (-1, 1)]
    everything = np.vstack([*outer, *drawing.edges.values()])
    (left, bottom), (right, top) = everything.min(axis=0), everything.max(axis=0)
    top, bottom = max(top, RADIUS), min(bottom, centre[DOOR][1] - RADIUS)
    drawing.limits = (left - 0.12, right + 0.12, bottom - 0.12, top + 0.12)
    return drawing


def _with_few_crossings(
    rows: list[list[Place]], links: Sequence[tuple[Place, Place]]
) -> list[list[Place]]:
    """Order each row by the mean place of its neighbours, in sweeps, and keep the best order."""
    above: dict[Any, list[Any]] = {place: [] for places in rows for place in places}
    below: dict[Any, list[Any]] = {place: [] for place in above}
    for cause, effect in links:
        above[effect].append(cause)
        below[cause].append(effect)

    def crossings(order: list[list[Place]]) -> int:
        index = {place: i for places in order for i, place in enumerate(places)}
        count = 0
        for places in order[:-1]:
            ends = [i for place in places for i in sorted(index[effect] for effect in below[place])]
            count += sum(a > b for i, a in enumerate(ends) for b in ends[i + 1 :])
        return count

    best, fewest = rows, crossings(rows)
    order = [list(places) for places in rows]
    for sweep in range(12):
        down = sweep % 2 == 0
        neighbours = above if down else below
        for level in range(len(order)) if down else reversed(range(len(order))):
            index = {place: i for places in order for i, place in enumerate(places)}
            order[level].sort(
                key=lambda place: float(
                    np.mean([index[near] for near in neighbours[place]] or [index[place]])
                )
            )
        if (count := crossings(order)) < fewest:
            best, fewest = [list(places) for places in order], count
    return best


def _upright(
    rows: list[list[Place]],
    links: Sequence[tuple[Place, Place]],
    half: dict[str, float],
) -> dict[Place, float]:
    """Horizontal places that keep the order and bring everything close to its neighbours."""
    near: dict[Any, list[tuple[Any, float]]] = {place: [] for places in rows for place in places}
    for cause, effect in links:
        # The bends of a long edge count more than those of a short one.
        weight = 1.0 + 2.0 * isinstance(cause, tuple) + 2.0 * isinstance(effect, tuple)
        near[cause].append((effect, weight))
        near[effect].append((cause, weight))
    offsets = []
    for places in rows:
        widths = [half[place] if isinstance(place, str) else 0.0 for place in places]
        steps = [a + b + GAP for a, b in pairwise(widths)]
        offsets.append(np.cumsum([0.0, *steps]))
    x = {
        place: float(at - offset[-1] / 2)
        for places, offset in zip(rows, offsets, strict=True)
        for place, at in zip(places, offset, strict=True)
    }
    for _ in range(60):
        for places, offset in zip(rows, offsets, strict=True):
            wish, weights = [], []
            for place in places:
                pull = near[place] or [(place, 1.0)]
                weights.append(sum(weight for _, weight in pull))
                wish.append(sum(x[to] * weight for to, weight in pull) / weights[-1])
            # The nearest places in the same order, at least their least distances apart.
            rising = isotonic_regression(np.array(wish) - offset, weights=np.array(weights)).x
            x |= dict(zip(places, (rising + offset).tolist(), strict=True))
    return x


# -- edges ----------------------------------------------------------------------------------------


def _route(drawing: Arrangement, paths: Paths) -> bool:
    """Draw every edge as straight as possible; return whether all edges keep clear of nodes."""
    clear = True
    for edge, path in paths.items():
        for steepest in (60.0, 45.0, 30.0, 15.0, 0.0):
            points = _curve(drawing, path, math.radians(steepest))
            drawing.edges[edge] = points
            if all(
                node in edge or distance_to_node(drawing, node, points) > CLEARANCE
                for node in drawing.half_width
            ):
                break
        else:
            clear = False
    return clear


def distance_to_node(drawing: Arrangement, node: str, points: Points) -> float:
    """The least distance from points to the border of a node; negative inside it."""
    away = np.abs(points - drawing.centre[node])
    away[:, 0] = np.maximum(away[:, 0] - (drawing.half_width[node] - RADIUS), 0.0)
    if node == DOOR:
        return float(away.max(axis=1).min()) - RADIUS
    return float(np.hypot(*away.T).min()) - RADIUS


def _curve(drawing: Arrangement, path: Sequence[Place], steepest: float) -> Points:
    """A smooth line through the places of a path, at most so steep to the vertical at its ends."""
    at = [drawing.centre[place] for place in path]

    def lean(start: Points, end: Points) -> float:
        return float(np.clip(math.atan2(end[0] - start[0], start[1] - end[1]), -steepest, steepest))

    leans = [lean(at[0], at[1])]
    leans += [lean(before, after) for before, after in zip(at, at[2:], strict=False)]
    leans.append(lean(at[-2], at[-1]))
    ways = [np.array([math.sin(angle), -math.cos(angle)]) for angle in leans]
    at[0] = at[0] + _to_border(drawing, path[0], ways[0])
    at[-1] = at[-1] - _to_border(drawing, path[-1], ways[-1], tip=0.04)
    if len(at) == 2 and abs(leans[0]) < steepest:
        ways = [(at[1] - at[0]) / np.hypot(*(at[1] - at[0]))] * 2
    t = np.linspace(0.0, 1.0, PIECE)[:, None]
    pieces = []
    for i in range(len(at) - 1):
        reach = np.hypot(*(at[i + 1] - at[i])) * 0.4
        b, c = at[i] + ways[i] * reach, at[i + 1] - ways[i + 1] * reach
        s = 1 - t
        pieces.append(s**3 * at[i] + 3 * s * s * t * b + 3 * s * t * t * c + t**3 * at[i + 1])
    return np.concatenate([pieces[0], *(piece[1:] for piece in pieces[1:])])


def _to_border(drawing: Arrangement, place: Place, way: Points, tip: float = 0.0) -> Points:
    """Vector from the centre of a place to its border, in a direction that points down or up."""
    if isinstance(place, tuple):
        return np.zeros(2)
    if place == DOOR:
        # All arrows end on the upper side, the more aslant the nearer to a corner.
        return np.array([0.8 * RADIUS * way[0], way[1] / abs(way[1]) * RADIUS]) + tip * way
    # From inside a circle pulled apart by `flat` to each side: out through its straight part or
    # through one of its rounded ends.
    flat = drawing.half_width[place] - RADIUS
    if flat >= RADIUS * abs(way[0] / way[1]):
        length = RADIUS / abs(way[1])
    else:
        length = flat * abs(way[0]) + math.sqrt(RADIUS**2 - (flat * way[1]) ** 2)
    return np.asarray(way * (length + tip))


def _place_labels(schema: Schema, drawing: Arrangement, paths: Paths) -> None:
    """Put each strength where it covers least: no node, no other label, few other edges."""
    used = Counter(link for path in paths.values() for link in pairwise(path))
    for edge, points in drawing.edges.items():
        if schema.graph.edges[edge]["strength"] == 1.0:
            continue
        # A label is clear only where no other edge runs along.
        pieces = [i for i, link in enumerate(pairwise(paths[edge])) if used[link] == 1]
        candidates = [
            points[i * (PIECE - 1) + at] for i in pieces for at in (11, 9, 13, 7, 15, 5, 17)
        ]
        others = [line for other, line in drawing.edges.items() if other != edge]
        costs = [_covered(drawing, at, others) for at in candidates]
        drawing.labels[edge] = candidates[int(np.argmin(costs))]


def _covered(drawing: Arrangement, at: Points, others: Sequence[Points]) -> float:
    """Cost of writing a strength here."""
    labels = sum((np.abs(at - label) < 2 * LABEL).all() for label in drawing.labels.values())
    corners = at + np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], [0, 0]]) * LABEL
    nodes = sum(distance_to_node(drawing, node, corners) < 0.02 for node in drawing.half_width)
    lines = sum((np.abs(line - at) < LABEL).all(axis=1).sum() for line in others)
    return float(100 * labels + 100 * nodes + lines)
