"""Understanding, apart from solving: what a subject takes the structure of a room to be.

A subject can find every solution without knowing why it works, and can know the structure and be
unlucky. So what a subject believes about the room that it has just left is compared with the schema
of that room, edge by edge. Learners that have such beliefs return them
(:meth:`~causal_openlock.contract.learner.Learner.structure`); for that, the record is played again.
People are asked (``causal-openlock play --ask-structure``), and their answers are beside the record
(:mod:`causal_openlock.experiment.answers`). People tick or do not, and are not asked about gates;
compare people and learners by ``shd`` and ``f1``. ``ideal`` is given the schema, so it has only to
find out which lever is which.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import mean_intervals
from causal_openlock.contract.learner import Learner, Structure
from causal_openlock.contract.probes import failures_of, is_structure
from causal_openlock.contract.registry import create, learner_class
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.answers import Answer, read_answers
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.experiment.protocol import Condition
from causal_openlock.experiment.session import AT_ONCE, Session
from causal_openlock.schemas.fsm import BoolArray, FloatArray
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.storage.stored import recorded_layout
from causal_openlock.world.rewards import PAPER_REWARD
from causal_openlock.world.room import Layout, positions_for

COLUMNS = (
    *("learner", "condition", "protocol", "subject", "visit", "schema"),
    *("shd", "f1", "brier", "gate_brier"),
)
LIKELY = 0.5
"""An edge that is more probable is taken to be in the graph."""
ASKED = 10
"""Subjects of a learner in a condition that a report lets play again."""


def compared(believed: Structure, schema: Schema, layout: Layout) -> dict[str, float]:
    """How near a believed structure comes to the true one.

    Edges count between the active levers, and from these to the door.

    >>> from causal_openlock import find_schema
    >>> edges = np.zeros((7, 8))
    >>> edges[0, 1] = edges[0, 2] = edges[1, 7] = 1.0  # one edge to the door is missing
    >>> believed = Structure(edges, np.full(8, np.nan))
    >>> found = compared(believed, find_schema("CC3"), Layout((0, 1, 2)))
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


def understanding(
    results: Material, answers: Sequence[Answer] | None = None, subjects: int | None = None
) -> pd.DataFrame:
    """How well subjects understood each room when they left it.

    Learners that hold beliefs about structure and are installed as they were play again; those
    that then do something else than what is on record are left out. It takes as long as it took to
    play.

    >>> import causal_openlock as ol
    >>> table = ol.compare("CC3", ["ideal", "random"], subjects=2, workers=1).understanding
    >>> table.groupby("learner")[["shd", "f1", "brier"]].mean().values.tolist()
    [[0.0, 1.0, 0.0]]

    Args:
        results: What was played.
        answers: What people said; by default what is kept in the folders of the results.
        subjects: The most subjects of a learner in a condition; by default all.

    Returns:
        A row for each trial of each subject: ``learner``, ``condition``, ``protocol``, ``subject``,
        ``visit`` (number of the trial in the whole condition, from 1), ``schema``, and what
        :func:`compared` gives. A solved room of the paper leaves these learners next to nothing to
        doubt.

    Raises:
        StoreError: If a file of answers is damaged.
        LearnerError: If a learner fails, or what it returns is no structure.
    """
    if answers is None:
        answers = [one for folder in results.folders for one in read_answers(folder)]
    rows = [row for answer in answers if (row := _answered(results, answer))]
    for spec in results.experiment.learners:
        if not _can_say(spec):
            continue
        for condition in results.experiment.conditions:
            own = _own(results, spec, condition, subjects)
            for first in range(0, own["subject"].nunique(), AT_ONCE):
                numbers = own["subject"].unique()[first : first + AT_ONCE]
                rows += _again(own[own["subject"].isin(numbers)], spec, condition)
    table = pd.DataFrame(rows, columns=COLUMNS)
    return table.sort_values(list(COLUMNS[:5]), kind="stable", ignore_index=True)


def understood(table: pd.DataFrame) -> pd.DataFrame:
    """What that comes to, over subjects.

    Args:
        table: From :func:`understanding`.

    Returns:
        A row for each learner, condition, protocol and ``visit``: how many ``subjects``; the means
        of ``shd``, with its 95% bootstrap interval ``ci_low`` and ``ci_high``, ``f1`` and
        ``brier``.
    """
    by = ["learner", "condition", "protocol", "visit"]
    grouped = table.groupby(by, observed=True)
    means = grouped[["shd", "f1", "brier"]].mean().assign(subjects=grouped.size()).reset_index()
    return means.merge(mean_intervals(table, by, "shd"), on=by)


