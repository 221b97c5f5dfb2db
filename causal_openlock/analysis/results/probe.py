"""A linear probe: what of a room's structure can be read off the memory of a network?

A network such as that of ``rl2`` does not say what it takes the structure of a room to be. But one
can ask whether it is *there*: in some rooms, a logistic regression from the memory to the edges of
the true graph is fitted, and in other rooms, whose levers are in none of the same places, it reads
the memory (Alain & Bengio 2017). There are two regressions, for all rooms and positions: of whether
one lever enables another, from the states of both and of the room, and of whether a lever acts on
the door, from its state and the room's. Memory is read when a room is left, before its network has
perceived what its very last action led to.

What a probe shows has limits, and the others that are fitted with it are there to show them:

* ``rates`` knows nothing of the room but how often there are edges, and ``seen`` also which levers
  are grey. What these read right says nothing about memory.
* ``untrained`` is the same network with random weights, told what the trained one did. It too
  carries traces of what was done, and so of the room: what it shows as well is in the history, and
  no sign of what was learned.
* A probe finds what can be read off linearly in rooms *like* those that it was fitted in. With two
  schemas it may do no more than tell two classes apart; fit it in rooms of other schemas to ask for
  more. What it does not find may be there in another form.
* That something can be read says not that the network uses it (Belinkov 2022).

So this is an analysis of a network, and no belief that the network states.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
import pandas as pd

from causal_openlock.analysis.results.structure_errors import structure_distance
from causal_openlock.contract.learner import Structure
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.declare import PROTOCOLS, Condition, LearnerSpec
from causal_openlock.experiment.making import ConditionForm, LearnerForm, make_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.fsm import BoolArray, FloatArray
from causal_openlock.schemas.schema import DOOR
from causal_openlock.world.randomness import generators
from causal_openlock.world.room import Room

HELD_OUT = 1 / 3
"""Share of the sets of positions of levers that is read and not fitted to."""
ROOMS = replace(PROTOCOLS["human"], name="probe", layouts="random")


@runtime_checkable
class Remembering(Protocol):
    """A learner whose memory has a state for each lever, and one for the room."""

    def untrain(self, generator: np.random.Generator) -> None:
        """Take random weights."""

    def memory(self) -> tuple[FloatArray, FloatArray]:
        """``[B, P, H]`` states of levers, and ``[B, G]`` of the room."""


@dataclass(frozen=True)
class Left:
    """A room as a subject left it.

    Attributes:
        subject: Number of the subject.
        visit: Number of the trial, from 1.
        room: The room.
        memories: By name, ``[P, H]`` states of levers and ``[G]`` of the room.
    """

    subject: int
    visit: int
    room: Room
    memories: Mapping[str, tuple[FloatArray, FloatArray]]


def rooms_left(spec: LearnerSpec, condition: Condition, subjects: int, seed: int) -> Iterator[Left]:
    """Let a learner play five rooms, and look at its memory when it leaves each.

    Raises:
        LearnerError: If the learner has no memory that can be probed.
    """
    session = Session(condition, ROOMS, subjects, seed=seed, learner="probed")
    made: list[Any] = [create(spec.learner, spec.parameters) for _ in range(2)]
    for one in made:
        if not isinstance(one, Remembering):
            raise LearnerError(f"{spec.name} has no memory that can be probed; rl2 has one")
    for one in made:
        session.begin(one)
    learner, other = made
    (generator,) = generators(seed, "untrained", [0])
    other.untrain(generator)
    while not session.over:
        view, now = session.view, session.truth
        actions = learner.act(view)
        other.probabilities(view)  # what it perceives passes through its network
        step = session.step(actions)
        for one in made:
            one.learn(step)
        left = np.flatnonzero(step.trial_over & view.playing).tolist()
        known = {"memory": learner.memory(), "untrained": other.memory()} if left else {}
        for row in left:
            memories = {name: (levers[row], room[row]) for name, (levers, room) in known.items()}
            grey = view.observation[row, session.brief.positions : 2 * session.brief.positions]
            memories["seen"] = grey[:, None].astype(float), np.zeros(0)
            memories["rates"] = np.zeros((len(grey), 0)), np.zeros(0)
            room = now.rooms[now.room[row]]
            yield Left(row, int(view.trial[row]), room, memories)


class Probe:
    """Two logistic regressions, from memories to edges.

    Args:
        memories: Of some rooms.
        rooms: These rooms.
        strength: How much greater weights cost less; scikit-learn's ``C``.
    """

    def __init__(
        self,
        memories: Sequence[tuple[FloatArray, FloatArray]],
        rooms: Sequence[Room],
        strength: float = 1.0,
    ) -> None:
        edges = np.array([true_edges(room) for room in rooms])
        levers, doors = (
            np.concatenate(part) for part in zip(*map(_features, memories), strict=True)
        )
        apart = _apart(edges.shape[1])
        self._lever = _regression(levers, edges[:, apart].ravel(), strength)
        self._door = _regression(doors, edges[:, :, -1].ravel(), strength)

    def structure(self, memory: tuple[FloatArray, FloatArray]) -> Structure:
        """Probabilities of the edges of a room; of gates nothing is read."""
        levers, doors = _features(memory)
        edges = np.zeros((len(doors), len(doors) + 1))
        edges[_apart(len(doors))] = self._lever(levers)
        edges[:, -1] = self._door(doors)
        return Structure(edges, np.full(len(doors) + 1, np.nan))


def probe_structure(
    learner: LearnerForm,
    fitted: Sequence[ConditionForm],
    read: Sequence[ConditionForm] = (),
    *,
    subjects: int = 20,
    seed: int = 0,
) -> pd.DataFrame:
    """How well edges are read off a learner's memory in rooms that the probe was not fitted in.

    Args:
        learner: As in :func:`~causal_openlock.compare`; it plays all rooms.
        fitted: Conditions; the probe is fitted in their rooms.
        read: Conditions whose rooms are read, such as those of other schemas. By default a third of
            the rooms of ``fitted`` is: all with levers at some sets of positions, where the probe
            is not fitted.
        subjects: How many play each condition, five rooms with levers anywhere.
        seed: Of all randomness.

    Returns:
        A row for each room that was read and each ``probe`` (``memory``, ``untrained``, ``seen``,
        ``rates``): ``schema``, ``subject``, ``visit``, and ``shd``, ``f1`` and ``brier`` of
        :func:`~causal_openlock.analysis.topics.structure_recovery.compared`.

    Raises:
        LearnerError: If the learner has no memory that can be probed.
        OpenLockError: If no room is left to read in.
    """
    built = make_experiment([*fitted, *read], [learner])
    (spec,) = built.learners
    own, others = (
        [one for condition in part for one in rooms_left(spec, condition, subjects, seed)]
        for part in (built.conditions[: len(fitted)], built.conditions[len(fitted) :])
    )
    if not read:
        sets = sorted({frozenset(one.room.layout.places) for one in own}, key=sorted)
        (generator,) = generators(seed, "probe", [0])
        out = {sets[i] for i in generator.permutation(len(sets))[: round(HELD_OUT * len(sets))]}
        others = [one for one in own if frozenset(one.room.layout.places) in out]
        own = [one for one in own if frozenset(one.room.layout.places) not in out]
    if not (own and others):
        raise OpenLockError("a probe needs rooms to be fitted in and others to read; play more")
    rows = []
    for name in others[0].memories:
        probe = Probe([one.memories[name] for one in own], [one.room for one in own])
        for one in others:
            found = structure_distance(
                probe.structure(one.memories[name]), one.room.schema, one.room.layout
            )
            known = {"probe": name, "schema": one.room.schema.name}
            rows.append({**known, "subject": one.subject, "visit": one.visit, **found})
    return pd.DataFrame(rows).drop(columns="gate_brier")


def true_edges(room: Room) -> FloatArray:
    """``[P, P + 1]`` the edges of a room between positions; the door is last."""
    schema, layout = room.schema, room.layout
    place = {**dict(zip(schema.levers, layout.places, strict=True)), DOOR: layout.positions}
    edges = np.zeros((layout.positions, layout.positions + 1))
    for cause, effect in schema.graph.edges:
        edges[place[cause], place[effect]] = 1.0
    return edges


def _apart(positions: int) -> BoolArray:
    """``[P, P + 1]`` the pairs of different levers."""
    pairs = ~np.eye(positions, positions + 1, dtype=bool)
    pairs[:, -1] = False
    return pairs


def _features(memory: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """``[P (P - 1), 2H + G]`` of pairs of levers, and ``[P, H + G]`` of levers and the door."""
    levers, room = memory
    one, other = np.nonzero(_apart(len(levers)))
    pairs = np.hstack([levers[one], levers[other], np.tile(room, (len(one), 1))])
    return pairs, np.hstack([levers, np.tile(room, (len(levers), 1))])


def _regression(
    features: FloatArray, present: FloatArray, strength: float
) -> Callable[[FloatArray], FloatArray]:
    """Function from ``[n, F]`` features to the probability that an edge is present, ``[n]``."""
    if features.shape[1] == 0 or len(set(present)) == 1:
        rate = float(present.mean())
        return lambda new: np.full(len(new), rate)
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    made = make_pipeline(StandardScaler(), LogisticRegression(C=strength, max_iter=1000))
    made.fit(features, present)
    return lambda new: made.predict_proba(new)[:, 1]
