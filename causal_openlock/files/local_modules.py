"""The modules that a learner's file imports: those beside it, which have to go where it goes.

Imports are read from the source and not carried out: those inside functions are found as well, and
nothing runs. What a module loads in another way (``importlib``, a file that it opens) is not
found. A file counts if it is Python, and if it is in the folder that the module is imported from,
also where a link leads to it.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from causal_openlock.errors import OpenLockError
from causal_openlock.files.module_source import is_installed, module_source


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


def local_modules(module: str, beside: Iterable[Path] = ()) -> LocalModules:
    """The files of a module, which is not imported, and of all that it imports from beside it.

    The folders ``beside`` are searched after all others.

    Raises:
        OpenLockError: If it has no source file, or a file that it imports is no Python.
    """
    places = tuple(beside)
    path = module_source(module, places)
    if path is None:
        raise OpenLockError(f"{module} has no source file that could be bundled; put it in a file")
    depth = module.count(".") + (path.name == "__init__.py")
    root = path.parents[depth]
    alone = is_installed(path)  # among installed packages, those beside it are not its own
    found, waiting = LocalModules(), [module]
    own = module.partition(".")[0]
    while waiting:
        name = waiting.pop()
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top == "causal_openlock":
            continue
        beside_it = top == own or (not alone and _is_in(root, top, places))
        files = list(_files(root, name)) if beside_it else []
        if not files:
            found.others |= set() if beside_it and _is_source(root / top) else {top}
        for one in files:
            inside = one.relative_to(root)
            if inside.as_posix() not in found.files:
                found.files[inside.as_posix()] = one
                waiting += _imports(one, inside)
    return found


def _is_in(root: Path, top: str, places: Iterable[Path]) -> bool:
    """Whether a top-level name is imported from this folder, and not from one before it."""
    source = module_source(top, places)
    if source is not None:
        return source.is_relative_to(root)
    return (root / top).is_dir()  # a package without a file of its own


def _is_source(path: Path) -> bool:
    return path.is_dir() or path.with_name(f"{path.name}.py").is_file()


def _files(root: Path, name: str) -> Iterator[Path]:
    """The file of a module, and those of the packages that it is in."""
    path = root
    for part in name.split("."):
        path = path / part
        for one in (path / "__init__.py", path.with_name(f"{part}.py")):
            if one.is_file() and one.resolve().is_relative_to(root):
                yield one
                break


def _imports(path: Path, inside: Path) -> list[str]:
    """The names that a source file imports; some of them may be no modules but what is in one."""
    package = inside.parent.parts
    try:
        tree = ast.parse(path.read_bytes(), str(path))
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise OpenLockError(f"{path} cannot be bundled, for it is no Python; mend it") from None
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            near = package[: len(package) + 1 - node.level] if node.level else ()
            base = ".".join([*near, *([node.module] if node.module else [])])
            names += [f"{base}.{alias.name}" if base else alias.name for alias in node.names]
    return names
