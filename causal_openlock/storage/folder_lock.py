"""Locks on a results folder: one comparison at a time works in it, or several shards of one.

The operating system releases a lock when its process ends. A file system without locks does no harm
to results: a cell's file is the same whichever process writes it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from filelock import FileLock, Timeout

from causal_openlock.errors import OpenLockError, StoreError

T = TypeVar("T")

LOCK = ".lock"


@dataclass(frozen=True)
class Shard:
    """A fixed share of an experiment's cells, for a job of a batch system; counted from 1.

    Which cells it has depends on the experiment alone: a job that was killed is started again.

    >>> Shard.parse("2/3").of("abcdefg")
    ('b', 'e')
    """

    number: int
    shards: int

    @classmethod
    def parse(cls, text: str) -> Shard:
        """A shard as users write it; raises OpenLockError if it is none."""
        parts = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text.strip(), re.ASCII)
        if not parts or not 1 <= int(parts[1]) <= int(parts[2]):
            raise OpenLockError(f"{text!r} is not a shard; write 3/16 for the third of sixteen")
        return cls(int(parts[1]), int(parts[2]))

    def of(self, cells: Sequence[T]) -> tuple[T, ...]:
        """The shard's cells: some of each learner, since a learner's cells are listed together."""
        return tuple(cells[self.number - 1 :: self.shards])


@contextmanager
def locked(
    folder: Path, what: str = "comparison, play or serve", shard: Shard | None = None
) -> Iterator[None]:
    """A block in which nothing else works in a folder that exists, or plays the same shard.

    Raises:
        StoreError: If another process works there.
    """
    names = [LOCK, *(path.name for path in folder.glob(f"{LOCK}-*"))]
    if shard:
        names = [f"{LOCK}-{shard.number}-of-{shard.shards}"]
    with ExitStack() as locks:
        for name in names:
            try:
                locks.enter_context(FileLock(folder / name, timeout=0, thread_local=False))
            except Timeout:
                raise StoreError(
                    f"{folder} is in use by another {what}; wait for it, stop it, or choose "
                    "another folder"
                ) from None
            except (OSError, NotImplementedError):  # such as a file system without locks
                continue
        yield
