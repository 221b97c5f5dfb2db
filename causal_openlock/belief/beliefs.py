"""The beliefs of many subjects at once, each about the room that it is in.

Each subject holds its hypotheses and their probabilities; what is ruled out is dropped. An update
takes the pairs of all subjects whose rooms look alike, one flat array of (subject, hypothesis)
pairs, and multiplies each pair's probability by the likelihood of what its subject saw.

A world without noise rules hypotheses out for good. A subject starts in such a world unless it is
told to expect noise, and once every hypothesis is ruled out it concludes that levers may fail to
move: it takes the trial's events up again with strengths that are unknown. That is Bayesian
inference in the limit of a vanishing prior probability of noise.
"""

from __future__ import annotations

from collections import Counter
from functools import lru_cache
from typing import Any

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS
from causal_openlock.belief.evidence import DOOR, Event, likelihood
from causal_openlock.belief.knowledge import Knowledge, rule_prior
from causal_openlock.belief.one_belief import Belief as Belief
from causal_openlock.belief.prior import Prior
from causal_openlock.belief.recall import evidence, evidence_of_all, in_mind
from causal_openlock.belief.sampling import (
    LISTED_CAUSES,
    Happened,
    Sampler,
    listed,
    sampled,
    with_sampled,
)
from causal_openlock.belief.space import RoomSight, Space, enumerate_space
from causal_openlock.belief.strength import strengths
from causal_openlock.belief.structures import Structures
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

enumerated = lru_cache(maxsize=64)(enumerate_space)
STRENGTH_NODES = 10
SECOND_THOUGHTS = 2
"""How often a subject draws again before it believes that the levers of a large room may fail."""
FEW = 40
"""So few draws are all that there is to draw; drawing again would bring the same."""


