"""A trial to look at, moment by moment, next to the learner's beliefs.

A :class:`WatchedTrial` holds what is shown; a notebook shows it as a strip of pictures
(:mod:`causal_openlock.notebook`), and :meth:`WatchedTrial.save` makes a film of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from causal_openlock.belief.belief_learner import BeliefLearner
from causal_openlock.belief.trace import Moment, Trace, trace_trial
from causal_openlock.contract.registry import create
from causal_openlock.errors import ExperimentError
from causal_openlock.experiment.condition import Condition
from causal_openlock.experiment.making import ConditionForm, LearnerForm, make_experiment
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.files.validation import whole_number
from causal_openlock.render.film import FilmedTrial, Shot, pauses, play_trial, save_film
from causal_openlock.schemas.schema import DOOR
from causal_openlock.world.room import Layout, position_coordinates

FAINTEST = 0.02
"""Arrows that are less probable are not drawn."""


@dataclass(frozen=True, eq=False)
class WatchedTrial:
    """A trial to look at; see :func:`watch`."""

    trial: FilmedTrial  #: what was played
    trace: Trace | None  #: the beliefs in it, if the learner holds any
    attempts: int | None = None  #: how many attempts are shown at most

    @cached_property
    def shots(self) -> tuple[Shot, ...]:
        """Pictures of the trial: one before each attempt, and one after each action."""
        return tuple(pauses(self.trial, attempts=self.attempts))

    def belief(self, shot: Shot) -> Moment | None:
        """The learner's belief at a moment; None if it has none."""
        before = sum(len(row["actions"]) for row in self.trial.attempts[: shot.attempt - 1])
        return self.trace.moments[before + shot.action] if self.trace else None

    @property
    def title(self) -> str:
        """Learner, condition and trial, in words."""
        trial, room = self.trial, self.trial.room
        return (
            f"{trial.learner} in {trial.condition.name}, {trial.place} "
            f"({room.schema.name} in {room.layout.name}), subject {trial.subject}"
        )

    def save(self, path: Path | str, **options: Any) -> int:
        """Write a film of the room and its console, or its last moment; see ``save_film``.

        Raises:
            OpenLockError: If the suffix is none of ``.gif``, ``.mp4``, ``.png`` and ``.svg``, or
                the file cannot be written.
        """
        return save_film(self.trial, path, **{"attempts": self.attempts, **options})

    def __repr__(self) -> str:
        return "\n".join([self.title, *(in_words(shot) for shot in self.shots if shot.action)])


def in_words(shot: Shot) -> str:
    """The moment that a shot shows: ``attempt 1, push UPPER: the lever moves``."""
    if not shot.panel.actions:
        return f"attempt {shot.attempt}"
    action = shot.panel.actions[-1]
    return f"attempt {shot.attempt}, {action.name}: {action.outcome}"


def watch(
    learner: LearnerForm,
    condition: ConditionForm,
    *,
    layout: str | Mapping[str, str] | Layout | None = None,
    trial: int = 1,
    attempts: int | None = 10,
    protocol: str | Protocol = "human",
    subject: int = 0,
    seed: int = 0,
) -> WatchedTrial:
    """Let a learner play up to the end of a trial, and look at this trial moment by moment.

    Args:
        learner: A learner by name or class, or what :func:`~causal_openlock.learner` returns.
        condition: ``CC4``, ``CC3-CC4``, a schema, a :class:`Condition`, or a schema as a line of
            text such as ``A -> B, C -> door``.
        layout: A layout, such as ``trial7``, of the one trial of a condition of one schema.
        trial: Number of the trial in the whole condition, from 1.
        attempts: How many attempts to show at most; the trial itself is played to its end.
        protocol: The budgets.
        subject: Number of the subject.
        seed: Seed of the experiment; with that of a comparison it is the same trial as there.

    Raises:
        OpenLockError: If there is no such learner, schema, layout or trial.

    Example:
        >>> watch("oracle", "CC3", layout="trial1", attempts=1)
        oracle in CC3, trial 1 of 1 (CC3 in trial1), subject 0
        attempt 1, push UPPERRIGHT: the lever moves
        attempt 1, push LOWERLEFT: the door unlocks
        attempt 1, push door: the door opens: a new solution
    """
    if attempts is not None:
        attempts = whole_number(attempts, "attempts", 1)
    trial, subject = whole_number(trial, "trial", 1), whole_number(subject, "subject")
    experiment = make_experiment([condition], [learner], seed=seed, protocol=protocol, subjects=1)
    (spec,), (played,) = experiment.learners, experiment.conditions
    if layout is not None:
        played = _in_layout(played, layout)
    where: Any = {"trial": trial, "subject": subject, "seed": seed, "reward": spec.reward}
    # Played twice, the same way: a trace is of beliefs alone, and only some learners have them.
    one, other = (create(spec.learner, spec.parameters) for _ in range(2))
    film = play_trial(one, played, spec.protocol, label=spec.name, **where)
    trace = None
    if isinstance(other, BeliefLearner):
        trace = trace_trial(other, played, spec.protocol, label=spec.name, **where)
    return WatchedTrial(film, trace, attempts)


