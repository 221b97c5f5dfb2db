"""The posteriors of many subjects at once, each about the room that it is in.

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
from functools import lru_cache
from typing import Any

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS
from causal_openlock.belief.evidence import Event, Events, informative, likelihood, observed
from causal_openlock.belief.hypotheses import RoomSight, Space, enumerate_space
from causal_openlock.belief.knowledge import Knowledge, rule_prior
from causal_openlock.belief.posterior import Belief, conditioned, likelihood_of_all
from causal_openlock.belief.prior import Prior
from causal_openlock.belief.sampling import (
    LISTED_CAUSES,
    Sampler,
    listed,
    sampled,
    with_sampled,
)
from causal_openlock.belief.strength import strengths
from causal_openlock.belief.structures import Structures
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

enumerated = lru_cache(maxsize=64)(enumerate_space)
STRENGTH_NODES = 10
REDRAWS = 2
"""How often a subject samples again before it concludes that levers of a large room may fail."""
FEW_DRAWS = 40
"""So few draws are every structure that there is to draw; sampling again would find the same."""
SAVED = ("slots", "which", "weight", "start", "found", "possible")
"""Fields of a belief that a checkpoint holds as they are; none of them is changed in place."""


class Beliefs:
    """The beliefs of B subjects.

    Args:
        brief: Sizes of the rooms.
        prior: What they believe before they see a room.
        generators: One for each subject, for hypotheses that are sampled.

    Attributes:
        of: The posterior of each subject; None while it is in no room.
        knowledge: What each subject carries from room to room.
        unsure: ``[B]`` whether the subject believes that levers may fail to move.

    Example:
        A subject enters a room with the levers of CC3.

        >>> from causal_openlock import PROTOCOLS, Condition, Session, find_schema
        >>> session = Session(Condition.named("CC3", find_schema), PROTOCOLS["human"], 1)
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
        self.knowledge = Knowledge(
            brief.subjects,
            brief.positions,
            concentration=prior.concentration,
            simplicity=prior.simplicity,
            free_form=prior.free_form,
            rules=rule_prior(prior.by_colour, prior.by_white),
            strengths=self._unsure,
        )
        self.of: list[Belief | None] = [None] * brief.subjects

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

        Args:
            subject: Whose belief it is.
            space: What is enumerated.
            slots: ``[P]`` the slot of each position.
            events: What was observed so far, and how often.
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
        belief = self.of[subject]
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
            weight = belief.weight * likelihood_of_all(belief.space, event)
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
        """No hypothesis is left: sample others, or conclude that levers may fail to move."""
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
        """All of it, for a checkpoint; of enumerated hypotheses only how to enumerate them."""
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
        """Go on from a checkpoint."""
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
