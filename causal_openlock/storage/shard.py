"""A shard: a fixed share of an experiment's cells, for a job of a batch system.

Which cells a shard has depends on the experiment alone. So it does not matter when the jobs of an
array start, and one that was killed is simply started again.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from causal_openlock.errors import OpenLockError

T = TypeVar("T")


@dataclass(frozen=True)
class Shard:
    """One of a number of shards, counted from 1.

    >>> Shard.parse("2/3").of("abcdefg")
    ('b', 'e')
    """

    number: int
    shards: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """A shard as users write it.

        Raises:
            OpenLockError: If it is none.
        """
        parts = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text.strip(), re.ASCII)
        if not parts or not 1 <= int(parts[1]) <= int(parts[2]):
            raise OpenLockError(f"{text!r} is not a shard; write 3/16 for the third of sixteen")
        return cls(int(parts[1]), int(parts[2]))

    def of(self, cells: Sequence[T]) -> tuple[T, ...]:
        """The shard's cells: some of each learner, since a learner's cells are listed together."""
        return tuple(cells[self.number - 1 :: self.shards])

    def __str__(self) -> str:
        """The shard as users write it."""
        return f"{self.number}/{self.shards}"