def _in_layout(condition: Condition, layout: str | Mapping[str, str] | Layout) -> Condition:
    """A condition of one schema in one layout."""
    if len(condition.train) > 1 or condition.test:
        raise ExperimentError(
            f"{condition.name} has rooms of several kinds, and the layout {layout} is for one; "
            "leave it out, or watch one schema"
        )
    (trials,) = condition.train
    place = Layout.of(trials.schema, layout)
    return replace(condition, train=(replace(trials, layouts=(place,), number=None),))


# -- a belief as a picture ------------------------------------------------------------------------

LINK, HIGH, LETTER = 100, 22, 6.2
"""Arm link, half the height of a name's box, half a letter's width, in the picture's units."""
BELIEVED, TRUE = "#00427A", "#009E73"


def belief_svg(belief: Moment, trace: Trace) -> str:
    """The levers in their places, and the arrows between them, the darker the more probable.

    A dashed green line runs along the arrows of the true schema; inactive levers are faint.
    """
    places: Any = position_coordinates(len(belief.edges)) * [LINK, -LINK]
    spots = np.vstack([places, [places[:, 0].max() + 1.5 * LINK, 0.0]])
    half = np.array([[LETTER * len(name) + 10, HIGH] for name in trace.nodes])
    low, high = (spots - half).min(axis=0) - 4, (spots + half).max(axis=0) + 4
    wide, tall = high - low
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{3.3 * wide / tall:.2f}in" '
        f'height="3.3in" viewBox="{low[0]:.0f} {low[1]:.0f} {wide:.0f} {tall:.0f}" role="img" '
        'font-size="17" font-family="sans-serif" text-anchor="middle">',
        "<title>What the learner believes</title>",
    ]
    for chance, (cause, effect) in sorted((p, edge) for edge, p in np.ndenumerate(belief.edges)):
        if chance >= FAINTEST:
            line, head = _arrow(spots[cause], spots[effect])
            lines.append(
                f'<g opacity="{chance:.2f}" stroke="{BELIEVED}"><path d="{line}" fill="none" '
                f'stroke-width="6"/><path d="{head}" fill="{BELIEVED}"/></g>'
            )
    for edge in trace.truth.graph.edges:
        line, _ = _arrow(*(spots[trace.nodes.index(node)] for node in edge))
        lines.append(
            f'<path d="{line}" fill="none" stroke="{TRUE}" stroke-width="2.5" '
            'stroke-dasharray="9 6"/>'
        )
    for (x, y), (across, up), name in zip(spots, half, trace.nodes, strict=True):
        active = name in trace.truth.graph
        fill, stroke, ink = ("#DDD", "#222", "#000") if active else ("#FFF", "#999", "#888")
        lines.append(
            f'<rect x="{x - across:.0f}" y="{y - up:.0f}" width="{2 * across:.0f}" '
            f'height="{2 * up:.0f}" rx="{6 if name == DOOR else up}" fill="{fill}" '
            f'stroke="{stroke}" stroke-width="2"/>'
            f'<text x="{x:.0f}" y="{y + 6:.0f}" fill="{ink}">{name}</text>'
        )
    return "\n".join([*lines, "</svg>"])


def _arrow(start: Any, end: Any) -> tuple[str, str]:
    """A slightly bent arrow as two paths: its line, and its head at two thirds of the way."""
    way = (end - start) / np.hypot(*(end - start))
    side = np.array([-way[1], way[0]])
    bend = (start + end) / 2 + 0.12 * np.hypot(*(end - start)) * side
    neck = (start + 4 * bend + 4 * end) / 9
    corners = (start, bend, end, neck + 20 * way, neck + 9 * side, neck - 9 * side)
    a, b, c, *head = (f"{x:.0f},{y:.0f}" for x, y in corners)
    return f"M{a} Q{b} {c}", f"M{' '.join(head)}Z"
