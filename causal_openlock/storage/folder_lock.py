"""The lock on a results folder: one comparison at a time works in it, or several shards of one.

The operating system releases a lock when its process ends, however that happens. Shards of one
experiment share the lock, and each has one of its own; what only one may do, such as to tidy up, is
done by the first of them. A file system without locks does no harm to results, since a cell's file
is the same whichever process writes it.
"""

from __future__ import annotations

import errno
import time
from pathlib import Path
from typing import IO

from causal_openlock.errors import StoreError
from causal_openlock.storage.shard import Shard

LOCK = ".lock"
PATIENCE = 30.0
"""Seconds that a shard waits while another one prepares the folder."""


class FolderLock:
    """The locks that this process holds on a folder.

    Args:
        folder: The folder, which has to exist when a lock is taken.
        what: What works there, in a word.
    """

    def __init__(self, folder: Path, what: str = "comparison") -> None:
        self.folder, self._what = folder, what
        self._held: list[IO[bytes]] = []

    def take(self, shard: Shard | None) -> bool:
        """Lock the folder; returns whether no other process uses it, so that it can be prepared.

        Raises:
            StoreError: If another process uses it, unless both are shards.
        """
        if shard is not None:
            mine = f"{LOCK}-{shard.number}-of-{shard.shards}"
            if self._taken(mine) is False:
                raise StoreError(
                    f"the shard {shard} is being played in {self.folder} already; wait for it"
                )
        patience = time.monotonic() + (PATIENCE if shard else 0.0)
        while True:
            alone = self._taken(LOCK)
            if alone is not False:
                return shard is None if alone is None else True
            if shard is not None and self._taken(LOCK, shared=True):
                return False
            if time.monotonic() >= patience:
                raise StoreError(
                    f"{self.folder} is in use by another {self._what}; wait for it, or choose "
                    "another folder"
                )
            time.sleep(0.1)

    def share(self, shard: Shard | None) -> None:
        """Also let other shards work in the folder."""
        if shard is not None and len(self._held) == 2:
            self._held.pop().close()
            while self._taken(LOCK, shared=True) is False:  # another one tidies up
                time.sleep(0.1)

    def release(self) -> None:
        """Release all locks."""
        for lock in self._held:
            lock.close()
        self._held = []

    def _taken(self, name: str, *, shared: bool = False) -> bool | None:
        """Try to take a lock; False if another process has it, None if locks are unsupported."""
        try:
            import fcntl
        except ImportError:  # a system without such locks
            return None
        lock = (self.folder / name).open("a+b")  # a shared lock needs a file that can be read
        try:
            fcntl.flock(lock, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
        except OSError as error:
            lock.close()
            if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                return False
            if error.errno in (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK):
                return None  # a file system without locks
            raise
        self._held.append(lock)
        return True
