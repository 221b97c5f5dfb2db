"""Hypothesis strategies: any schema, layout, protocol, learner or experiment that is valid.

A test that holds for whatever these draw holds for schemas and settings that no author thought of,
and Hypothesis finds the smallest one for which it fails. All are small enough to be played:

>>> from hypothesis import find
>>> find(schemas(max_levers=2), lambda schema: len(schema.solutions) == 2).as_dict()["edges"]
{'L0': ['door'], 'L1': ['door']}
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

import networkx as nx
from hypothesis import assume
from hypothesis import strategies as st

from causal_openlock.contract.registry import learner_class, registry
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.building import learner, make_experiment
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file_format import LearnerFile
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.world.rewards import PRESETS
from causal_openlock.world.room import Layout, positions_for

MOST = 32
"""Most that a whole number or a number without an upper bound is above its lower one."""

CERTAIN = st.just(1.0)
UNCERTAIN = CERTAIN | st.floats(0.05, 1.0, allow_subnormal=False)
"""Strengths of edges."""


@cache  # Hypothesis validates a strategy when it is first drawn from
def gates(causes: int) -> st.SearchStrategy[Gate]:
    """A gate that can hold with this number of causes."""
    counts = st.integers(1, causes).map(lambda k: Gate("at_least", k))
    return st.sampled_from([Gate(), Gate("all")]) | counts


@st.composite
def schemas(
    draw: st.DrawFn,
    max_levers: int = 7,
    stochastic: bool = False,
    titles: st.SearchStrategy[str] | None = None,
    name: str = "drawn",
) -> Schema:
    """Any valid schema: a random DAG with gates and, where it has to be, inert levers.

    Args:
        draw: Given by Hypothesis.
        max_levers: The most levers it may have, at most 12.
        stochastic: Whether edges may have strengths below 1.
        titles: What to draw its title from; by default it has none.
        name: Its name.
    """
    count = draw(st.integers(1, max_levers), label="levers")
    levers = [f"L{index}" for index in range(count)]
    # Causes come first in this order, which is not the order of the levers.
    order = draw(st.permutations(levers), label="causal order")
    pairs = [(cause, effect) for i, cause in enumerate(order) for effect in order[i + 1 :]]
    pairs += [(lever, DOOR) for lever in order]
    # As often sparse as dense, which a coin for each pair would not be.
    some = draw(st.permutations(pairs), label="pairs")[: draw(st.integers(0, len(pairs)))]
    graph = nx.DiGraph(some)
    graph.add_nodes_from([*levers, DOOR])
    if not graph.in_degree(DOOR):
        graph.add_edge(draw(st.sampled_from(levers), label="cause of the door"), DOOR)
    if draw(st.booleans(), label="no inert levers"):
        ends = [lever for lever in levers if graph.out_degree(lever) == 0]
        graph.add_edges_from((lever, DOOR) for lever in ends)
    useful = nx.ancestors(graph, DOOR)
    strengths = UNCERTAIN if stochastic else CERTAIN
    return Schema(
        name,
        levers,
        {
            cause: {effect: draw(strengths) for effect in graph.successors(cause)}
            for cause in levers
        },
        gates={
            node: draw(gates(causes), label=f"gate of {node}")
            for node, causes in graph.in_degree()
            if causes
        },
        inert=draw(st.permutations([lever for lever in levers if lever not in useful])),
        title=draw(titles) if titles is not None else "",
    )


def layouts(schema: Schema, positions: int | None = None) -> st.SearchStrategy[Layout]:
    """Any layout of a schema's levers.

    Args:
        schema: The schema.
        positions: Of the room; by default as many as the smallest room for it has.
    """
    places = positions_for(schema) if positions is None else positions
    levers = len(schema.levers)
    return st.permutations(range(places)).map(lambda order: Layout(tuple(order[:levers]), places))


def protocols(name: str = "drawn") -> st.SearchStrategy[Protocol]:
    """A protocol of few and short trials, in random layouts.

    Args:
        name: Its name.
    """
    few = st.integers(1, 3)
    return st.builds(
        Protocol,
        st.just(name),
        attempt_limit=st.integers(1, 12),
        stop_when_solved=st.booleans(),
        **dict.fromkeys(("baseline_trials", "training_trials", "test_trials"), few),
        **dict.fromkeys(("baseline_loops", "train_loops", "test_loops"), st.integers(1, 2)),
        layouts=st.just("random"),
    )


@st.composite
def learners(
    draw: st.DrawFn, names: Sequence[str] | None = None, label: str | None = None
) -> LearnerFile:
    """A learner whose hyper-parameters are anywhere within their ranges, or left as they are.

    What it gives is what ``causal_openlock.learner`` does. Hyper-parameters that are texts or
    mappings, such as names of files, are left as they are.

    Args:
        draw: Given by Hypothesis.
        names: Names of learners to draw from; by default all that are installed.
        label: What tables call it.
    """
    name = draw(st.sampled_from(_installed() if names is None else [*names]), label="learner")
    declared = get_type_hints(learner_class(name).Parameters, include_extras=True)
    known = {key: values for key, kind in declared.items() if (values := _values(kind)) is not None}
    chosen = draw(st.fixed_dictionaries({}, optional=known), label="parameters")
    try:
        return learner(name, label=label, **chosen)
    except LearnerError:  # values at odds with each other
        assume(False)
        raise


@cache
def _installed() -> list[str]:
    def is_there(name: str) -> bool:
        try:
            learner_class(name)
        except LearnerError:  # it needs an extra
            return False
        return True

    return [*filter(is_there, registry())]


def _values(kind: Any, limits: Sequence[Any] = ()) -> st.SearchStrategy[Any] | None:
    """Values of a hyper-parameter of a type; None for types of any content."""
    if get_origin(kind) is Annotated:
        inner, *notes = get_args(kind)
        return _values(
            inner, [*limits, *(one for n in notes for one in getattr(n, "metadata", ()))]
        )
    if get_origin(kind) is Literal:
        return st.sampled_from(get_args(kind))
    if kind is bool:
        return st.booleans()
    if kind in (int, float):
        return _numbers(kind, limits)
    arms = (
        [] if isinstance(kind, type) else [arm for arm in get_args(kind) if arm is not type(None)]
    )
    inner = _values(arms[0]) if len(arms) == 1 and len(get_args(kind)) == 2 else None
    return None if inner is None else st.none() | inner


def _numbers(kind: type, limits: Sequence[Any]) -> st.SearchStrategy[Any]:
    def bound(*names: str) -> float | None:
        known = (getattr(limit, name, None) for limit in limits for name in names)
        return next((float(one) for one in known if one is not None), None)

    low, high, excluded = bound("ge", "gt") or 0.0, bound("le", "lt"), (bound("gt"), bound("lt"))
    most = low + MOST if high is None else high
    if kind is int:
        return st.integers(int(low), int(most)).filter(lambda value: value not in excluded)
    floats = st.floats(low, most, allow_subnormal=False)
    return floats.filter(lambda value: value not in excluded)


@st.composite
def experiments(
    draw: st.DrawFn,
    learner: st.SearchStrategy[LearnerFile] | None = None,
    max_levers: int = 4,
    stochastic: bool = False,
) -> Experiment:
    """An experiment of one to three conditions and learners.

    Its conditions are baselines and transfers, its layouts random or given.

    Args:
        draw: Given by Hypothesis.
        learner: What its learners are drawn from; each gets a label of its own. By default
            ``random`` and ``oracle``.
        max_levers: The most levers that its schemas may have.
        stochastic: Whether they may have strengths below 1.
    """
    kinds = learners(("random", "oracle")) if learner is None else learner
    known = [
        draw(schemas(max_levers, stochastic, name=f"drawn{index}"), label="schema")
        for index in range(draw(st.integers(1, 3)))
    ]
    conditions = [
        Condition(
            f"condition{index}",
            tuple(draw(st.lists(_trials(known), min_size=1, max_size=2), label="train")),
            tuple(draw(st.lists(_trials(known), max_size=1), label="test")),
        )
        for index in range(draw(st.integers(1, 3)))
    ]
    players = [
        draw(kinds).model_copy(update={"name": f"learner{index}"})
        for index in range(draw(st.integers(1, 3)))
    ]
    return make_experiment(
        conditions,
        players,
        name=draw(st.from_regex(r"[a-z][a-z0-9_.-]{0,15}", fullmatch=True), label="name"),
        title=draw(
            st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=20)
        ),
        seed=draw(st.integers(0, 2**63 - 1), label="seed"),
        protocol=draw(protocols(), label="protocol"),
        subjects=draw(st.integers(1, 5), label="subjects"),
        cell_size=draw(st.integers(1, 5), label="cell size"),
        reward=draw(st.sampled_from([*PRESETS]), label="reward"),
    )


@st.composite
def _trials(draw: st.DrawFn, known: Sequence[Schema]) -> Trials:
    schema = draw(st.sampled_from(known))
    if draw(st.booleans(), label="random layouts"):
        return Trials(schema, "random", draw(st.none() | st.integers(1, 3)))
    given = draw(
        st.lists(layouts(schema), min_size=1, max_size=3, unique_by=lambda one: one.places)
    )
    number = draw(st.none() | st.integers(1, len(given)))
    return Trials(schema, tuple(given), number, draw(st.booleans()))
