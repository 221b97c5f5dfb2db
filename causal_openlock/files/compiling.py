"""Compiling loops with numba, which stores what it has compiled next to the code.

Numba compares a stored kernel with its own source file alone. So the kernels of one family stand in
one file together with their constants: a change elsewhere would leave old machine code in use.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

Compiled = TypeVar("Compiled", bound=Callable[..., Any])


def compiled(function: Compiled, **options: Any) -> Compiled:
    """Compile at the first call, once for each installation, with options of ``numba.njit``.

    ``error_model="numpy"`` divides as NumPy does: a check for zero would keep loops from being
    vectorised. With ``NUMBA_DISABLE_JIT=1`` the function stays plain Python, for debugging.
    """
    import numba  # takes a while to load
    from numba.core.caching import FunctionCache

    class Cache(FunctionCache):
        """Numba's cache of the function, in which what cannot be read counts as missing."""

        def load_overload(self, *key: Any) -> Any:
            try:
                return super().load_overload(*key)  # type: ignore[no-untyped-call]
            except Exception:  # what is no pickle can fail in any way
                with suppress(OSError):
                    self.flush()  # type: ignore[no-untyped-call]

    kernel = numba.njit(error_model="numpy", **options)(function)
    try:
        kernel._cache = Cache(function)  # type: ignore[no-untyped-call]
    except RuntimeError:  # numba finds no folder that can be written to
        warnings.warn(
            "there is no folder for what numba compiles, so every process compiles it again, which "
            "takes up to a minute; set NUMBA_CACHE_DIR to a folder that you can write to",
            stacklevel=1,
        )
    return cast(Compiled, kernel)
