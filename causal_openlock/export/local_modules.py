"""The modules that a learner's file imports: those beside it, which have to go where it goes.

Imports are read from the source and not carried out, so that those inside functions are found as
well. What a module loads in another way (``importlib``, a file that it opens) cannot be told.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from causal_openlock.errors import OpenLockError

_INSTALLED = {"site-packages", "dist-packages"}


@dataclass
class LocalModules:
    """What a module needs.

    Attributes:
        files: It and the modules beside it that it imports, by their paths from the folder that
            they are imported from.
        others: Top-level names of what else it imports, the standard library left out.
    """

    files: dict[str, Path] = field(default_factory=dict)
    others: set[str] = field(default_factory=set)


def local_modules(module: str) -> LocalModules:
    """The files of a module and of all that it imports from beside it.

    Args:
        module: Its name; it is imported.

    Raises:
        OpenLockError: If it has no source file.
    """
    file = getattr(importlib.import_module(module), "__file__", None)
    if file is None or Path(file).suffix != ".py":
        raise OpenLockError(f"{module} has no source file that could be bundled; put it in a file")
    path = Path(file).resolve()
    depth = module.count(".") + (path.name == "__init__.py")
    root = path.parents[depth]
    found, waiting = LocalModules(), [module]
    own = module.partition(".")[0]
    while waiting:
        name = waiting.pop()
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top == "causal_openlock":
            continue
        # Among installed packages, those beside it are not its own.
        beside = top == own or (not _INSTALLED & set(root.parts) and _is_in(root, top))
        files = list(_files(root, name)) if beside else []
        if not files:
            found.others |= set() if beside and _is_source(root / top) else {top}
        for one in files:
            inside = one.relative_to(root)
            if inside.as_posix() not in found.files:
                found.files[inside.as_posix()] = one
                waiting += _imports(one, inside)
    return found


def _is_in(root: Path, top: str) -> bool:
    """Whether a top-level name is imported from this folder, and not from one before it."""
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return False
    if spec is None:
        return False
    places = [spec.origin] if spec.has_location else list(spec.submodule_search_locations or ())
    return any(place and Path(place).resolve().is_relative_to(root) for place in places)


def _is_source(path: Path) -> bool:
    return path.is_dir() or path.with_name(f"{path.name}.py").is_file()


def _files(root: Path, name: str) -> Iterator[Path]:
    """The file of a module, and those of the packages that it is in."""
    path = root
    for part in name.split("."):
        path = path / part
        for one in (path / "__init__.py", path.with_name(f"{part}.py")):
            if one.is_file():
                yield one
                break


def _imports(path: Path, inside: Path) -> list[str]:
    """The names that a source file imports; some of them may be no modules but what is in one."""
    package = inside.parent.parts
    names = []
    for node in ast.walk(ast.parse(path.read_bytes(), str(path))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            near = package[: len(package) + 1 - node.level] if node.level else ()
            base = ".".join([*near, *([node.module] if node.module else [])])
            names += [f"{base}.{alias.name}" if base else alias.name for alias in node.names]
    return names


__all__ = ["LocalModules", "local_modules"]
