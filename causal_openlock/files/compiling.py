"""Compiling loops with numba: one way for all of them, with a cache that is checked.

What is compiled is kept on disk, next to the code or in the user's cache folder, so that it is
compiled once for an installation. The file may be cut off or overwritten: it is kept with a digest,
and what does not match is dropped and compiled anew. Where no folder can be written to, everything
is compiled in every process, and :func:`without_cache` says so.
"""

from __future__ import annotations

import hashlib
import multiprocessing
import pickle
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any, TypeVar, cast

Compiled = TypeVar("Compiled", bound=Callable[..., Any])

_SLOW = (
    "there is no folder for what numba compiles, so every process compiles it again, which takes "
    "up to a minute; set the environment variable NUMBA_CACHE_DIR to a folder that you can write to"
)
_said: list[str] = []


def compiled(function: Compiled, **options: Any) -> Compiled:
    """Compile at the first call, once for each installation.

    ``error_model="numpy"`` divides as NumPy does: a check for zero would keep loops from being
    vectorised.

    Args:
        function: The function.
        options: Other options of ``numba.njit``.
    """
    import numba  # takes a while to load

    made = numba.njit(error_model="numpy", **options)(function)
    try:
        made._cache = _checked_cache()(function)
    except RuntimeError:  # numba finds no folder that can be written to
        if not _said:
            _said.append(_SLOW)
            if multiprocessing.parent_process() is None:  # a worker's run says it, once for all
                warnings.warn(_SLOW, stacklevel=2)
    return cast(Compiled, made)


def direct(function: Compiled, *arguments: Any) -> Compiled:
    """Return the machine code of a compiled function for arguments like these.

    Numba looks up the type of every argument at every call, half the time of a call with two dozen
    arrays. Nobody looks here: each array has to be of the same type, contiguous and writeable.

    Args:
        function: What :func:`compiled` gave.
        arguments: Arguments with which it is called once, so that there is machine code.
    """
    import numba  # takes a while to load

    function(*arguments)
    versions: Any = function
    return cast(Compiled, versions.overloads[tuple(map(numba.typeof, arguments))].entry_point)


def without_cache() -> list[str]:
    """A sentence if this process compiles code that it cannot store."""
    return [*_said]


@cache
def _checked_cache() -> Any:
    """Numba's cache of a function, which recompiles what it cannot load."""
    from numba.core.caching import CompileResultCacheImpl, FunctionCache
    from numba.core.serialize import dumps

    class Sealed(CompileResultCacheImpl):
        """Cached machine code with its digest: code that has changed must never run."""

        def reduce(self, data: Any) -> Any:
            content = dumps(super().reduce(data))  # type: ignore[no-untyped-call]
            return hashlib.sha256(content).digest(), content

        def rebuild(self, target_context: Any, payload: Any) -> Any:
            digest, content = payload
            if hashlib.sha256(content).digest() != digest:
                raise ValueError("it is not what was kept")
            return super().rebuild(target_context, pickle.loads(content))  # type: ignore[no-untyped-call]

    class Checked(FunctionCache):
        _impl_class = Sealed

        def load_overload(self, sig: Any, target_context: Any) -> Any:
            try:
                return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
            except Exception:  # what is no pickle can fail in any way
                with suppress(OSError):
                    self.flush()  # type: ignore[no-untyped-call]
                return None

        def save_overload(self, sig: Any, data: Any) -> None:
            with suppress(OSError):  # a full disk, or a folder that has become read-only
                super().save_overload(sig, data)  # type: ignore[no-untyped-call]

    return Checked
