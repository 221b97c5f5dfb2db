"""The ideal observer in another subject's place: the worth of each attempt.

The observer knows the schema of the room, and that the grey levers are the active ones; which lever
is which it learns from what the subject does. So at every moment it has a posterior over
placements, and knows, by the dynamic programme of :mod:`causal_openlock.belief.optimal`, how many
attempts are still to be expected with the best play, V, and if an action is taken now and the best
play comes after it, Q. All of it is exact.

* **Regret** of an action is Q - V, in attempts: what it costs on average, whatever luck there was.
  The regrets of a trial and its luck add up to its attempts beyond V at its start, and, of a trial
  that was not solved, those that would still have been needed: V at its end. Luck is 0 on average,
  so mean regret is the mean of that.
* **Information** gained is the entropy of the posterior before an action less that after it.
* **Useless** is an action of which the observer knew that it would change nothing, or one that came
  when nothing in the rest of the attempt could help any more.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from math import log2
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.optimal import TIE, Optimum, Point
from causal_openlock.belief.placements import TooLargeError, placements
from causal_openlock.belief.structure_schemas import structure_of
from causal_openlock.belief.structures import Structures, merge
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout


class Worth(NamedTuple):
    """Worth of an attempt; all but ``used`` are sums over its actions."""

    used: int  #: how many actions it had
    regret: float  #: what the choices cost, in attempts
    gained: float  #: bits of information that were gained
    useless: int  #: how many actions were known to be useless


class Observer:
    """The ideal observer of rooms of one schema, whose levers move surely.

    Raises:
        TooLargeError: If the exact answer would take too long, now or when it is asked.

    Example:
        In a room of CC3 the lever that frees the others is pushed first, then another, then the
        door: as good as anything. The same again finds nothing.

        >>> from causal_openlock import find_schema
        >>> from causal_openlock.world.room import Layout
        >>> observer = Observer(find_schema("CC3"), 3)
        >>> worths = observer.trial(Layout((0, 1, 2)), [[0, 1, 14], [0, 1, 14]])
        >>> [(round(worth.regret, 2), round(worth.gained, 2)) for worth in worths]
        [(0.0, 1.58), (1.0, 0.0)]
    """

    def __init__(self, schema: Schema, action_limit: int) -> None:
        self.schema, self._limit = schema, action_limit
        own = placements(schema, action_limit)
        self._placed = own.structures
        self._optimum = Optimum(own, np.ones(len(own)), action_limit)
        self._optimum.attempts()
        self._choice, self._truth = cache(self._judged), cache(self._hypothesis)
        self._attempt, self._room_slots = cache(self._followed), cache(self._slots)

    def trial(self, layout: Layout, attempts: Sequence[Sequence[int]]) -> list[Worth]:
        """Worth of each attempt of a trial, until everything is found.

        Args:
            layout: Where the levers are.
            attempts: The actions of each attempt, by index in the room.
        """
        slots = self._room_slots(layout)
        truth, point, worths = self._truth(layout.places), self._optimum.start, []
        for actions in attempts:
            if len(point.found) == len(self.schema.solutions):
                break
            worth, point = self._attempt(truth, point, tuple([slots[action] for action in actions]))
            worths.append(worth)
        return worths

    def _followed(self, truth: int, point: Point, actions: tuple[int, ...]) -> tuple[Worth, Point]:
        """The worth of an attempt, and the state that it leaves."""
        regret, gained, useless = 0.0, 0.0, 0
        for action in actions:
            cost, idle, outcomes = self._choice(point, action)
            after = next(outcome for outcome in outcomes if outcome.possible & truth)
            # Placements are equally probable.
            gained += log2(point.possible.bit_count() / after.possible.bit_count())
            regret, useless, point = regret + cost, useless + idle, after
        left = point._replace(pushed=0, left=self._limit)
        return Worth(len(actions), regret, gained, useless), left

    def _slots(self, layout: Layout) -> list[int]:
        """The observer's action for each of the room's; -1 for those on levers that never move."""
        levers, positions = len(layout.places), layout.positions
        slot = {place: number for number, place in enumerate(sorted(layout.places))}
        pushes = [slot.get(place, -1) for place in range(positions)]
        pulls = [-1 if one < 0 else levers + one for one in pushes]
        return [*pushes, *pulls, 2 * levers]

    def _hypothesis(self, places: tuple[int, ...]) -> int:
        """The hypothesis that is true of a layout, as a bit."""
        order = np.argsort(np.argsort(places))
        own = structure_of(self.schema).on_slots(order, len(places))
        both = Structures.joined([self._placed, own])
        _, group = merge(both.behaviour(self._limit))
        return 1 << int(np.flatnonzero(group[:-1] == group[-1])[0])

    def _judged(self, point: Point, action: int) -> tuple[float, bool, list[Point]]:
        """An action's regret, whether it is useless, and what may come of it."""
        optimum = self._optimum
        value, outcomes = optimum.value(point), optimum.after(point, action)
        regret = sum(share * optimum.value(one) for share, one in outcomes) - value
        then = [one for _, one in outcomes]
        same = [(one.possible, one.found) == point[:2] for one in then]
        idle = all(same) and all(one.pushed == point.pushed or not one.left for one in then)
        lost = optimum.value(point._replace(left=0)) - value < TIE
        return regret if regret > TIE else 0.0, idle or lost, then


@lru_cache(maxsize=64)
def observer_of(schema: Schema, action_limit: int) -> Observer | None:
    """The observer of a schema's rooms; None where the exact answer is out of reach."""
    if not schema.deterministic or action_limit < schema.least_action_limit:
        return None
    try:
        return Observer(schema, action_limit)
    except TooLargeError:
        return None
