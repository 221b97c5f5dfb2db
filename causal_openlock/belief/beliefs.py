"""Posteriors over the hypotheses about a room: a :class:`Belief`, and those of many subjects.

Bayes' rule: ``P(h | events)`` is proportional to ``P(h)`` times the product of ``P(event | h)``. A
subject with a perfect memory drops every hypothesis that is ruled out. One that forgets moves back
at the end of each attempt, by a share ``lost``, towards a baseline: its prior at the start of the
trial or, if it forgets failures alone, that prior conditioned on its successful attempts.

Without noise, evidence rules hypotheses out for good. By default a subject starts by expecting no
noise. Once every hypothesis is ruled out it concludes that levers may fail to move, and conditions
hypotheses of unknown strength on all events of the trial. That is Bayesian inference in the limit
of a vanishing prior probability of noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import chain

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS
from causal_openlock.belief.hypotheses import RoomSight, Space, enumerate_space, strengths
from causal_openlock.belief.knowledge import BeliefParameters, Knowledge
from causal_openlock.belief.likelihoods import Event, likelihood, observed
from causal_openlock.belief.sampling import Sampler, sampled
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

enumerated = lru_cache(maxsize=64)(enumerate_space)
PARTICLES = 500
"""Structures that are sampled where there are too many to list."""
SAMPLES = 3
"""Times that a subject samples before it concludes that levers may fail."""
FEW_DRAWS = 40
"""Draws up to which all structures are taken to be drawn: sampling again finds no others."""


@dataclass(eq=False, repr=False)
class Belief:
    """One subject's belief about its current room.

    Example:
        >>> import numpy as np
        >>> Belief(None, np.arange(3), np.arange(4), np.full(4, 0.25)).entropy
        2.0
    """

    space: Space  #: the hypotheses
    slots: IntArray  #: ``[P]`` the slot of each position
    which: IntArray  #: ``[E]`` indices of the hypotheses still possible, in ascending order
    weight: FloatArray  #: ``[E]`` their posterior probabilities
    start: FloatArray | None = None  #: ``[E]`` the baseline that forgetting moves back to
    drawn: int = 0  #: how many hypotheses were sampled, where there are too many to list
    possible: bool = True  #: whether any hypothesis explains what was observed
    attempts: list[list[Event]] = field(default_factory=lambda: [[]])  #: events of each attempt

    @property
    def found(self) -> tuple[int, ...]:
        """The levers that were pushed when each solution was found, as masks of slots."""
        return tuple(event.pushed for event in chain(*self.attempts) if event.new)

    @property
    def positions(self) -> IntArray:
        """``[P]`` the position of each slot."""
        return np.argsort(self.slots)

    def __repr__(self) -> str:
        """Short, as there can be a million hypotheses."""
        return f"Belief({len(self.which):,} hypotheses, {self.entropy:.2f} bits)"

    @property
    def entropy(self) -> float:
        """Shannon entropy of the posterior, in bits."""
        weight = self.weight[self.weight > 0]
        return float(-(weight * np.log2(weight)).sum())

    def observe(self, event: Event) -> bool:
        """Update by Bayes' rule; False, and nothing changes, if no hypothesis explains the event.

        Hypotheses that are ruled out are dropped, unless the subject forgets.
        """
        weight = self.weight * self.likelihood(event)
        total = weight.sum()
        if not total > 0:
            return False
        weight /= total
        if self.start is None:
            kept = weight > 0
            self.which, weight = self.which[kept], weight[kept]
        self.weight = weight
        return True

    def likelihood(self, event: Event) -> FloatArray:
        """``[E]`` likelihood of an event."""
        return likelihood(self.space.hypotheses, self.which, self.space.strengths, event)

    def given(self, prior: FloatArray, events: Iterable[Event]) -> FloatArray:
        """``[E]`` posterior after events; the prior, ``[E]``, if no hypothesis explains them."""
        weight = prior.copy()
        for event in events:
            weight *= self.likelihood(event)
        total = weight.sum()
        return weight / total if total > 0 else prior

    def end_attempt(self, lost: float, keeps: bool) -> None:
        """Begin another attempt; a subject that forgets loses a part of the trial's evidence.

        The posterior moves back to the baseline by a share ``lost``; if the subject ``keeps`` what
        it observed in this attempt, that becomes part of the baseline.
        """
        if self.start is not None:
            if keeps:
                self.start = self.given(self.start, self.attempts[-1])
            self.weight = (1.0 - lost) * self.weight + lost * self.start
        self.attempts.append([])


class Beliefs:
    """The beliefs of B subjects, each with a generator for hypotheses that are sampled.

    Attributes:
        of: The posterior of each subject; None while it is in no room.
        left: The posterior of each subject about the room that it has left last.
        knowledge: What each subject carries from room to room.
        unsure: ``[B]`` whether the subject believes that levers may fail to move.

    Example:
        A subject enters a room with the levers of CC3.

        >>> from causal_openlock import PROTOCOLS, Session, find_condition
        >>> session = Session(find_condition("CC3"), PROTOCOLS["human"], 1)
        >>> beliefs = Beliefs(session.brief, BeliefParameters(), session.brief.generators)
        >>> beliefs.enter(session.view)
        >>> beliefs.of[0]
        Belief(4,278 hypotheses, 7.86 bits)
    """

    def __init__(
        self, brief: Brief, settings: BeliefParameters, generators: tuple[np.random.Generator, ...]
    ) -> None:
        self.settings = settings
        self.positions = brief.positions
        self._generators = generators
        self._certain, self._unsure = strengths(0.0), strengths(settings.noise or 0.5)
        self.unsure: BoolArray = np.full(brief.subjects, settings.noise > 0)
        self.knowledge = Knowledge(brief.subjects, brief.positions, settings, self._unsure)
        self.of: list[Belief | None] = [None] * brief.subjects
        self.left: list[Belief | None] = [None] * brief.subjects

    # -- a room is entered, and left ------------------------------------------------------------

    def enter(self, view: View) -> None:
        """Form the prior of subjects that have just come into a room."""
        new = [b for b in np.flatnonzero(view.playing).tolist() if self.of[b] is None]
        is_grey = view.observation[:, self.positions : 2 * self.positions] == 1
        for subject in new:
            grey = is_grey[subject]
            sight = RoomSight(
                self.positions,
                int(grey.sum()),
                int(view.console.solutions_left[subject]),
                int(view.console.actions_left[subject]),
            )
            slots = np.argsort(np.argsort(~grey, kind="stable"))
            self.of[subject] = self._prior_belief(subject, sight, slots, [])

    def _prior_belief(
        self, subject: int, sight: RoomSight, slots: IntArray, events: Sequence[Event]
    ) -> Belief:
        """A belief before anything is observed.

        Where there are too many structures to list, what was observed so far decides which are
        sampled.
        """
        how = self._unsure if self.unsure[subject] else self._certain
        space, drawn = enumerated(sight, how, self.settings.simplicity), 0
        if sight.grey > FREE_FORM_LEVERS:
            sampler = Sampler(sight.grey, self.settings.simplicity, how.typical, events)
            sample = sampled(sampler, sight, PARTICLES, self._generators[subject])
            grey = tuple(range(sight.grey))
            space = Space(sight, how, (*space.blocks, (grey, sample)))
            drawn = len(sample)
        weight = self._weights(subject, space, slots)
        which = np.flatnonzero(weight > 0)
        share = weight[which] / weight[which].sum()
        start = share if self.settings.forgetting else None
        return Belief(space, slots, which, share, start, drawn=drawn)

    def _weights(self, subject: int, space: Space, slots: IntArray) -> FloatArray:
        """``[H]`` prior probabilities of the hypotheses about a room."""
        known = self.knowledge
        in_slots = known.by_position(subject)[np.argsort(slots)]
        strength = known.strengths[subject] if len(space.strengths) > 1 else np.ones(1)
        weights = space.prior(known.classes(subject), known.rules[subject], in_slots, strength)
        if self.settings.directness:
            direct = np.bitwise_count(space.hypotheses.causes[:, -1])
            weights *= np.exp(self.settings.directness * direct)
        return weights

    def leave(self, subject: int) -> None:
        """Update what is carried between rooms, and forget the room."""
        belief = self.left[subject] = self.of[subject]
        if belief is not None and belief.possible and len(belief.which):
            self.knowledge.absorb(subject, belief.space, belief.which, belief.weight, belief.slots)
        self.of[subject] = None

    # -- something is observed ------------------------------------------------------------------

    def update(self, step: Step) -> None:
        """Update the posteriors with what the subjects' actions led to."""
        for subject in np.flatnonzero(step.view.playing).tolist():
            belief = self._belief(subject)
            event = observed(step, subject, belief.slots, belief.found)
            if event is not None:
                self._observe(subject, event)
            if step.attempt_over[subject]:
                belief = self._belief(subject)
                belief.end_attempt(self.settings.forgetting, self._keeps(belief.attempts[-1]))
            if step.trial_over[subject]:
                self.leave(subject)

    def _keeps(self, attempt: list[Event]) -> bool:
        """Whether a subject that forgets keeps what it observed in an attempt."""
        return self.settings.forgets == "failures" and any(event.new for event in attempt)

    def _observe(self, subject: int, event: Event) -> None:
        belief = self._belief(subject)
        belief.attempts[-1].append(event)
        if not belief.observe(event):
            self._reconsider(subject)
        elif belief.drawn > FEW_DRAWS and self._depleted(belief):
            fresh = self._rebuilt(subject)
            self.of[subject] = fresh if fresh.possible else belief

    def _belief(self, subject: int) -> Belief:
        belief = self.of[subject]
        assert belief is not None, "the subject is in no room"
        return belief

    # -- when too few hypotheses are left --------------------------------------------------------

    @staticmethod
    def _depleted(belief: Belief) -> bool:
        """Whether too few of the structures that were sampled are still possible."""
        first = belief.space.ends[-2] if len(belief.space.ends) > 1 else 0
        alive = int((belief.weight[belief.which >= first] > 0).sum())
        return alive < belief.drawn / 4

    def _reconsider(self, subject: int) -> None:
        """Sample other hypotheses, or conclude that levers may fail, when no hypothesis is left."""
        sampled = self._belief(subject).space.sight.grey > FREE_FORM_LEVERS
        for _ in range(SAMPLES if sampled else 0):  # one sample without a fitting structure is weak
            fresh = self._rebuilt(subject)
            if fresh.possible:
                break
        else:
            self.unsure[subject] = True
            fresh = self._rebuilt(subject)
        self.of[subject] = fresh

    def _rebuilt(self, subject: int) -> Belief:
        """The posterior over other hypotheses, given everything observed in this trial."""
        past = self._belief(subject)
        events = [*chain(*past.attempts)]
        fresh = self._prior_belief(subject, past.space.sight, past.slots, events)
        fresh.attempts = past.attempts
        fresh.possible = all(map(fresh.observe, events))
        if fresh.possible and fresh.start is not None:
            kept = chain(*filter(self._keeps, past.attempts[:-1]))
            fresh.start = fresh.given(fresh.start, kept)
        return fresh
