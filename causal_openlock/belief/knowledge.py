"""Knowledge carried from room to room: schema classes, rules that mark levers, strength.

The hypotheses about each room are new; their hyperparameters are learned (a hierarchical Bayesian
model): a Dirichlet distribution over schema classes, to which each finished room adds one count,
divided among the classes by its posterior; the probability of each rule that may mark active
levers; for each position a Beta distribution of the probability that the lever there is active; and
the probability of each strength. At first they are those that :class:`BeliefParameters` name.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from causal_openlock.belief.grammar import class_prior
from causal_openlock.belief.hypotheses import RULES, Space, Strengths
from causal_openlock.contract.parameters import OpenShare, Positive, Share
from causal_openlock.schemas.fsm import FloatArray, IntArray

WHITE = 0.1
"""Probability that it is the white levers that are active, if colour marks them."""
RULE_CHANGES = 1e-3
"""Probability that another rule holds in the next room, so that every rule stays possible."""


@dataclass(frozen=True)
class BeliefParameters:
    """Hyper-parameters of beliefs: their prior, and what is forgotten; learners add their own."""

    concentration: Annotated[
        Positive, "how many rooms the prior over schema classes is worth (Dirichlet)"
    ] = 1.0
    simplicity: Annotated[
        float, Field(ge=0), "cost of each part of a schema's description, in nats"
    ] = math.log(2.0)
    free_form: Annotated[
        OpenShare, "prior probability that a schema is of no class of the grammar"
    ] = 0.1
    by_colour: Annotated[OpenShare, "prior probability that colour marks the active levers"] = 0.5
    noise: Annotated[
        float,
        Field(ge=0, lt=1),
        "prior probability that levers may fail to move; at 0, only if nothing else is possible",
    ] = 0.0
    directness: Annotated[
        float, "how much levers are expected to act on the door themselves, in nats for each"
    ] = 0.0
    forgetting: Annotated[Share, "share of a trial's evidence lost with every attempt"] = 0.0
    forgets: Annotated[
        Literal["everything", "failures"],
        "what is lost: all evidence, or only that of attempts that found nothing new",
    ] = "everything"

    @property
    def rules(self) -> FloatArray:
        """``[3]`` probability of each of :data:`~causal_openlock.belief.hypotheses.RULES`.

        >>> BeliefParameters(by_colour=0.5).rules.round(2).tolist()  # grey, white, position
        [0.45, 0.05, 0.5]
        """
        colour = self.by_colour
        return np.array([colour * (1.0 - WHITE), colour * WHITE, 1.0 - colour])


class Knowledge:
    """Knowledge of B subjects about schemas before they enter a room with levers at P positions.

    Attributes:
        rooms: ``[B, C + 1]`` expected number of rooms of each class.
        rules: ``[B, 3]`` probability of each rule.
        active: ``[B, P]`` in how many of the ``visits`` the lever at each position was active.
        visits: ``[B]`` expected number of rooms whose active levers were marked by position.
        strengths: ``[B, G]`` probability of each strength.
    """

    def __init__(
        self, subjects: int, positions: int, settings: BeliefParameters, strengths: Strengths
    ) -> None:
        classes = class_prior(settings.simplicity, settings.free_form)
        self._counts = settings.concentration * classes
        self._rules = settings.rules
        self.rooms: FloatArray = np.zeros((subjects, len(self._counts)))
        self.rules: FloatArray = np.tile(self._rules, (subjects, 1))
        self.active: FloatArray = np.zeros((subjects, positions))
        self.visits: FloatArray = np.zeros(subjects)
        self.strengths: FloatArray = np.tile(strengths.prior, (subjects, 1))

    def classes(self, subject: int) -> FloatArray:
        """``[C + 1]`` probability of each class in the subject's next room."""
        counts = self.rooms[subject] + self._counts
        return counts / counts.sum()

    def by_position(self, subject: int) -> FloatArray:
        """``[P]`` probability that the lever at each position is active."""
        return (self.active[subject] + 1.0) / (self.visits[subject] + 2.0)

    def absorb(
        self, subject: int, space: Space, which: IntArray, weight: FloatArray, slots: IntArray
    ) -> None:
        """Update with the final posterior of a room.

        ``which``, ``[E]``, are the hypotheses that are still possible, ``weight`` their
        probabilities, and ``slots``, ``[P]``, the slot of each position.
        """
        many = len(space.strengths)
        in_block = np.searchsorted(space.ends, which, side="right")
        blocks = np.bincount(in_block, weight, minlength=len(space.blocks))
        by_rule = space.marked(self.by_position(subject)[np.argsort(slots)]) * self.rules[subject]
        total = by_rule.sum(axis=1, keepdims=True)
        shares = np.divide(by_rule, total, out=np.zeros_like(by_rule), where=total > 0)
        rules = blocks @ shares
        if rules.sum() > 0:
            rules = rules / rules.sum()
            self.rules[subject] = (1.0 - RULE_CHANGES) * rules + RULE_CHANGES * self._rules
            # Positions are evidence only to the extent that they marked the levers.
            share = rules[RULES.index("position")]
            self.active[subject] += share * (blocks @ (space.active[:, None] >> slots & 1))
            self.visits[subject] += share
        if many > 1:
            self.strengths[subject] = np.bincount(which % many, weight, minlength=many)

        classes = self.classes(subject)
        counts, starts = np.zeros_like(classes), np.concatenate([[0], space.ends[:-1]])
        for index in np.flatnonzero(blocks > 0):
            _, listed = space.blocks[index]
            of_block = in_block == index
            behaviour = (which[of_block] - starts[index]) // many
            held = np.bincount(behaviour, weight[of_block], minlength=len(listed)).astype(float)
            counts += listed.classes(held, classes)
        self.rooms[subject] += counts
