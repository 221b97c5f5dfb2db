"""Seals: message authentication codes for what this user's own processes have written.

A checkpoint is a pickle, and reading a pickle can run any program. So it begins with a seal, an
HMAC-SHA256 with a secret key of this user, and is read only if the seal is right. The key is 32
random bytes in ``~/.local/state/causal_openlock/seal.key`` (or under ``XDG_STATE_HOME``), made when
it is first needed; on a cluster, ``CAUSAL_OPENLOCK_STATE`` names a folder that all machines share.
"""

from __future__ import annotations

import hmac
import os
import secrets
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from causal_openlock.errors import OpenLockError

STATE, SIZE = "CAUSAL_OPENLOCK_STATE", 32


class SealError(OpenLockError):
    """Content without the seal of this user, or a key that cannot be stored."""


def sealed(content: bytes) -> bytes:
    """Content after its seal; raises SealError if the key cannot be stored."""
    return hmac.digest(_key(), content, "sha256") + content


def unsealed(content: bytes) -> bytes:
    """What :func:`sealed` was given; raises SealError if this user has not sealed it."""
    seal, content = content[:SIZE], content[SIZE:]
    if not hmac.compare_digest(hmac.digest(_key(), content, "sha256"), seal):
        raise SealError("it is damaged, or was not written by this user on this machine")
    return content


def _key() -> bytes:
    path = Path("seal.key")
    try:
        home = Path(os.environ.get("XDG_STATE_HOME") or "~/.local/state").expanduser()
        path = Path(os.environ.get(STATE) or home / "causal_openlock") / "seal.key"
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with TemporaryDirectory(dir=path.parent) as folder, suppress(FileExistsError):
                new = Path(folder, path.name)
                new.touch(mode=0o600)
                new.write_bytes(secrets.token_bytes(SIZE))
                os.link(new, path)  # of processes that start at once, the first makes the key
        about, key = path.stat(), path.read_bytes()
        shared = os.name == "posix" and (about.st_mode & 0o077 or about.st_uid != os.getuid())
        if shared or len(key) != SIZE:
            raise OSError(f"it is not {SIZE} bytes that this user alone can read; remove it")
        return key
    except (OSError, RuntimeError) as error:  # RuntimeError: there is no home
        why = getattr(error, "strerror", None) or error
        raise SealError(f"its key cannot be stored in {path} ({why}); set {STATE}") from None