class Beliefs:
    """The beliefs of B subjects.

    Args:
        brief: Sizes of the rooms.
        prior: What they believe before they see a room.
        generators: One for each subject, for hypotheses that are sampled.
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
        """Take up the rooms of subjects that have just come into one."""
        new = [b for b in np.flatnonzero(view.playing).tolist() if self.of[b] is None]
        groups: dict[tuple[RoomSight, bool], list[int]] = {}
        for subject in new:
            grey = view.observation[subject, self.positions : 2 * self.positions] == 1
            sight = RoomSight(
                self.positions,
                int(grey.sum()),
                int(view.console.solutions_left[subject]),
                int(view.console.actions_left[subject]),
            )
            groups.setdefault((sight, bool(self.unsure[subject])), []).append(subject)
        for (sight, unsure), members in groups.items():
            who = np.array(members)
            grey = view.observation[who, self.positions : 2 * self.positions] == 1
            order = np.argsort(~grey, axis=1, kind="stable")
            space = self._space(sight, unsure)
            if sight.grey > FREE_FORM_LEVERS:
                for row, subject in enumerate(members):
                    self.of[subject] = self._sampled(subject, space, np.argsort(order[row]))
                continue
            weights = self._weights(space, who, order)
            for row, subject in enumerate(members):
                self.of[subject] = self._fresh(space, np.argsort(order[row]), weights[row])

    def _space(self, sight: RoomSight, unsure: bool) -> Space:
        how = self._unsure if unsure else self._certain
        return enumerated(sight, how, self.prior.simplicity, self.prior.hypothesis_limit)

    def _weights(self, space: Space, who: IntArray, order: IntArray) -> FloatArray:
        """``[len(who), H]`` what subjects believe of a room before they try anything."""
        known = self.knowledge
        places = np.take_along_axis(known.places(who), order, axis=1)
        surely = known.strengths[who] if len(space.strengths) > 1 else np.ones((len(who), 1))
        weights = space.prior(known.classes(who), known.rules[who], places, surely)
        if self.prior.directness:
            direct = np.bitwise_count(space.hypotheses.causes[:, -1])
            weights *= np.exp(self.prior.directness * direct)
        return weights

    def _fresh(self, space: Space, slots: IntArray, weight: FloatArray) -> Belief:
        which = np.flatnonzero(weight > 0)
        share = weight[which] / weight[which].sum()
        return Belief(space, slots, which, share, share if self.prior.forgetting else None)

    def _sampled(
        self, subject: int, space: Space, slots: IntArray, past: Belief | None = None
    ) -> Belief:
        """A belief over what is enumerated and over draws from the free form's posterior.

        Args:
            subject: Whose belief it is.
            space: What is enumerated.
            slots: ``[P]`` the slot of each position.
            past: What happened so far.
        """
        happened: Counter[Happened] = Counter()
        for (*one, _, _), times in (past.events if past else Counter()).items():
            happened[tuple(one)] += times
        sampler = Sampler(
            space.sight.grey,
            self.prior.simplicity,
            space.strengths.typical,
            happened.items(),
        )
        own = sampled(
            sampler,
            space.sight,
            self.prior.particles,
            self._generators[subject],
            self.prior.effort,
        )
        whole = with_sampled(space, own)
        weight = self._weights(whole, np.array([subject]), np.argsort(slots)[None])[0]
        fresh = self._fresh(whole, slots, weight)
        fresh.drawn = len(own)
        return fresh

    def leave(self, subject: int) -> None:
        """Keep what a room has taught, and forget the room."""
        belief = self.of[subject]
        if belief is not None and belief.possible and len(belief.which):
            self.knowledge.absorb(subject, belief.space, belief.which, belief.weight, belief.slots)
        self.of[subject] = None

    # -- something happens ----------------------------------------------------------------------

    def update(self, step: Step) -> None:
        """Take in what the subjects' actions led to."""
        who, events = self._events(step)
        spaces: dict[int, list[int]] = {}
        for row, subject in enumerate(who):
            belief = self._belief(subject)
            happened = (*(int(value[row]) for value in events[:-1]), belief.found)
            belief.events[happened] += 1
            if belief.start is not None:
                belief.attempt = (*belief.attempt, happened)
            spaces.setdefault(id(belief.space), []).append(row)
        for rows in spaces.values():
            self._update(who[rows], events.take(np.array(rows)))
        for row, subject in enumerate(who):
            if events.new[row]:
                belief = self._belief(subject)
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

    def _events(self, step: Step) -> tuple[IntArray, Event]:
        """The actions that could have done something, and what came of them."""
        seen, outcome = step.view.observation, step.outcome
        positions = self.positions
        door = step.action == 2 * positions
        lever = step.action % positions
        everyone = np.arange(len(step.action))
        is_pushed = seen[everyone, lever] == 1
        pulls = step.action >= positions
        tells = np.where(door, seen[:, -2] == 0, pulls == is_pushed)
        who = np.flatnonzero(step.view.playing & tells)
        slots = np.array([self._belief(b).slots for b in who.tolist()], dtype=np.int64)
        slots = slots.reshape(-1, positions)
        masks = (seen[who, :positions].astype(np.int64) << slots).sum(axis=1)
        found = [self._belief(b).found for b in who.tolist()]
        padded = np.zeros((len(who), max(map(len, found), default=0)), dtype=np.uint16)
        for row, sets in enumerate(found):
            padded[row, : len(sets)] = sets
        of_lever = slots[np.arange(len(who)), lever[who]]
        moved = seen[who, lever[who]] != outcome[who, lever[who]]
        return who, Event(
            slot=np.where(door[who], DOOR, of_lever),
            pushed=masks.astype(np.uint16),
            took_effect=np.where(door[who], outcome[who, -1] == 1, moved),
            unlocked=outcome[who, -2] == 0,
            new=step.new_solution[who],
            found=padded,
        )

    def _update(self, who: IntArray, event: Event) -> None:
        """One event for each of some subjects that share a space."""
        beliefs = [self._belief(subject) for subject in who]
        # Who forgets rules nothing out, and asks the same of the same hypotheses again and again.
        whole = [belief.start is not None and belief.whole for belief in beliefs]
        for row in np.flatnonzero(whole).tolist():
            belief = beliefs[row]
            seen = (*(int(value[row]) for value in event[:-1]), belief.found)
            weight = belief.weight * evidence_of_all(belief.space, seen)
            if (all_ := weight.sum()) > 0:
                belief.weight = weight / all_
            else:
                self._reconsider(int(who[row]))
        if any(whole):
            rest = np.flatnonzero(~np.array(whole))
            if len(rest):
                self._update(who[rest], event.take(rest))
            return
        sizes = [len(belief.which) for belief in beliefs]
        of = np.repeat(np.arange(len(who)), sizes)
        which = np.concatenate([belief.which for belief in beliefs])
        weight = np.concatenate([belief.weight for belief in beliefs])
        space = beliefs[0].space
        weight *= likelihood(space.hypotheses, which, space.strengths, event.take(of))
        total = np.bincount(of, weight, minlength=len(who))
        ends = np.cumsum([0, *sizes])
        for row, belief in enumerate(beliefs):
            own = slice(ends[row], ends[row + 1])
            if total[row] <= 0:
                self._reconsider(int(who[row]))
                continue
            share = weight[own] / total[row]
            if belief.start is None:
                kept = share > 0
                belief.which, belief.weight = which[own][kept], share[kept]
            else:
                belief.weight = share
            if belief.drawn > FEW and self._depleted(belief):
                fresh = self._again(int(who[row]), belief.space.sight)
                self.of[who[row]] = fresh if fresh.possible else belief

    # -- when too little is possible any more ---------------------------------------------------

    @staticmethod
    def _depleted(belief: Belief) -> bool:
        """Whether of the structures that were drawn too few are still possible."""
        first = belief.space.ends[-2] if len(belief.space.ends) > 1 else 0
        alive = int((belief.weight[belief.which >= first] > 0).sum())
        return alive < belief.drawn / 4

    def _reconsider(self, subject: int) -> None:
        """Every hypothesis is ruled out: draw others, or believe that levers may fail to move."""
        belief = self._belief(subject)
        sight = belief.space.sight
        fresh = None
        if sight.grey > FREE_FORM_LEVERS:
            fresh = self._again(subject, sight)
            # That of many levers nothing was found is no proof that there is nothing.
            for _ in range(SECOND_THOUGHTS if sight.grey > LISTED_CAUSES + 1 else 0):
                fresh = fresh if fresh.possible else self._again(subject, sight)
        if fresh is None or not fresh.possible:
            self.unsure[subject] = True
            fresh = self._again(subject, belief.space.sight)
        self.of[subject] = fresh

    def _again(self, subject: int, sight: RoomSight) -> Belief:
        """What to believe of the room, had it been seen with other hypotheses from the start.

        Nothing that happened in the trial is forgotten in this.
        """
        past = self._belief(subject)
        space = self._space(sight, bool(self.unsure[subject]))
        if sight.grey > FREE_FORM_LEVERS:
            fresh = self._sampled(subject, space, past.slots, past)
        else:
            weight = self._weights(space, np.array([subject]), past.positions[None])[0]
            fresh = self._fresh(space, past.slots, weight)
        fresh.events, fresh.found = past.events, past.found
        fresh.attempt, fresh.kept = past.attempt, past.kept
        with np.errstate(divide="ignore"):
            log = np.log(fresh.weight)
            for seen, times in past.events.items():
                log += times * np.log(evidence(fresh.space, fresh.which, seen))
        best = log.max(initial=-np.inf)
        fresh.possible = bool(np.isfinite(best))
        if fresh.possible:
            weight = np.exp(log - best)
            kept = weight > 0 if fresh.start is None else np.ones(len(weight), dtype=bool)
            fresh.which, fresh.weight = fresh.which[kept], weight[kept] / weight.sum()
            if fresh.start is not None:
                fresh.start = in_mind(fresh.space, fresh.which, fresh.start, fresh.kept)
        return fresh

    # -- checkpoints ----------------------------------------------------------------------------

    def state_dict(self) -> dict[str, Any]:
        """All of it, for a checkpoint; enumerated hypotheses are named and not copied."""
        return {
            "knowledge": self.knowledge.state_dict(),
            "unsure": self.unsure.copy(),
            "generators": [generator.bit_generator.state for generator in self._generators],
            "of": [None if belief is None else self._kept(belief) for belief in self.of],
        }

    @staticmethod
    def _kept(belief: Belief) -> dict[str, Any]:
        own = belief.space.blocks[-1].catalogue if belief.drawn else None
        return {
            "sight": tuple(belief.space.sight),
            "unsure": len(belief.space.strengths) > 1,
            "sampled": own and (own.members.causes, own.members.threshold, own.chance),
            "slots": belief.slots.copy(),
            "which": belief.which.copy(),
            "weight": belief.weight.copy(),
            "start": None if belief.start is None else belief.start.copy(),
            "found": belief.found,
            "possible": belief.possible,
            "events": list(belief.events.items()),
            "attempt": belief.attempt,
            "kept": belief.kept,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.knowledge.load_state_dict(state["knowledge"])
        self.unsure = state["unsure"].copy()
        for generator, saved in zip(self._generators, state["generators"], strict=True):
            generator.bit_generator.state = saved
        for subject, kept in enumerate(state["of"]):
            self.of[subject] = None if kept is None else self._restored(kept)

    def _restored(self, kept: dict[str, Any]) -> Belief:
        space = self._space(RoomSight(*kept["sight"]), kept["unsure"])
        drawn = 0
        if kept["sampled"]:
            causes, threshold, chance = kept["sampled"]
            own = listed(Structures(causes, threshold), chance)
            space, drawn = with_sampled(space, own), len(own)
        return Belief(
            space,
            kept["slots"].copy(),
            kept["which"].copy(),
            kept["weight"].copy(),
            None if kept["start"] is None else kept["start"].copy(),
            kept["found"],
            drawn,
            kept["possible"],
            Counter(dict(kept["events"])),
            kept["attempt"],
            kept["kept"],
        )
