"""The trials of a subject, drawn from its condition and protocol."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any

import numpy as np

from causal_openlock.contract.registry import parse_parameters
from causal_openlock.errors import ExperimentError
from causal_openlock.experiment.condition import SHOWN, Condition, Trials
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.origin import answer_of
from causal_openlock.experiment.protocol import LayoutSource, Protocol
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import counted
from causal_openlock.world.room import Layout, positions_for, published_layouts


@dataclass(frozen=True)
class Visit:
    """One trial of one subject."""

    phase: str
    loop: int
    trial: int
    schema: Schema
    layout: Layout
    order: tuple[int, ...] = ()  #: indices of the solutions that are shown


def plan(
    condition: Condition,
    protocol: Protocol,
    generator: np.random.Generator,
    subject: int | None = None,
) -> list[Visit]:
    """The trials of one subject, in order.

    Each loop draws new layouts, without repeats within the loop. Of a subject that the condition
    has ``rooms`` of, the first trials are in those.

    Raises:
        ExperimentError: If a schema does not fit the protocol, has fewer layouts than trials, or
            more solutions to show than a trial has attempts.
    """
    train = (protocol.training_trials, protocol.train_loops)
    if not condition.test:
        train = (protocol.baseline_trials, protocol.baseline_loops)
    tested = condition.test
    if name := protocol.test_layout:  # in results of 0.2
        tested = tuple(replace(one, layouts=(Layout.of(one.schema, name),)) for one in tested)
    recorded = iter(condition.rooms.get(-1 if subject is None else subject, ()))
    visits: list[Visit] = []
    for phase, groups, number, loops in (
        (SHOWN if condition.shown else "train", condition.train, *train),
        ("test", tested, protocol.test_trials, protocol.test_loops),
    ):
        for loop in range(1, loops + 1):
            drawn = (
                (trials.schema, next(recorded, layout))
                for trials in groups
                for layout in draw_layouts(trials, generator, number, protocol.layouts)
            )
            visits += [Visit(phase, loop, trial, *room) for trial, room in enumerate(drawn, 1)]
    for number, visit in enumerate(visits):
        solutions = len(visit.schema.solutions) if visit.phase == SHOWN else 0
        if solutions > protocol.attempt_limit:
            raise ExperimentError(
                f"{visit.schema.name} has {solutions} solutions to show, and a trial of protocol "
                f"{protocol.name} has {counted(protocol.attempt_limit, 'attempt')}; raise its "
                "attempt_limit"
            )
        if visit.phase == SHOWN:
            order = tuple(generator.permutation(solutions).tolist())
            visits[number] = replace(visit, order=order)
    for schema in condition.schemas:
        protocol.actions_for(schema)
    return visits


def draw_layouts(
    trials: Trials, generator: np.random.Generator, number: int, source: LayoutSource
) -> list[Layout]:
    """The layouts of one loop over trials; the last two arguments are for trials without their own.

    Where layouts are published, there may be fewer than ``number``.
    """
    schema = trials.schema
    layouts: Any = trials.layouts or source
    if layouts == "published":
        layouts = [*published_layouts(schema).values()] or "random"
    listed = trials.layouts and layouts != "random"
    number = trials.number or (len(layouts) if listed else number)
    if layouts == "random":
        most = math.perm(positions_for(schema), len(schema.levers))
        if number > most:
            raise ExperimentError(
                f"{schema.name} has {most} layouts, too few for {number} trials; ask for fewer "
                "trials, or for more loops"
            )
        drawn: dict[tuple[int, ...], Layout] = {}
        while len(drawn) < number:
            layout = Layout.random(schema, generator)
            drawn.setdefault(layout.places, layout)
        return list(drawn.values())
    if (trials.number or 0) > len(layouts):
        raise ExperimentError(
            f"{trials.number} trials of {schema.name} are asked for and {len(layouts)} layouts of "
            f"{len(schema.levers)} levers are published; ask for at most {len(layouts)} trials, or "
            "for layouts: random"
        )
    order = generator.permutation(len(layouts)) if trials.shuffle else np.arange(len(layouts))
    return [layouts[index] for index in order[:number]]


@cache
def phases_of(condition: Condition, protocol: Protocol) -> tuple[str, ...]:
    """The phases of the trials that each subject has, in order.

    >>> from causal_openlock import PROTOCOLS, find_condition
    >>> phases = phases_of(find_condition("shown-CC3-CC4"), PROTOCOLS["human"])
    >>> len(phases), phases.count(SHOWN)
    (7, 6)
    """
    return tuple(visit.phase for visit in plan(condition, protocol, np.random.default_rng(0)))


def check_trial(trial: int, trials: int, where: str) -> None:
    """Refuse a number of a trial that a condition does not have; ``where`` is for the message."""
    if not 1 <= trial <= trials:
        raise ExperimentError(f"{where} has no trial {trial}; choose one from 1 to {trials}")


@cache
def _actions_in(condition: Condition, protocol: Protocol) -> tuple[int, int]:
    """Actions of a subject that needs an attempt for each solution, and of one that solves none."""
    least = most = 0
    for visit in plan(condition, protocol, np.random.default_rng(0)):
        if visit.phase != SHOWN:
            actions, attempts = protocol.actions_for(visit.schema), protocol.attempt_limit
            most += actions * attempts
            solved = len(visit.schema.solutions) if protocol.stop_when_solved else attempts
            least += actions * min(solved, attempts)
    return least, most


def forewarnings(experiment: Experiment) -> list[str]:
    """Sentences on schemas that cannot be solved, learners that never learn, and prompt tokens."""
    warnings = [
        f"{schema.name} has {len(schema.solutions)} solutions and protocol {protocol.name} "
        f"gives {counted(protocol.attempt_limit, 'attempt')}, so its trials cannot be solved"
        for protocol, schema in product(experiment.protocols, experiment.schemas)
        if len(schema.solutions) > protocol.attempt_limit
    ]
    for spec in experiment.learners:
        parameters = parse_parameters(spec.learner, spec.parameters)
        left_out = experiment.not_applicable.get(spec.name, {})
        actions = [
            _actions_in(condition, spec.protocol)
            for condition in experiment.conditions
            if condition.name not in left_out
        ]
        tokens = [
            sum(answer_of(spec.learner, "prompt_tokens", int, parameters, n) for n in numbers)
            for numbers in zip(*actions, strict=True)
        ]
        if any(tokens):
            least, most = (round(spec.subjects * number, -3) for number in tokens)
            warnings.append(
                f"{spec.name} sends its conversation again with every request: its subjects take "
                f"about {least:,} prompt tokens if they solve every room in the fewest attempts, "
                f"and {most:,} if they solve none; try two subjects first"
            )
        first = answer_of(spec.learner, "first_update", int, parameters)
        most = max((number for _, number in actions), default=0)
        if most and first >= most:
            warnings.append(
                f"{spec.name} first learns after {first:,} actions, and under protocol "
                f"{spec.protocol.name} a subject has at most {most:,} in a condition, so it never "
                "learns"
            )
    return warnings
