"""The source file of a module, found without importing anything.

Importing a module runs it, which must not happen to code that is only read or bundled. Python finds
``a.b`` by importing ``a``; here only ``a`` is located, which runs nothing, and ``b`` is searched
for in its folder.
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

_INSTALLED_IN = Path(__file__).resolve().parents[2]
TOOLKIT = tuple(
    _INSTALLED_IN / name
    for name in ("causal_openlock", "openlock_learners", "learners/openlock_learners")
)
"""The toolkit's own packages; in a checkout the learners are in a folder of their own."""
MODULE_AND_NAME = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")


def module_source(name: str, beside: Iterable[Path] = ()) -> Path | None:
    """The source file that importing a module would run.

    The folders ``beside`` are searched last, as with :func:`look_beside`. There is ``None`` for a
    module that is not there or is not Python source.

    Example:
        >>> module_source("causal_openlock.errors").name
        'errors.py'
    """
    top, *parts = name.split(".")
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):  # a module without a spec
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
        source, places = file_of(found), [found]
    return source.resolve() if source and source.suffix == ".py" and source.is_file() else None


def look_beside(*folders: Path) -> None:
    """Make modules in the working directory and in these folders importable, also in workers."""
    for folder in (Path.cwd(), *folders):
        if (place := str(folder.resolve())) not in sys.path:
            sys.path.append(place)


def is_installed(source: Path) -> bool:
    """Whether a source file is in one of the folders that packages are installed in."""
    paths = sysconfig.get_paths()
    folders = [paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    return any(source.is_relative_to(Path(folder).resolve()) for folder in folders)


def is_users_own(source: Path) -> bool:
    """Whether a source file is neither installed nor one of the toolkit's."""
    # Shared machines have packages in such folders outside the environment.
    installed = {"site-packages", "dist-packages"} & {*source.parts} or is_installed(source)
    return not (installed or any(map(source.is_relative_to, TOOLKIT)))


def _is_module(path: Path) -> bool:
    return file_of(path) is not None or path.is_dir()


def file_of(path: Path) -> Path | None:
    """The source file of a module or package, from its path without a suffix."""
    files = path / "__init__.py", path.with_name(f"{path.name}.py")
    return next(filter(Path.is_file, files), None)
