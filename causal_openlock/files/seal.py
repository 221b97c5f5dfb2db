"""Seals: message authentication codes for what this user's own processes have written.

Some learners can only be saved as a pickle, and reading a pickle can run any program. So it gets a
seal, an HMAC-SHA256 with a secret key of this user, and is read only if the seal is right. The key
is 32 random bytes in a file that nobody else can read, made when it is first needed::

    $XDG_STATE_HOME/causal_openlock/seal.key     (by default under ~/.local/state)

``CAUSAL_OPENLOCK_STATE`` names another folder for it: on a cluster, one that all machines share.
If the key cannot be stored, a process uses one of its own, and its seals cannot be saved.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import stat
import tempfile
from functools import cache
from pathlib import Path

from causal_openlock.files.state import Transient

STATE = "CAUSAL_OPENLOCK_STATE"
"""The environment variable that names the folder of the key."""
SIZE = 32


def seal(content: bytes, kind: str) -> bytes:
    """The seal of content of some kind; other kinds have other seals.

    It is :class:`~causal_openlock.files.state.Transient` if the key cannot be stored.
    """
    key, fault = _key(os.environ.get(STATE, ""), os.environ.get("XDG_STATE_HOME", ""))
    made = hmac.digest(key, f"causal_openlock\0{kind}\0".encode() + content, hashlib.sha256)
    if fault:
        made = Transient(made)
        made.reason = fault
    return made


def is_sealed(content: object, made: object, kind: str) -> bool:
    """Whether this user has sealed the content."""
    if not isinstance(content, bytes) or not isinstance(made, bytes):
        return False
    return hmac.compare_digest(seal(content, kind), made)


@cache
def _key(own: str, state: str) -> tuple[bytes, str]:
    """The key; and, if it is of this process alone, the reason."""
    path = Path("seal.key")
    try:
        path = _place(own, state)
        if not path.exists():
            _make(path)
        return _read(path), ""
    except (OSError, RuntimeError, ValueError) as error:  # no home, no permission, no key
        reason = getattr(error, "strerror", None) or error
        fault = f"the key of its seal cannot be stored in {path}: {reason}; {STATE} names a folder"
        return secrets.token_bytes(SIZE), fault


def _place(own: str, state: str) -> Path:
    """The file of the key."""
    if own:
        return Path(own) / "seal.key"
    home = Path(state) if Path(state).is_absolute() else Path("~/.local/state").expanduser()
    return home / "causal_openlock" / "seal.key"


def _make(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".seal.", suffix=".partial")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(secrets.token_bytes(SIZE))
            file.flush()
            os.fsync(file.fileno())
        # If several processes start at once, the first makes the key for all.
        try:
            os.link(temporary, path)
        except FileExistsError:
            pass
        except OSError:  # a file system without links
            os.replace(temporary, path)  # noqa: PTH105
    finally:
        Path(temporary).unlink(missing_ok=True)


def _read(path: Path) -> bytes:
    with path.open("rb") as file:
        about = os.fstat(file.fileno())
        key = file.read(SIZE + 1)
    if not stat.S_ISREG(about.st_mode) or len(key) != SIZE:
        raise ValueError(f"it is not {SIZE} bytes; remove it")
    if os.name == "posix" and (about.st_mode & 0o077 or about.st_uid != os.getuid()):
        raise ValueError("others can read it; remove it")
    return key