def _can_say(spec: LearnerSpec) -> bool:
    """Whether a learner is installed and says what it believes; no code of results runs."""
    if ":" in spec.learner:
        return False
    try:
        kind = learner_class(spec.learner)
    except OpenLockError:
        return False
    return issubclass(kind, Learner) and kind.structure is not Learner.structure


def _own(
    results: Material, spec: LearnerSpec, condition: Condition, most: int | None
) -> pd.DataFrame:
    """The attempts of a learner in a condition, in the order of time."""
    import pyarrow.compute as pc

    record = results.record
    here = pc.and_(
        pc.equal(pc.cast(record["learner"], "string"), spec.name),
        pc.equal(pc.cast(record["condition"], "string"), condition.name),
    )
    columns = ["experiment", "seed", "subject", "phase", "loop", "trial", "layout", "attempt"]
    table = record.filter(here).select([*columns, "actions"]).to_pandas()
    table["visit"] = table["phase"].astype(str).map({"train": 0, "test": 1})
    table = table.sort_values(["subject", "visit", "loop", "trial", "attempt"], kind="stable")
    kept = table["subject"].unique()[:most]
    return table[table["subject"].isin(kept)]


def _again(own: pd.DataFrame, spec: LearnerSpec, condition: Condition) -> Iterator[dict[str, Any]]:
    """Let some subjects play again, and ask each when it leaves a room."""
    seed, numbers = own["seed"].iloc[0], own["subject"].unique().tolist()
    reward = PAPER_REWARD if spec.reward.depends_on_everything else spec.reward
    session = Session(
        condition, spec.protocol, numbers, seed=int(seed), reward=reward, learner=spec.name
    )
    found: dict[int, list[dict[str, Any]]] = {row: [] for row in range(len(numbers))}
    with failures_of(spec.name):
        learner = create(spec.learner, spec.parameters)
        session.begin(learner)
        now = session.truth
        for step in session.steps(learner):
            for row in np.flatnonzero(step.trial_over & step.view.playing).tolist():
                room = now.rooms[now.room[row]]
                if (believed := _believed(learner, row, spec.name, room.layout.positions)) is None:
                    continue
                known: dict[str, Any] = {"learner": spec.name, "condition": condition.name}
                known |= {"protocol": spec.protocol.name, "subject": numbers[row]}
                known |= {"visit": int(step.view.trial[row]), "schema": room.schema.name}
                found[row].append({**known, **compared(believed, room.schema, room.layout)})
            now = session.truth
    again = session.record().to_pandas()
    for row, number in enumerate(numbers):
        then, today = (one.loc[one["subject"] == number, "actions"] for one in (own, again))
        if list(map(list, then)) == list(map(list, today)):
            yield from found[row]


def _believed(learner: Learner, row: int, name: str, positions: int) -> Structure | None:
    """What a subject takes the structure to be, if the learner can say."""
    found = learner.structure(row)
    if found is not None and not is_structure(found, positions):
        raise LearnerError(
            f"the structure of {name} is no Structure of probabilities for {positions} positions: "
            f"edges [{positions}, {positions + 1}] and gates [{positions + 1}]; return None where "
            "the learner cannot say"
        )
    return found


def _answered(results: Material, answer: Answer) -> dict[str, Any] | None:
    """What a person said of a room, compared with it."""
    table = results.trials
    own = table[
        (table["learner"].astype(str) == answer.learner)
        & (table["condition"].astype(str) == answer.condition)
        & (table["subject"] == answer.subject)
    ].sort_values(["phase", "loop", "trial"])
    if not 1 <= answer.visit <= len(own):
        return None
    row = own.iloc[answer.visit - 1]
    (condition,) = (o for o in results.experiment.conditions if o.name == answer.condition)
    schema = next(one for one in condition.schemas if one.name == row["schema"])
    layout = recorded_layout(schema, row["layout"], max(map(positions_for, condition.schemas)))
    believed = Structure(_edges(answer, layout.positions), np.full(layout.positions + 1, np.nan))
    return {
        **{name: getattr(answer, name) for name in ("learner", "condition", "subject", "visit")},
        "protocol": row["protocol"],
        "schema": schema.name,
        **compared(believed, schema, layout),
    }


def _edges(answer: Answer, positions: int) -> FloatArray:
    edges = np.zeros((positions, positions + 1))
    for cause, effect in answer.edges:
        if cause < positions and effect <= positions:
            edges[cause, effect] = 1.0
    return edges
