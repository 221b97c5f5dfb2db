"""Structure recovery, apart from solving: what a subject takes the structure of a room to be.

A subject can find every solution without knowing why it works, and can know the structure and be
unlucky. So what a subject believes about the room that it has just left is compared with the schema
of that room, edge by edge. Learners that have such beliefs return them
(:meth:`~causal_openlock.contract.learner.Learner.structure`); for that, the record is played again.
People are asked (``causal-openlock play --ask-structure``), and their answers are with the record
(:mod:`causal_openlock.experiment.beside_record`). People tick or do not, and are not asked about
gates; compare people and learners by ``shd`` and ``f1``. ``ideal`` is given the schema, so it has
only to find out which lever is which.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import VISIT, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.traces import installed
from causal_openlock.analysis.statistics import mean_intervals, sizes
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic, drawn
from causal_openlock.contract.checks import failures_of
from causal_openlock.contract.learner import Learner, Structure
from causal_openlock.contract.registry import create, parse_parameters
from causal_openlock.errors import NothingToDrawError, OpenLockError
from causal_openlock.experiment.beside_record import read_answers
from causal_openlock.experiment.condition import SHOWN, Condition
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.plan import phases_of
from causal_openlock.experiment.record import PHASES
from causal_openlock.experiment.session import AT_ONCE, Session
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.wording import joined
from causal_openlock.world.rewards import PAPER_REWARD
from causal_openlock.world.room import Layout, positions_for

COLUMNS = (
    *("learner", "condition", "protocol", "subject", "visit", "schema"),
    *("shd", "f1", "brier", "gate_brier"),
)
LIKELY = 0.5  #: an edge that is more probable is taken to be in the graph
ASKED = 10  #: subjects of a learner in a condition that a report lets play again
MOST = 100_000  #: records of more attempts than this are not played again


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
    nodes, places = [*schema.levers, DOOR], [*layout.places, layout.positions]
    true = nx.to_numpy_array(schema.graph, nodes, dtype=bool, weight=None)[:-1]
    probability = believed.edges[np.ix_(places[:-1], places)]
    possible = ~np.eye(len(true), len(nodes), dtype=bool)
    said = (probability > LIKELY) & possible
    extra, missing = said & ~true, true & ~said
    turned = extra[:, :-1] & missing[:, :-1].T  # the other way round: one fault and not two
    gates = []
    for node, chance in zip(nodes, believed.gates[places], strict=True):
        causes = len(schema.causes(node))
        if causes > 1 and np.isfinite(chance):
            gates.append((chance - (schema.threshold(node) == causes)) ** 2)
    return {
        "shd": int(extra.sum() + missing.sum() - turned.sum()),
        "f1": 2 * int((said & true).sum()) / max(int(said.sum() + true.sum()), 1),
        "brier": float(((probability - true)[possible] ** 2).mean()),
        "gate_brier": float(np.mean(gates)) if gates else float("nan"),
    }


def structure_recovery(results: Material, subjects: int | None = None) -> pd.DataFrame:
    """How well subjects recovered each room when they left it.

    Learners that hold beliefs about structure and are installed as they were play again; those
    that then do something else than what is on record are left out. It takes as long as it took to
    play.

    >>> import causal_openlock as ol
    >>> table = ol.compare("CC3", ["ideal", "random"], subjects=2, workers=1).structure_recovery
    >>> table.groupby("learner")[["shd", "f1", "brier"]].mean().values.tolist()
    [[0.0, 1.0, 0.0]]

    What people said is in the folders of results. Of each learner and condition the first
    ``subjects`` play again, by default all.

    Returns:
        A row for each trial of each subject: ``learner``, ``condition``, ``protocol``, ``subject``,
        ``visit`` (number of the trial in the whole condition, from 1), ``schema``, and what
        :func:`structure_distance` gives. A solved room of the paper leaves these learners next to
        nothing to doubt.

    Raises:
        StoreError: If a file of answers is damaged.
        LearnerError: If a learner fails, or does not return a structure.
    """
    rows = []
    for folder in results.folders:
        answers = read_answers(folder).to_pandas()
        for _, pairs in answers.groupby(["learner", "condition", "subject", "visit"]):
            rows += _answered(results, pairs)
    for spec in results.experiment.learners:
        if not _can_say(spec):
            continue
        for condition in results.experiment.conditions:
            own = _own(results, spec, condition, subjects)
            numbers = own["subject"].unique()
            for first in range(0, len(numbers), AT_ONCE):
                some = own["subject"].isin(numbers[first : first + AT_ONCE])
                rows += _again(own[some], spec, condition)
    table = pd.DataFrame(rows, columns=COLUMNS)
    return table.sort_values(list(COLUMNS[:5]), kind="stable", ignore_index=True)


def recovered(table: pd.DataFrame) -> pd.DataFrame:
    """Means over ``subjects`` of :func:`structure_recovery`, by learner, condition and visit.

    ``ci_low`` and ``ci_high`` are the 95% interval of ``shd``.
    """
    by = ["learner", "condition", "protocol", "visit"]
    grouped = table.groupby(by, observed=True)
    means = grouped[["shd", "f1", "brier"]].mean().assign(subjects=grouped.size()).reset_index()
    return means.merge(mean_intervals(table, by, "shd"), on=by)


def _can_say(spec: LearnerSpec) -> bool:
    """Whether a learner, as installed here, has its parameters and says what it believes."""
    kind = installed(spec)
    with suppress(OpenLockError):
        parse_parameters(spec.learner, spec.parameters)
        return issubclass(kind, Learner) and kind.structure is not Learner.structure
    return False


def _own(
    results: Material, spec: LearnerSpec, condition: Condition, most: int | None
) -> pd.DataFrame:
    """The attempts of a learner in a condition, in the order of time."""
    from pyarrow.compute import field

    here = (field("learner") == spec.name) & (field("condition") == condition.name)
    columns = ["seed", "subject", *VISIT, "attempt", "actions"]
    table = results.record.filter(here).select(columns).to_pandas()
    table["phase"] = pd.Categorical(table["phase"], PHASES)
    table = table.sort_values(["subject", *VISIT, "attempt"], kind="stable")
    return table[table["subject"].isin(table["subject"].unique()[:most])]


def _again(own: pd.DataFrame, spec: LearnerSpec, condition: Condition) -> Iterator[dict[str, Any]]:
    """Let some subjects play again, and ask each when it leaves a room."""
    seed, numbers = own["seed"].iloc[0], own["subject"].unique().tolist()
    reward = PAPER_REWARD if spec.reward.is_own else spec.reward
    session = Session(
        condition, spec.protocol, numbers, seed=int(seed), reward=reward, learner=spec.name
    )
    about = {"learner": spec.name, "condition": condition.name, "protocol": spec.protocol.name}
    found = []
    with failures_of(spec.name):
        learner = create(spec.learner, spec.parameters)
        session.begin(learner)
        now = session.truth
        for step in session.steps(learner):
            left = step.trial_over & step.view.playing & (step.view.trial > session.shown_trials)
            for row in np.flatnonzero(left).tolist():
                believed = learner.structure(row)
                if believed is None:
                    continue
                room = now.rooms[now.room[row]]
                visit = {"subject": numbers[row], "visit": int(step.view.trial[row])}
                errors = structure_distance(believed, room.schema, room.layout)
                found.append({**about, **visit, "schema": room.schema.name, **errors})
            now = session.truth
    then, today = (
        {number: [*map(list, rows)] for number, rows in table.groupby("subject")["actions"]}
        for table in (own, session.record().to_pandas())
    )
    return (row for row in found if then[row["subject"]] == today[row["subject"]])


def _answered(results: Material, pairs: pd.DataFrame) -> list[dict[str, Any]]:
    """A person's answer on a room, compared with the room; nothing if it is not on record."""
    about = pairs[["learner", "condition", "subject", "visit"]].iloc[0].to_dict()
    condition = next(o for o in results.experiment.conditions if o.name == about["condition"])
    protocol = next(o.protocol for o in results.experiment.learners if o.name == about["learner"])
    trials = results.trials.astype({"learner": str, "condition": str})
    own = trials.merge(pairs[["learner", "condition", "subject"]].head(1)).sort_values(VISIT)
    trial = about["visit"] - phases_of(condition, protocol).count(SHOWN)
    if not 1 <= trial <= len(own):
        return []
    row = own.iloc[trial - 1]
    schema = next(one for one in condition.schemas if one.name == row["schema"])
    positions = max(map(positions_for, condition.schemas))
    edges = np.zeros((positions, positions + 1))
    inside = pairs[(pairs["cause"] < positions) & (pairs["effect"] <= positions)]
    edges[inside["cause"], inside["effect"]] = inside["enables"]
    believed = Structure(edges, np.full(positions + 1, np.nan))
    errors = structure_distance(believed, schema, Layout.of(schema, row["layout"], positions))
    return [{**about, "protocol": row["protocol"], "schema": schema.name, **errors}]


