"""Beliefs next to sessions of random actions, without a learner that decides."""

from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from causal_openlock.belief.beliefs import Beliefs
from causal_openlock.belief.grammar import class_prior
from causal_openlock.belief.knowledge import BeliefParameters
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from oracle import DOOR, likelihood, normalised, structure
from support.belief_arrays import (
    fits,
    key_of_rules,
    lever_set,
    of_classes,
    rules_in,
    seen_in,
    seen_of,
)

LONG = Protocol("long", 40, stop_when_solved=False, baseline_trials=1, layouts="random")
"""A trial that goes on after all solutions were found, so that they are found again."""


@dataclass(frozen=True)
class GreyIfColour(BeliefParameters):
    """If colour marks the active levers, it is the grey ones."""

    @property
    def rules(self):
        return np.array([self.by_colour, 0.0, 1.0 - self.by_colour])


KNOWN = GreyIfColour(by_colour=1.0)
"""Grey levers are active: nothing else is to be found out about colours."""


def rooms_of(schema) -> Condition:
    """A baseline of one trial."""
    schema = find_schema(schema) if isinstance(schema, str) else schema
    return Condition("room", (Trials(schema),))


@dataclass
class Played:
    """A session of random actions and what its subjects believe, who begin with the settings.

    What subjects do depends on their numbers alone; a ``lively`` share of it is done to grey levers
    and the door. What ``happened`` is ``(pushed, node, seen)`` of each of their actions in the
    present trial that might do something.
    """

    condition: Condition
    settings: BeliefParameters
    protocol: Protocol = LONG
    subjects: tuple = (0,)
    lively: float = 0.8
    happened: list = field(default_factory=list)

    def __post_init__(self):
        self.session = Session(self.condition, self.protocol, self.subjects, seed=3)
        brief = self.session.brief
        self.positions = brief.positions
        self.beliefs = Beliefs(brief, self.settings, brief.generators)
        self.happened = [[] for _ in self.subjects]
        self._own = [np.random.default_rng([11, number]) for number in self.subjects]

    def moments(self, actions):
        """So many actions: what was seen, and what came of it, beliefs being up to date."""
        while not self.session.over and actions:
            actions -= 1
            view = self.session.view
            self.beliefs.enter(view)
            chosen = [self._action(view, row) for row in range(len(self.subjects))]
            step = self.session.step(np.array(chosen))
            for row in np.flatnonzero(view.playing).tolist():
                verb, place = divmod(int(step.action[row]), self.positions)
                before, door = view.observation[row], verb == 2
                if door or verb == before[place]:
                    new = step.new_solution[row]
                    told = seen_in(before, step.outcome[row], self.positions, new, door)
                    self.happened[row].append((told[0], DOOR if door else place, told[1]))
                if step.trial_over[row]:
                    self.happened[row].clear()
            self.beliefs.update(step)
            yield view, step

    def _action(self, view, row):
        rng, p = self._own[row], self.positions
        if rng.random() >= self.lively:
            return int(rng.integers(2 * p + 1))
        seen = view.observation[row]
        if seen[-2] == 0 and rng.random() < 0.7:
            return 2 * p
        could = np.flatnonzero((seen[p : 2 * p] == 1) & (seen[:p] == 0))
        return int(rng.choice(could)) if len(could) else 2 * p

    def belief(self, row=0):
        """What a subject believes."""
        return self.beliefs.of[row]


def by_behaviour(belief):
    """A belief by active positions, behaviour of the levers there, and strength."""
    space = belief.space
    many, limit = len(space.strengths), space.sight.action_limit
    weights = {}
    for index, weight in zip(belief.which.tolist(), belief.weight.tolist(), strict=True):
        if weight > 0:
            slots, key = key_of_rules(rules_in(space.hypotheses, index))
            places = tuple(belief.positions[[*slots]].tolist())
            label = places, seen_of(key, limit, 0.7 if many > 1 else 1.0), index % many
            assert label not in weights, "the same hypothesis twice"
            weights[label] = weight
    return weights


def enumerated(played, actives):
    """The same posterior of the first subject in its first room, by the oracle.

    Given are sets of positions, and how probable it is that exactly these are active.
    """
    settings, space = played.settings, played.belief().space
    sight, how = space.sight, space.strengths
    classes = class_prior(settings.simplicity, settings.free_form)
    posterior = defaultdict(float)
    for places, share in actives.items():
        chances = defaultdict(float)
        for _, key, chance in of_classes(classes, len(places), settings.simplicity):
            chances[key] += chance
        for key, chance in chances.items():
            if not fits(key, sight.solutions, sight.action_limit):
                continue
            seen = seen_of(key, sight.action_limit, 0.7 if len(how) > 1 else 1.0)
            for index, (strength, surely) in enumerate(zip(how.value, how.prior, strict=True)):
                rules = structure(*key, float(strength)).at(dict(enumerate(places)))
                told = likelihood(rules, played.happened[0])
                posterior[places, seen, index] += share * chance * surely * told
    return normalised(posterior)


def active_sets(belief):
    """The sets of positions that may be active, in the order of the blocks."""
    return [
        tuple(belief.positions[sorted(lever_set(mask))].tolist())
        for mask in belief.space.active.tolist()
    ]
