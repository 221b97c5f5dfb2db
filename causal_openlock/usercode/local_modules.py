"""The modules of the user that a learner's or a reward's file imports.

They have to go where it goes, and a change in one of them makes it another learner. Imports are
read from the source and not carried out: those inside functions are found as well, and nothing
runs. What a module loads in another way (``importlib``, a file that it opens) is not found.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.usercode.module_source import file_of, is_users_own, module_source


@dataclass
class LocalModules:
    """Files and packages that a module needs.

    Attributes:
        files: It and the modules that it imports and that are neither installed nor the toolkit's,
            by their paths from the folders that they are imported from.
        linked: Those of them that a link in such a folder leads to; they stay where they are.
        others: Top-level names of what else it imports, the standard library left out.
    """

    files: dict[str, Path] = field(default_factory=dict)
    linked: dict[str, Path] = field(default_factory=dict)
    others: set[str] = field(default_factory=set)


def local_modules(module: str, beside: Iterable[Path] = ()) -> LocalModules:
    """The files of a module, which is not imported, and of all that it imports from the user's.

    The folders ``beside`` are searched after all others.

    Raises:
        OpenLockError: If it has no source file, or a file that it imports is not valid Python.
    """
    places = tuple(beside)
    path = module_source(module, places)
    if path is None:
        raise OpenLockError(f"{module} has no source file that could be bundled; put it in a file")
    home = path.parents[module.count(".") + (path.name == "__init__.py")]
    # Of an installed module, those next to it are installed as well, and not the user's.
    alone = not is_users_own(path)
    return _followed([module], {module.partition(".")[0]: home}, [home, *places], alone)


def modules_of_text(text: str, others: Iterable[str] = ()) -> dict[str, Path]:
    """The files of the user that a source text imports, or that other modules are in."""
    names = [*others, *_imports(ast.parse(text), ())]
    found = _followed(names, {}, [], alone=False)
    return found.linked | found.files


def _followed(
    waiting: list[str], roots: dict[str, Path | None], places: Sequence[Path], alone: bool
) -> LocalModules:
    """Collect what some modules need, and what their imports need in turn.

    Args:
        waiting: Names of the modules.
        roots: The folders that are known, by top-level name.
        places: Folders where others may be.
        alone: Whether others are not the user's, wherever they are.
    """
    found = LocalModules()
    while waiting:
        name = waiting.pop()
        top = name.partition(".")[0]
        if top in sys.stdlib_module_names or top == "causal_openlock":
            continue
        if top not in roots:
            roots[top] = None if alone else _root(top, places)
        root = roots[top]
        if root is None:
            found.others.add(top)
            continue
        for one in _files(root, name):
            inside = one.relative_to(root)
            kept = found.files if one.resolve().is_relative_to(root) else found.linked
            if inside.as_posix() not in kept:
                kept[inside.as_posix()] = one
                waiting += _imports(_parsed(one), inside.parent.parts)
    found.others |= {inside.partition("/")[0].removesuffix(".py") for inside in found.linked}
    return found


def _root(top: str, places: Sequence[Path]) -> Path | None:
    """The folder that a top-level module is imported from, if it is one of the user's."""
    source = module_source(top, places)
    for folder in (Path(place).resolve() for place in [*map(str, places), *sys.path]):
        file = file_of(folder / top)
        # A package may also be a folder without a file of its own.
        if file.resolve() == source if file else source is None and (folder / top).is_dir():
            installed = any(folder.glob("*.dist-info"))  # with pip install --target
            return folder if is_users_own(file or folder / top) and not installed else None
    return None


def _files(root: Path, name: str) -> Iterator[Path]:
    """The file of a module, and those of the packages that it is in."""
    path = root
    for part in name.split("."):
        path = path / part
        if (found := file_of(path)) is not None:
            yield found


def _parsed(path: Path) -> ast.Module:
    try:
        return ast.parse(path.read_bytes(), str(path))
    except (SyntaxError, ValueError, RecursionError, MemoryError, OSError) as error:
        raise OpenLockError(
            f"{path} is imported and cannot be read as Python ({in_short(error)}); fix it"
        ) from None


def _imports(tree: ast.Module, package: Sequence[str]) -> list[str]:
    """The names that a source imports; some may be parts of a module."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            near = package[: len(package) + 1 - node.level] if node.level else ()
            base = ".".join([*near, *([node.module] if node.module else [])])
            names += [f"{base}.{alias.name}" if base else alias.name for alias in node.names]
    return names
