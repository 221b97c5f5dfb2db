"""Messages for ``module:name`` that names nothing: the module or the name may be misspelt.

A module that fails while it is imported is something else: its own error says more.
"""

from __future__ import annotations

import pkgutil
import sys
from collections.abc import Callable
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from causal_openlock.usercode.own_files import users_folders
from causal_openlock.wording import nearest


def misspelt(
    entry: EntryPoint, error: Exception, kind: str, fits: Callable[[Any], bool]
) -> str | None:
    """Message for ``module:name`` that names no module, or nothing in a module; else None.

    Args:
        entry: What was loaded.
        error: What loading it raised.
        kind: What the name is to be, such as ``class``.
        fits: Whether something else in the module could have been meant.

    Example:
        >>> entry = EntryPoint("", "causal_openlock.wording:conted", "")
        >>> said = misspelt(entry, AttributeError(), "function", callable)
        >>> "wording.py has no function conted; did you mean counted?" in said
        True
    """
    if isinstance(error, ModuleNotFoundError):
        missing = error.name or ""
        if not f"{entry.module}.".startswith(f"{missing}."):
            return None
        package, _, last = missing.rpartition(".")
        places = [*getattr(sys.modules.get(package), "__path__", map(str, users_folders()))]
        known = {found.name for found in pkgutil.iter_modules(places)}
        where = " or ".join(dict.fromkeys(places))
        return f"there is no module {missing} in {where}; {nearest(last, known)}"
    module = sys.modules.get(entry.module)  # one that fails while it is imported is not kept
    if module is None or entry.module == "__main__" or not isinstance(error, AttributeError):
        return None
    source = Path(getattr(module, "__file__", None) or entry.module)
    shown = source.relative_to(Path.cwd()) if source.is_relative_to(Path.cwd()) else source
    known = {name for name, value in vars(module).items() if name[0] != "_" and fits(value)}
    return f"{shown} has no {kind} {entry.attr}; {nearest(entry.attr, known)}"
