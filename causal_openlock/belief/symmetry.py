"""Symmetries of a belief: which levers it cannot distinguish, and a canonical naming of levers.

Sets of hypotheses are integers here, a bit each, so that a search can compare and split thousands
of them quickly.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from causal_openlock.belief.hypotheses import Hypotheses
from causal_openlock.world.fsm import BoolArray, FloatArray


class Symmetry:
    """The symmetries of a belief.

    Args:
        own: ``[H]`` every hypothesis, each once.
        share: ``[H]`` their probabilities.
    """

    def __init__(self, own: Hypotheses, share: FloatArray) -> None:
        self._slots, self._many = own.causes.shape[1] - 1, len(own)
        rows = {self._row(own, index): index for index in range(self._many)}
        self._swap = np.full((self._slots, self._slots, self._many), self._many)
        for first, second in combinations(range(self._slots), 2):
            order = np.arange(self._slots)
            order[[first, second]] = second, first
            image = own.on_slots(order.tolist(), self._slots)
            for index in range(self._many):
                to = rows.get(self._row(image, index), self._many)
                if to < self._many and share[to] == share[index]:
                    self._swap[first, second, index] = self._swap[second, first, index] = to
        whole: BoolArray = np.logical_and.reduce(self._swap < self._many, axis=2)
        # Classes of slots that can be renamed, as the hypotheses together do not distinguish them.
        self._class = [min([s, *np.flatnonzero(whole[s]).tolist()]) for s in range(self._slots)]
        solves = (own.solutions[:, None] >> np.arange(self._slots)[:, None] & 1).sum(axis=2)
        levers, door = own.causes[:, : self._slots], own.causes[:, self._slots, None]
        opens = door >> np.arange(self._slots) & 1
        threshold = own.threshold[:, : self._slots]
        # What distinguishes levers, [features, H, slots].
        self._features = np.stack([threshold, np.bitwise_count(levers), opens, solves])
        self._known: dict[int, BoolArray] = {}
        self._canonical: dict[tuple[int, tuple[int, ...]], tuple[int, tuple[int, ...]]] = {}

    def _row(self, own: Hypotheses, index: int) -> bytes:
        solutions = np.sort(own.solutions[index])
        return b"".join(
            part.tobytes()
            for part in (own.causes[index], own.threshold[index], own.inert[index], solutions)
        )

    def swappable(self, possible: int, first: int, second: int) -> bool:
        """Whether swapping these levers maps the possible hypotheses onto themselves."""
        if possible not in self._known:
            held = np.append(_flags(possible, self._many), False)
            alike = np.equal(held[self._swap], held[: self._many])
            self._known[possible] = np.logical_and.reduce(alike, axis=2)
        known: BoolArray = self._known[possible]
        return bool(known[first, second])

    def canonical(self, possible: int, found: tuple[int, ...]) -> tuple[int, tuple[int, ...]]:
        """The same state with levers renamed in the order of what is believed about them."""
        key = (possible, found)
        if key not in self._canonical:
            held = _flags(possible, self._many)
            marks = self._features[:, held].sum(axis=1)
            order = sorted(
                range(self._slots),
                key=lambda slot: (
                    self._class[slot],
                    sum(mask >> slot & 1 for mask in found),
                    *marks[:, slot].tolist(),
                ),
            )
            # Levers exchange names within their class, one swap after another.
            image_of, at = np.flatnonzero(held), list(range(self._slots))
            names = sorted(range(self._slots), key=lambda slot: (self._class[slot], slot))
            for slot, lever in zip(names, order, strict=True):
                if (now := at.index(lever)) != slot:
                    image_of = self._swap[slot, now, image_of]
                    found = tuple(sorted(swapped(mask, slot, now) for mask in found))
                    at[slot], at[now] = at[now], at[slot]
            image = np.zeros(self._many, dtype=bool)
            image[image_of] = True
            self._canonical[key] = (bits(image), found)
        return self._canonical[key]


def bits(flags: BoolArray) -> int:
    """A set of hypotheses, ``[H]`` whether each is in it, as a bit mask."""
    return int.from_bytes(np.packbits(flags, bitorder="little").tobytes(), "little")


def _flags(mask: int, many: int) -> BoolArray:
    data = np.frombuffer(mask.to_bytes((many + 7) // 8, "little"), dtype=np.uint8)
    flags: BoolArray = np.unpackbits(data, count=many, bitorder="little").astype(bool)
    return flags


def swapped(mask: int, first: int, second: int) -> int:
    """A set of slots with two of them swapped."""
    if (mask >> first ^ mask >> second) & 1:
        mask ^= 1 << first | 1 << second
    return mask