def plot_structure_recovery(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    subjects: int | None = ASKED,
    ax: Any = None,
) -> Any:
    """How many edges of each room's graph subjects had wrong when they left it, trial by trial.

    That is the structural Hamming distance between what they take the structure to be and the
    schema (:func:`~causal_openlock.analysis.topics.structure_recovery.structure_recovery`); 0 is
    perfect. A panel for each condition, a line for each learner; with at most four learners a band
    is the 95% interval over subjects. Learners play again what is on record, which takes
    as long as it took then, so that of each condition the first ``subjects`` do; None stands for
    all.

    >>> import causal_openlock as ol
    >>> bayes = ol.compare("CC3", ["bayes", "ideal"], subjects=2, workers=1)
    >>> [line.get_label() for line in plot_structure_recovery(bayes).lines]
    ['bayes', 'ideal']

    The other arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    asked = results.once(_asked) if subjects == ASKED else structure_recovery(results, subjects)
    table = rows_of(results, recovered(asked), learners, conditions)
    if table.empty:
        raise NothingToDrawError("nobody said what they take the structure of a room to be")
    names = ordered(table["learner"].unique(), results.learners)
    top = max(1.0, 1.04 * float(table[["shd", "ci_high"]].max(axis=None)))
    looks = {name: style.current().line(number, name) for number, name in enumerate(names)}
    shown = ordered(table["condition"].unique(), results.conditions)
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.0)) as at:
        for axes, condition in zip(at.axes, shown, strict=True):
            here = table[table["condition"] == condition]
            for name, look in looks.items():
                own = here[here["learner"] == name]
                axes.plot(own["visit"], own["shd"], marker="o", ms=3, label=name, **look)
                if len(names) <= style.MOST_BANDS:
                    ends = own["ci_low"], own["ci_high"]
                    axes.fill_between(own["visit"], *ends, color=look["color"], alpha=0.15, lw=0)
            style.panel_title(axes, condition, sizes(here))
            axes.set(xlabel="Trial", ylim=(-0.1, top))
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        at.label_y("Edges wrong")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name]) for name in names]
        at.legend(keys, columns=min(len(names), 4))
    return at.returned


def _asked(results: Material) -> pd.DataFrame:
    return structure_recovery(results, ASKED)


def section(material: Material) -> Section | None:
    """Edges that subjects had wrong; None where nobody says what they take the structure to be."""
    if not 0 < material.record.num_rows <= MOST:
        return None
    asked = material.once(_asked)
    if asked.empty:
        return None
    rows = _first_and_last(recovered(asked))
    learners = joined(list(dict.fromkeys(rows["learner"])))
    text = (
        f"A subject can solve a room without knowing why. What {learners} took the structure of "
        "each room to be when they left it is compared with the room’s schema, edge by edge. "
        f"Learners play again what is on record, {ASKED} subjects of a condition at most; of "
        "people it is what they answered."
    )
    caption = (
        "First and last room: edges of the graph that a subject would have to add, take away or "
        "turn round, on average (structural Hamming distance; an edge counts as believed from one "
        "half), with its 95% interval in the last room. F1, of the edges believed, and Brier, the "
        "mean squared difference of belief and truth, in the last room; of people, who tick or do "
        "not, Brier is the share of wrong edges."
    )
    table = Table("structure_recovery", "Edges that were wrong", rows, caption=caption)
    plot = drawn(
        "structure_recovery", plot_structure_recovery, material,
        "Edges that were wrong, over trials",
        "Structural Hamming distance of what subjects took the structure to be when they left a "
        "room, 0 is perfect: mean of subjects; bands, with at most four learners, are 95% "
        "intervals.",
    )  # fmt: skip
    return Section("structure_recovery", "Structure recovery", (text,), (table,), (plot,))


def _first_and_last(table: pd.DataFrame) -> pd.DataFrame:
    """A row for each learner in a condition: its first room, and its last."""
    by = ["learner", "condition", "protocol"]
    grouped = table.groupby(by, observed=True, sort=False)
    first, last = grouped.head(1).set_index(by), grouped.tail(1).set_index(by)
    names = {"visit": "rooms", "first": "first room", "shd": "last room"}
    names |= {"ci_low": "low", "ci_high": "high", "f1": "F1", "brier": "Brier"}
    rows = last.assign(first=first["shd"])[["subjects", *names]].rename(columns=names).reset_index()
    return rows.drop(columns="protocol") if rows["protocol"].nunique() == 1 else rows


TOPIC = Topic("structure_recovery", 55, section)
