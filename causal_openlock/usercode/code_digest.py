"""A hash of code: of a source file and of all modules of the user that it imports.

The hash of the files (:func:`code_digest`) is not always that of the code that runs: a process
keeps what it has imported, also when the file is changed. What the files were when their modules
were first asked for is remembered for that (:func:`imported_digest`).
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import NamedTuple

from causal_openlock.files.digest import digest
from causal_openlock.usercode.local_modules import local_modules
from causal_openlock.usercode.module_source import is_users_own, module_source


class _Imported(NamedTuple):
    specs: Mapping[str, ModuleSpec | None]  #: by module; importing or reloading it makes a new one
    code: str


_imported: dict[tuple[Path, frozenset[str]], _Imported] = {}


def code_digest(source: Path, modules: Iterable[str], beside: Iterable[Path] = ()) -> str:
    """The hash of a source file and of all modules of the user that some modules import.

    Where nothing else of the user is imported, it is the hash of the file's content.

    Args:
        source: The file.
        modules: The names of its module and of others around it.
        beside: Folders that are searched after all others.

    Raises:
        OpenLockError: If a file that is imported is not valid Python.
    """
    places, names = tuple(beside), frozenset(modules)
    files: dict[str, Path] = {}
    for module in names:
        path = module_source(module, places)
        if path is not None and is_users_own(path):
            found = local_modules(module, places)
            files |= found.linked | found.files
    if source.resolve() not in {one.resolve() for one in files.values()}:
        files[source.name] = source
    code = digest_of(files)
    specs = _specs(files)
    if specs and _known(source, names) is None:
        _imported[source, names] = _Imported(specs, code)
    return code


def digest_of(files: Mapping[str, Path]) -> str:
    """The hash of files, by the names that they are imported by."""
    contents = {inside: path.read_bytes() for inside, path in sorted(files.items())}
    # An empty __init__.py does nothing.
    kept = [(inside, digest(content)) for inside, content in contents.items() if content.strip()]
    return kept[0][1] if len(kept) == 1 else digest(repr(kept))


def imported_digest(source: Path, modules: Iterable[str]) -> str:
    """The :func:`code_digest` of the files as they were when their modules were imported."""
    names = frozenset(modules)
    return _known(source, names) or code_digest(source, names)


def _specs(files: Iterable[str]) -> dict[str, ModuleSpec | None]:
    names = (".".join(Path(one).with_suffix("").parts).removesuffix(".__init__") for one in files)
    loaded = {name: sys.modules[name] for name in names if name in sys.modules}
    return {name: module.__spec__ for name, module in loaded.items()}


def _known(source: Path, names: frozenset[str]) -> str | None:
    """The remembered hash, unless one of the modules was imported or reloaded since."""
    known = _imported.get((source, names))
    if known is None or any(
        getattr(sys.modules.get(name), "__spec__", None) is not spec
        for name, spec in known.specs.items()
    ):
        return None
    return known.code
