"""Beliefs beside sessions of random actions, without a learner that decides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from causal_openlock.belief.beliefs import Belief, Beliefs
from causal_openlock.belief.knowledge import Prior
from causal_openlock.contract.learner import Step, View
from causal_openlock.experiment.protocol import Condition, Protocol
from causal_openlock.experiment.session import Session
from support.belief_by_hand import Happening, World, plain_of, transcript

LONG = Protocol("long", 40, stop_when_solved=False, baseline_trials=1, layouts="random")
"""A trial that goes on after all solutions were found, so that they are found again."""


@dataclass
class Played:
    """A session of random actions and what its subjects believe.

    Args:
        condition: Which rooms.
        prior: What subjects believe before they see a room.
        protocol: With what budgets.
        subjects: Their numbers; what they do depends on nothing else.
        lively: Share of actions on grey levers and the door alone.
    """

    condition: Condition
    prior: Prior
    protocol: Protocol = LONG
    subjects: Sequence[int] = (0,)
    lively: float = 0.8
    happened: list[list[Happening]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.session = Session(self.condition, self.protocol, self.subjects, seed=3)
        brief = self.session.brief
        self.positions = brief.positions
        self.beliefs = Beliefs(brief, self.prior, brief.generators)
        self.happened = [[] for _ in self.subjects]
        self._own = [np.random.default_rng([11, number]) for number in self.subjects]

    def moments(self, actions: int) -> Iterator[tuple[View, Step]]:
        """So many actions: what was seen, and what came of it, beliefs being up to date."""
        while not self.session.over and actions:
            actions -= 1
            view = self.session.view
            self.beliefs.enter(view)
            chosen = [self._action(view, row) for row in range(len(self.subjects))]
            step = self.session.step(np.array(chosen))
            for row in np.flatnonzero(view.playing).tolist():
                before, after = view.observation[row], step.outcome[row]
                self.happened[row].append(
                    Happening(
                        tuple(before.tolist()),
                        int(step.action[row]),
                        tuple(after.tolist()),
                        bool(step.new_solution[row]),
                    )
                )
                if step.trial_over[row]:
                    self.happened[row].clear()
            self.beliefs.update(step)
            yield view, step

    def _action(self, view: View, row: int) -> int:
        rng, p = self._own[row], self.positions
        if rng.random() >= self.lively:
            return int(rng.integers(2 * p + 1))
        seen = view.observation[row]
        if seen[-2] == 0 and rng.random() < 0.7:
            return 2 * p
        could = np.flatnonzero((seen[p : 2 * p] == 1) & (seen[:p] == 0))
        return int(rng.choice(could)) if len(could) else 2 * p

    def belief(self, row: int = 0) -> Belief:
        """What a subject believes."""
        belief = self.beliefs.of[row]
        assert belief is not None
        return belief


Key = tuple[tuple[int, ...], object, int]


def by_behaviour(belief: Belief) -> dict[Key, float]:
    """A belief by active positions, behaviour of the levers there, and strength."""
    space = belief.space
    many, limit = len(space.strengths), space.sight.action_limit
    weights: dict[Key, float] = {}
    for index, weight in zip(belief.which.tolist(), belief.weight.tolist(), strict=True):
        if weight > 0:
            world = World.of(space.hypotheses, index)
            places = tuple(belief.positions[world.slots].tolist())
            structure = plain_of(world.fsm.schema)
            behaviour = transcript(structure, limit, 0.7 if many > 1 else 1.0)
            key = (places, behaviour, index % many)
            assert key not in weights, "the same hypothesis twice"
            weights[key] = weight
    return weights
