"""The lock on a results folder: one comparison at a time works in it, or several shards of one.

The operating system releases a lock when its process ends, however that happens. A file system
without locks does no harm to results: a cell's file is the same whichever process writes it.
"""

from __future__ import annotations

import errno
from pathlib import Path

from filelock import BaseFileLock, FileLock, Timeout

from causal_openlock.errors import StoreError
from causal_openlock.storage.shard import Shard

LOCK = ".lock"
PATIENCE = 10.0
"""Seconds that a shard waits for the folder's lock, which each shard takes for a moment."""


class FolderLock:
    """The locks that this process holds on a folder.

    Args:
        folder: The folder, which has to exist when a lock is taken.
        what: What works there, in a word.
    """

    def __init__(self, folder: Path, what: str = "comparison") -> None:
        self.folder, self._what = folder, what
        self._locks: list[BaseFileLock] = []

    def take(self, shard: Shard | None = None) -> None:
        """Lock the folder and all shards in it, or one shard while nobody has locked the folder.

        Raises:
            StoreError: If another process works there.
        """
        if shard is None:
            names = [LOCK, *(path.name for path in self.folder.glob(f"{LOCK}-*"))]
        else:
            names = [f"{LOCK}-{shard.number}-of-{shard.shards}", LOCK]
        for name in names:
            patience = PATIENCE if shard and name == LOCK else 0.0
            self._locks.append(FileLock(self.folder / name, patience, thread_local=False))
            try:
                self._locks[-1].acquire()
            except Timeout:
                self.release()
                raise StoreError(
                    f"{self.folder} is in use by another {self._what}; wait for it, or choose "
                    "another folder"
                ) from None
            except OSError as error:
                if error.errno not in (errno.ENOSYS, errno.EOPNOTSUPP, errno.ENOLCK):
                    raise
        if shard is not None:
            self._locks.pop().release()

    def release(self) -> None:
        """Release all locks."""
        while self._locks:
            self._locks.pop().release()
