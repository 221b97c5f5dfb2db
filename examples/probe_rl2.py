"""A linear probe: what of a room's structure can be read off the memory of ``rl2``?

In rooms of two schemas, a logistic regression from the memory of its network to the edges of the
true graph is fitted, and in rooms of two other schemas it reads the memory, as each room is left
(Alain & Bengio 2017). Printed are the mean errors of what is read of each of these:

* ``memory``: the states of two levers, or of one and the door, and of the room.
* ``untrained``: the same of random weights, told what the trained ones did: what the history says.
* ``seen``: which levers are grey, and nothing else.

With two schemas a probe may do no more than tell two classes apart, and that something can be read
says not that the network uses it (Belinkov 2022).
"""

from dataclasses import replace

import numpy as np
import pandas as pd
from sklearn.base import clone
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import causal_openlock as ol
from causal_openlock.analysis.topics.structure_recovery import structure_distance
from causal_openlock.contract.learner import Structure
from openlock_learners.networks.recurrent_policy import make_policy

FITTED, READ, SUBJECTS, LEVERS = ["CC3", "CE3"], ["CC4", "CE4"], 10, 7
PAIRS = ~np.eye(LEVERS, dtype=bool)
REGRESSION = make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))
PROTOCOL = replace(ol.PROTOCOLS["human"], name="probe", layouts="random")


def rooms_left(condition: str) -> list[tuple[ol.Room, dict]]:
    """Each room that a subject has left, and what there is to read then."""
    session = ol.Session(ol.find_condition(condition), PROTOCOL, SUBJECTS)
    trained, untrained = ol.create("rl2"), ol.create("rl2")
    session.begin(trained)
    session.begin(untrained)
    sizes = trained.network.sizes
    untrained.network = make_policy(sizes, np.random.default_rng(0))
    left = []
    while not session.over:
        view, truth = session.view, session.truth
        untrained.probabilities(view)  # what it perceives passes through its network
        step = session.step(trained.act(view))
        trained.learn(step)
        untrained.learn(step)
        for row in np.flatnonzero(step.trial_over & view.playing):
            states = {"seen": (view.observation[row, LEVERS : 2 * LEVERS, None], [])}
            for name, learner in (("memory", trained), ("untrained", untrained)):
                levers, room = np.split(learner.hidden_state[row], [LEVERS * sizes.lever])
                states[name] = levers.reshape(LEVERS, sizes.lever), room
            left.append((truth.rooms[truth.room[row]], states))
    return left


def true_edges(room: ol.Room) -> np.ndarray:
    """``[7, 8]`` whether one position enables another; the door is last."""
    places = dict(zip(room.schema.levers, room.layout.places, strict=True)) | {"door": LEVERS}
    edges = np.zeros((LEVERS, LEVERS + 1))
    for cause, effect in room.schema.graph.edges:
        edges[places[cause], places[effect]] = 1.0
    return edges


def features(levers: np.ndarray, room: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What is said of each pair of different levers, and of each lever and the door."""
    whole = np.tile(room, (LEVERS, 1))
    cause, effect = np.nonzero(PAIRS)
    return np.hstack([levers[cause], levers[effect], whole[cause]]), np.hstack([levers, whole])


fitted, read = ([room for name in names for room in rooms_left(name)] for names in (FITTED, READ))
edges = np.array([true_edges(room) for room, _ in fitted])
rows = []
for name in ("memory", "untrained", "seen"):
    said = [features(*states[name]) for _, states in fitted]
    pairs, doors = (np.concatenate(part) for part in zip(*said, strict=True))
    of_pair = clone(REGRESSION).fit(pairs, edges[:, :, :-1][:, PAIRS].ravel())
    of_door = clone(REGRESSION).fit(doors, edges[:, :, -1].ravel())
    for room, states in read:
        pairs, doors = features(*states[name])
        believed = np.zeros((LEVERS, LEVERS + 1))
        believed[:, :-1][PAIRS] = of_pair.predict_proba(pairs)[:, 1]
        believed[:, -1] = of_door.predict_proba(doors)[:, 1]
        structure = Structure(believed, np.full(LEVERS + 1, np.nan))
        rows.append({"probe": name, **structure_distance(structure, room.schema, room.layout)})
print(pd.DataFrame(rows).groupby("probe", sort=False)[["shd", "f1", "brier"]].mean().round(2))
