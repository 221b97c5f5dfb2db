"""Posteriors over the hypotheses about a room: a :class:`Belief`, and those of many subjects.

Bayes' rule: ``P(h | events)`` is proportional to ``P(h)`` times the product of ``P(event | h)``. A
subject with a perfect memory drops every hypothesis that is ruled out. One that forgets moves back
at the end of each attempt, by a share ``lost``, towards a baseline: its prior at the start of the
trial or, if it forgets failures alone, that prior conditioned on its successful attempts.

An update multiplies the weight of each hypothesis by the likelihood of what its subject observed.
Subjects whose rooms look alike share their hypotheses, so all their (subject, hypothesis) pairs are
updated as one flat array.

Without noise, evidence rules hypotheses out for good. By default a subject starts by expecting no
noise. Once every hypothesis is ruled out it concludes that levers may fail to move, and conditions
hypotheses of unknown strength on all events of the trial. That is Bayesian inference in the limit
of a vanishing prior probability of noise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS
from causal_openlock.belief.hypotheses import RoomSight, Space, enumerate_space, strengths
from causal_openlock.belief.knowledge import Knowledge, Prior
from causal_openlock.belief.likelihoods import (
    DOOR,
    Event,
    Events,
    informative,
    likelihood,
    observed,
)
from causal_openlock.belief.sampling import LISTED_CAUSES, Sampler, listed, sampled, with_sampled
from causal_openlock.belief.structures import Structures
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

enumerated = lru_cache(maxsize=64)(enumerate_space)
STRENGTH_NODES = 10
REDRAWS = 2
"""Times that a subject samples again before it concludes that levers may fail."""
FEW_DRAWS = 40
"""Draws up to which all structures are taken to be drawn: sampling again finds no others."""
SAVED = ("slots", "which", "weight", "start", "found", "possible")
"""Fields of a belief that a checkpoint holds as they are; none of them is changed in place."""
CACHED_EVENTS = 1000
"""Events whose likelihood is kept for a space, each with a byte for every hypothesis."""
_ALLOWED: WeakKeyDictionary[Space, dict[Event, BoolArray]] = WeakKeyDictionary()


@dataclass(eq=False, repr=False)
class Belief:
    """One subject's belief about its current room.

    Attributes:
        space: The hypotheses.
        slots: ``[P]`` the slot of each position.
        which: ``[E]`` indices of the hypotheses that are still possible, in ascending order.
        weight: ``[E]`` their posterior probabilities.
        start: ``[E]`` the baseline that a subject that forgets moves back to.
        found: The levers that were pushed when each solution was found, as masks of slots.
        drawn: How many hypotheses were sampled, where there are too many to list.
        possible: Whether any hypothesis explains what was observed.
        events: How often each event was observed in this trial.
        attempt: The events of this attempt, for subjects that forget.
        kept: The events of the trial that are not forgotten.

    Example:
        >>> import numpy as np
        >>> Belief(None, np.arange(3), np.arange(4), np.full(4, 0.25)).entropy
        2.0
    """

    space: Space
    slots: IntArray
    which: IntArray
    weight: FloatArray
    start: FloatArray | None = None
    found: tuple[int, ...] = ()
    drawn: int = 0
    possible: bool = True
    events: Counter[Event] = field(default_factory=Counter)
    attempt: tuple[Event, ...] = ()
    kept: tuple[Event, ...] = ()

    @property
    def positions(self) -> IntArray:
        """``[P]`` the position of each slot."""
        return np.argsort(self.slots)

    def __repr__(self) -> str:
        """Short, as there can be a million hypotheses."""
        return f"Belief({len(self.which):,} hypotheses, {self.entropy:.2f} bits)"

    @property
    def whole(self) -> bool:
        """Whether all hypotheses are listed, and none is ruled out."""
        return not self.drawn and len(self.which) == len(self.space)

    @property
    def entropy(self) -> float:
        """Shannon entropy of the posterior, in bits."""
        weight = self.weight[self.weight > 0]
        return float(-(weight * np.log2(weight)).sum())

    def forget(self, lost: float, keeps: bool) -> None:
        """Lose a part of the trial's evidence at the end of an attempt.

        The posterior moves back to the baseline by a share ``lost``; if the subject ``keeps`` the
        events of this attempt, they become part of the baseline.
        """
        if self.start is None:
            return
        if keeps:
            self.start = conditioned(self.space, self.which, self.start, self.attempt)
            self.kept += self.attempt
        self.attempt = ()
        self.weight = (1.0 - lost) * self.weight + lost * self.start


def conditioned(
    space: Space, which: IntArray, prior: FloatArray, events: Iterable[Event]
) -> FloatArray:
    """``[E]`` posterior of the hypotheses ``which``, by Bayes' rule.

    If no hypothesis explains the events, the prior, ``[E]``, is returned.
    """
    weight = prior.copy()
    for event in events:
        weight *= likelihood(space.hypotheses, which, space.strengths, event)
    total = weight.sum()
    return weight / total if total > 0 else prior


def _likelihood_of_all(space: Space, event: Event) -> NDArray[Any]:
    """``[H]`` likelihood of one event under every hypothesis of a space; cached without noise."""
    if len(space.strengths) > 1:
        return likelihood(space.hypotheses, np.arange(len(space)), space.strengths, event)
    # The solutions found before matter to the door alone.
    return _allows(space, event if event.slot == DOOR else event._replace(found=()))


def _allows(space: Space, event: Event) -> BoolArray:
    """``[H]`` which hypotheses of a space without noise allow an event.

    Subjects that forget rule nothing out, and meet the same events again and again.
    """
    known = _ALLOWED.setdefault(space, {})
    if event not in known:
        if len(known) >= CACHED_EVENTS:
            known.clear()
        every = np.arange(len(space))
        known[event] = likelihood(space.hypotheses, every, space.strengths, event) > 0
    return known[event]


class Beliefs:
    """The beliefs of B subjects.

    Args:
        brief: Sizes of the rooms.
        prior: What they believe before they see a room.
        generators: One for each subject, for hypotheses that are sampled.

    Attributes:
        of: The posterior of each subject; None while it is in no room.
        left: The posterior of each subject about the room that it has left last.
        knowledge: What each subject carries from room to room.
        unsure: ``[B]`` whether the subject believes that levers may fail to move.

    Example:
        A subject enters a room with the levers of CC3.

        >>> from causal_openlock import PROTOCOLS, Session, find_condition
        >>> session = Session(find_condition("CC3"), PROTOCOLS["human"], 1)
        >>> beliefs = Beliefs(session.brief, Prior(), session.brief.generators)
        >>> beliefs.enter(session.view)
        >>> beliefs.of[0]
        Belief(4,278 hypotheses, 7.86 bits)
    """

    def __init__(
        self, brief: Brief, prior: Prior, generators: tuple[np.random.Generator, ...]
    ) -> None:
        self.prior = prior
        self.positions = brief.positions
        self._generators = generators
        self._certain = strengths(0.0, 1.0, 1.0, 1)
        self._unsure = strengths(
            prior.noise or 0.5, prior.strength_alpha, prior.strength_beta, STRENGTH_NODES
        )
        self.unsure: BoolArray = np.full(brief.subjects, prior.noise > 0)
        self.knowledge = Knowledge(brief.subjects, brief.positions, prior, self._unsure)
        self.of: list[Belief | None] = [None] * brief.subjects
        self.left: list[Belief | None] = [None] * brief.subjects

    # -- a room is entered, and left ------------------------------------------------------------

    def enter(self, view: View) -> None:
        """Form the prior of subjects that have just come into a room."""
        new = [b for b in np.flatnonzero(view.playing).tolist() if self.of[b] is None]
        is_grey = view.observation[:, self.positions : 2 * self.positions] == 1
        groups: dict[tuple[RoomSight, bool], list[int]] = {}
        for subject in new:
            sight = RoomSight(
                self.positions,
                int(is_grey[subject].sum()),
                int(view.console.solutions_left[subject]),
                int(view.console.actions_left[subject]),
            )
            groups.setdefault((sight, bool(self.unsure[subject])), []).append(subject)
        for (sight, unsure), members in groups.items():
            order = np.argsort(~is_grey[members], axis=1, kind="stable")
            space = self._space(sight, unsure)
            if sight.grey > FREE_FORM_LEVERS:
                for row, subject in enumerate(members):
                    self.of[subject] = self._sampled(subject, space, np.argsort(order[row]), {})
                continue
            weights = self._weights(space, np.array(members), order)
            for row, subject in enumerate(members):
                self.of[subject] = self._fresh(space, np.argsort(order[row]), weights[row])

    def _space(self, sight: RoomSight, unsure: bool) -> Space:
        how = self._unsure if unsure else self._certain
        return enumerated(sight, how, self.prior.simplicity, self.prior.hypothesis_limit)

    def _weights(self, space: Space, subjects: IntArray, order: IntArray) -> FloatArray:
        """``[len(subjects), H]`` prior probabilities of the hypotheses about a room."""
        known = self.knowledge
        places = np.take_along_axis(known.places(subjects), order, axis=1)
        noisy = len(space.strengths) > 1
        strength = known.strengths[subjects] if noisy else np.ones((len(subjects), 1))
        weights = space.prior(known.classes(subjects), known.rules[subjects], places, strength)
        if self.prior.directness:
            direct = np.bitwise_count(space.hypotheses.causes[:, -1])
            weights *= np.exp(self.prior.directness * direct)
        return weights

    def _fresh(self, space: Space, slots: IntArray, weight: FloatArray) -> Belief:
        which = np.flatnonzero(weight > 0)
        share = weight[which] / weight[which].sum()
        return Belief(space, slots, which, share, share if self.prior.forgetting else None)

    def _sampled(
        self, subject: int, space: Space, slots: IntArray, events: dict[Event, int]
    ) -> Belief:
        """A belief over what is enumerated and over draws from the free form's posterior.

        ``events`` is what was observed so far, and how often.
        """
        of_gates: Counter[Event] = Counter()
        for event, times in events.items():  # solutions say nothing about single gates
            of_gates[event._replace(new=False, found=())] += times
        prior, sight = self.prior, space.sight
        sampler = Sampler(sight.grey, prior.simplicity, space.strengths.typical, of_gates.items())
        drawn = sampled(sampler, sight, prior.particles, self._generators[subject], prior.effort)
        whole = with_sampled(space, drawn)
        weight = self._weights(whole, np.array([subject]), np.argsort(slots)[None])[0]
        fresh = self._fresh(whole, slots, weight)
        fresh.drawn = len(drawn)
        return fresh

    def leave(self, subject: int) -> None:
        """Update what is carried between rooms, and forget the room."""
        belief = self.left[subject] = self.of[subject]
        if belief is not None and belief.possible and len(belief.which):
            self.knowledge.absorb(subject, belief.space, belief.which, belief.weight, belief.slots)
        self.of[subject] = None

    # -- something is observed ------------------------------------------------------------------

    def update(self, step: Step) -> None:
        """Update the posteriors with what the subjects' actions led to."""
        subjects = informative(step)
        beliefs = [self._belief(subject) for subject in subjects.tolist()]
        slots = np.array([belief.slots for belief in beliefs], dtype=np.int64)
        slots = slots.reshape(-1, self.positions)
        events = observed(step, subjects, slots, [belief.found for belief in beliefs])
        spaces: dict[int, list[int]] = {}
        for row, belief in enumerate(beliefs):
            event = events.single(row, belief.found)
            belief.events[event] += 1
            if belief.start is not None:
                belief.attempt = (*belief.attempt, event)
            if belief.start is None or not belief.whole:
                spaces.setdefault(id(belief.space), []).append(row)
                continue
            weight = belief.weight * _likelihood_of_all(belief.space, event)
            if (total := weight.sum()) > 0:
                belief.weight = weight / total
            else:
                self._reconsider(int(subjects[row]))
        for rows in spaces.values():
            self._update(subjects[rows], events[np.array(rows)])
        for row in np.flatnonzero(events.new).tolist():
            belief = self._belief(subjects[row])
            belief.found = (*belief.found, int(events.pushed[row]))
        if self.prior.forgetting:
            for subject in np.flatnonzero(step.attempt_over & step.view.playing).tolist():
                keeps = bool(step.new_solution[subject]) and self.prior.forgets == "failures"
                self._belief(subject).forget(self.prior.forgetting, keeps)
        for subject in np.flatnonzero(step.trial_over & step.view.playing).tolist():
            self.leave(subject)

    def _belief(self, subject: int) -> Belief:
        belief = self.of[subject]
        assert belief is not None, "the subject is in no room"
        return belief

    def _update(self, subjects: IntArray, events: Events) -> None:
        """One event for each of some subjects that share a space."""
        beliefs = [self._belief(subject) for subject in subjects]
        sizes = [len(belief.which) for belief in beliefs]
        of = np.repeat(np.arange(len(subjects)), sizes)
        which = np.concatenate([belief.which for belief in beliefs])
        weight = np.concatenate([belief.weight for belief in beliefs])
        space = beliefs[0].space
        weight *= likelihood(space.hypotheses, which, space.strengths, events[of])
        total = np.bincount(of, weight, minlength=len(subjects))
        ends = np.cumsum([0, *sizes])
        for row, belief in enumerate(beliefs):
            own = slice(ends[row], ends[row + 1])
            if total[row] <= 0:
                self._reconsider(int(subjects[row]))
                continue
            share = weight[own] / total[row]
            if belief.start is None:
                kept = share > 0
                belief.which, belief.weight = which[own][kept], share[kept]
            else:
                belief.weight = share
            if belief.drawn > FEW_DRAWS and self._depleted(belief):
                fresh = self._rebuilt(int(subjects[row]))
                self.of[subjects[row]] = fresh if fresh.possible else belief

    # -- when too few hypotheses are left --------------------------------------------------------

    @staticmethod
    def _depleted(belief: Belief) -> bool:
        """Whether too few of the structures that were sampled are still possible."""
        first = belief.space.ends[-2] if len(belief.space.ends) > 1 else 0
        alive = int((belief.weight[belief.which >= first] > 0).sum())
        return alive < belief.drawn / 4

    def _reconsider(self, subject: int) -> None:
        """Sample other hypotheses, or conclude that levers may fail, when no hypothesis is left."""
        grey = self._belief(subject).space.sight.grey
        fresh = None
        if grey > FREE_FORM_LEVERS:
            # Where there are many levers, a sample without a fitting structure proves nothing.
            for _ in range(1 + (REDRAWS if grey > LISTED_CAUSES + 1 else 0)):
                fresh = fresh if fresh and fresh.possible else self._rebuilt(subject)
        if fresh is None or not fresh.possible:
            self.unsure[subject] = True
            fresh = self._rebuilt(subject)
        self.of[subject] = fresh

    def _rebuilt(self, subject: int) -> Belief:
        """The posterior over other hypotheses, given everything observed in this trial."""
        past = self._belief(subject)
        sight = past.space.sight
        space = self._space(sight, bool(self.unsure[subject]))
        if sight.grey > FREE_FORM_LEVERS:
            fresh = self._sampled(subject, space, past.slots, past.events)
        else:
            weight = self._weights(space, np.array([subject]), past.positions[None])[0]
            fresh = self._fresh(space, past.slots, weight)
        fresh.events, fresh.found = past.events, past.found
        fresh.attempt, fresh.kept = past.attempt, past.kept
        hypotheses, strengths_ = fresh.space.hypotheses, fresh.space.strengths
        with np.errstate(divide="ignore"):
            log_prob = np.log(fresh.weight)
            for event, times in past.events.items():
                chance = likelihood(hypotheses, fresh.which, strengths_, event)
                log_prob += times * np.log(chance)
        best = log_prob.max(initial=-np.inf)
        fresh.possible = bool(np.isfinite(best))
        if fresh.possible:
            weight = np.exp(log_prob - best)
            kept = weight > 0 if fresh.start is None else np.ones(len(weight), dtype=bool)
            fresh.which, fresh.weight = fresh.which[kept], weight[kept] / weight.sum()
            if fresh.start is not None:
                fresh.start = conditioned(fresh.space, fresh.which, fresh.start, fresh.kept)
        return fresh

    # -- checkpoints ----------------------------------------------------------------------------

    def state_dict(self) -> dict[str, Any]:
        """The whole state; of enumerated hypotheses only how to enumerate them."""
        return {
            "knowledge": self.knowledge.state_dict(),
            "unsure": self.unsure.copy(),
            "generators": [generator.bit_generator.state for generator in self._generators],
            "of": [None if belief is None else self._saved(belief) for belief in self.of],
        }

    @staticmethod
    def _saved(belief: Belief) -> dict[str, Any]:
        drawn = belief.space.blocks[-1].catalogue if belief.drawn else None
        return {
            "sight": tuple(belief.space.sight),
            "unsure": len(belief.space.strengths) > 1,
            "sampled": drawn and (drawn.members.causes, drawn.members.threshold, drawn.chance),
            **{name: getattr(belief, name) for name in SAVED},
            "events": [(tuple(event), times) for event, times in belief.events.items()],
            "attempt": tuple(map(tuple, belief.attempt)),
            "kept": tuple(map(tuple, belief.kept)),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a checkpoint."""
        self.knowledge.load_state_dict(state["knowledge"])
        self.unsure = state["unsure"].copy()
        for generator, saved in zip(self._generators, state["generators"], strict=True):
            generator.bit_generator.state = saved
        self.of = [None if saved is None else self._restored(saved) for saved in state["of"]]

    def _restored(self, saved: dict[str, Any]) -> Belief:
        space = self._space(RoomSight(*saved["sight"]), saved["unsure"])
        drawn = 0
        if saved["sampled"]:
            causes, threshold, chance = saved["sampled"]
            own = listed(Structures(causes, threshold), chance)
            space, drawn = with_sampled(space, own), len(own)
        return Belief(
            space,
            **{name: saved[name] for name in SAVED},
            drawn=drawn,
            events=Counter({Event(*event): times for event, times in saved["events"]}),
            attempt=tuple(Event(*event) for event in saved["attempt"]),
            kept=tuple(Event(*event) for event in saved["kept"]),
        )
