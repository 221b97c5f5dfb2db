"""Where the source of a module is, found without importing anything.

Importing a module runs it, and what is only read, bundled or announced is not to run. Python itself
finds ``a.b`` by importing ``a``; here ``a`` is asked for by name alone, which runs nothing, and
``b`` is looked for in its folder.
"""

from __future__ import annotations

import re
import site
import sys
import sysconfig
from collections.abc import Iterable
from importlib.machinery import PathFinder
from importlib.util import find_spec
from pathlib import Path

MODULE_AND_NAME = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")


def module_source(name: str, beside: Iterable[Path] = ()) -> Path | None:
    """The source file that importing a module would run.

    Args:
        name: Its name, with dots.
        beside: Folders that are searched after all others, as
            :func:`look_beside` has it.

    Returns:
        The file, or ``None`` if there is none or it is no Python source.
    """
    top, *parts = name.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):  # a module that says nothing of itself
        spec = None
    spec = spec or PathFinder.find_spec(top, [str(folder) for folder in beside])
    if spec is None:
        return None
    source = Path(spec.origin) if spec.has_location and spec.origin else None
    places = [Path(place) for place in spec.submodule_search_locations or ()]
    for part in parts:
        found = next(filter(_is_module, (place / part for place in places)), None)
        if found is None:
            return None
        source, places = _file(found), [found]
    return source.resolve() if source and source.suffix == ".py" and source.is_file() else None


def look_beside(*folders: Path) -> None:
    """Let modules be found in the working directory, then in folders: no package is needed there.

    Worker processes of this machine are started with the same places.
    """
    for folder in (Path.cwd(), *folders):
        if (place := str(folder.resolve())) not in sys.path:
            sys.path.append(place)


def is_installed(source: Path) -> bool:
    """Whether a source file is in one of the folders that packages are installed in."""
    paths = sysconfig.get_paths()
    folders = [paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    return any(source.is_relative_to(Path(folder).resolve()) for folder in folders)


def _is_module(path: Path) -> bool:
    return _file(path) is not None or path.is_dir()


def _file(path: Path) -> Path | None:
    files = path / "__init__.py", path.with_name(f"{path.name}.py")
    return next(filter(Path.is_file, files), None)
