"""The user's files that a learner or a reward is in: found by reading, with nothing run.

They have to go where it goes, and a change in one of them makes it another learner. What a module
loads in another way than by importing (``importlib``, a file that it opens) is not found.
"""

from __future__ import annotations

import re
import site
import sys
import sysconfig
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from modulefinder import ModuleFinder
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NamedTuple

from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.files.digest import digest
from causal_openlock.wording import nearest

_INSTALLED_IN = Path(__file__).resolve().parents[2]
_PACKAGES = ("causal_openlock", "openlock_learners")
TOOLKIT = tuple(_INSTALLED_IN / name for name in (*_PACKAGES, "learners/openlock_learners"))
"""The toolkit's own packages; in a checkout the learners are in a folder of their own."""
MODULE_AND_NAME = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")


class OwnFiles(NamedTuple):
    """Files, by their paths from the folders that they are imported from, and other imports."""

    files: dict[str, Path]
    others: set[str]


def own_files(modules: Iterable[str], beside: Iterable[Path] = (), text: str = "") -> OwnFiles:
    """The user's files that modules or a source text are made of; of an installed one, its own.

    The folders ``beside`` are searched after all others.
    """
    files, own, places = {}, [], users_folders(beside)
    for name in modules:
        source = module_source(name, beside)
        if source is not None and is_users_own(source):
            own.append(name)
            places.append(source.parents[name.count(".") + (source.name == "__init__.py")])
        elif source is not None:
            files[source.name] = source
    finder = _Finder([str(place) for place in places])
    try:
        for name in own:
            with suppress(ImportError):
                finder.import_hook(name)
        finder.scan_code(compile(text, "text", "exec"), finder.add_module("text"))
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        file = getattr(error, "filename", None) or " and ".join(own)
        raise OpenLockError(
            f"{file} is imported and cannot be read as Python ({in_short(error)}); fix it"
        ) from None
    found: dict[str, Any] = finder.modules
    for name, module in found.items():
        if module.__file__ and module.__file__.endswith(".py"):
            inside = name.replace(".", "/") + ("/__init__" if module.__path__ else "")
            files[f"{inside}.py"] = Path(module.__file__)
    others = {name.partition(".")[0] for name in finder.badmodules}
    return OwnFiles(files, others - {*finder.modules, *sys.stdlib_module_names, *_PACKAGES})


class _Finder(ModuleFinder):
    """Finds what modules import, also in folders without a file of their own."""

    def __init__(self, places: list[str]) -> None:
        super().__init__(places, excludes=[*sys.stdlib_module_names, *_PACKAGES])

    def find_module(self, name: str, path: Any, parent: Any = None) -> Any:
        """The place of a module; see :class:`ModuleFinder`."""
        spec = PathFinder.find_spec(name, self.path if path is None else path)
        if spec and not spec.origin and (parent or name not in self.excludes):
            return None, next(iter(spec.submodule_search_locations or ())), ("", "", 5)  # a package
        return super().find_module(name, path, parent)

    def load_package(self, fqname: str, pathname: str) -> Any:
        """Load a package; see :class:`ModuleFinder`."""
        if (Path(pathname) / "__init__.py").is_file():
            return super().load_package(fqname, pathname)
        package: Any = self.add_module(fqname)
        package.__path__ = [pathname]
        return package


def digest_of(files: Mapping[str, Path]) -> str:
    """The hash of files, by the names that they are imported by."""
    contents = {inside: path.read_bytes() for inside, path in sorted(files.items())}
    # An empty __init__.py does nothing.
    kept = [(inside, digest(content)) for inside, content in contents.items() if content.strip()]
    return kept[0][1] if len(kept) == 1 else digest(repr(kept))


_imported: dict[frozenset[str], tuple[dict[str, ModuleSpec | None], str]] = {}


def code_digest(modules: Iterable[str]) -> str:
    """The hash of the user's files that modules are made of, as they are now."""
    names = frozenset(modules)
    files = own_files(names).files
    code = digest_of(files)
    found = (inside.removesuffix(".py").removesuffix("/__init__") for inside in files)
    loaded = {name.replace("/", ".") for name in found} & sys.modules.keys()
    specs = {name: sys.modules[name].__spec__ for name in loaded}
    if specs and not _known(names):
        _imported[names] = specs, code
    return code


def imported_digest(modules: Iterable[str]) -> str:
    """The :func:`code_digest` of the files as they were when the modules were imported.

    A process keeps what it has imported, also when the file is changed. Importing or reloading a
    module makes a new spec.
    """
    return _known(frozenset(modules)) or code_digest(modules)


def _known(modules: frozenset[str]) -> str:
    specs, code = _imported.get(modules, ({}, ""))
    present = {name: getattr(sys.modules.get(name), "__spec__", None) for name in specs}
    return code if all(present[name] is spec for name, spec in specs.items()) else ""


def module_source(name: str, beside: Iterable[Path] = ()) -> Path | None:
    """The source file that importing a module would run; None if there is none.

    Importing ``a.b`` would run ``a``: here only ``a`` is located, and ``b`` is searched for in its
    folder. The folders ``beside`` are searched last, as with :func:`look_beside`.

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
    for part in parts:
        places = [*(spec.submodule_search_locations or ())] if spec else []
        spec = PathFinder.find_spec(part, places)
    source = Path(spec.origin) if spec and spec.has_location and spec.origin else None
    return source.resolve() if source and source.suffix == ".py" and source.is_file() else None


def look_beside(*folders: Path) -> None:
    """Make modules in the working directory and in these folders importable, also in workers."""
    for folder in (Path.cwd(), *folders):
        if (place := str(folder.resolve())) not in sys.path:
            sys.path.append(place)


def is_installed(source: Path) -> bool:
    """Whether a source file is in one of the folders that packages are installed in."""
    paths = sysconfig.get_paths()
    folders = [paths[name] for name in ("stdlib", "platstdlib", "purelib", "platlib", "scripts")]
    folders += [*site.getsitepackages(), site.getusersitepackages()]
    return any(source.is_relative_to(Path(folder).resolve()) for folder in folders)


def is_users_own(source: Path) -> bool:
    """Whether a source file is neither installed nor one of the toolkit's."""
    # Shared machines have packages in such folders outside the environment.
    installed = {"site-packages", "dist-packages"} & {*source.parts} or is_installed(source)
    return not (installed or any(map(source.is_relative_to, TOOLKIT)))


def users_folders(beside: Iterable[Path] = ()) -> list[Path]:
    """The folders of the search path in which nothing is installed."""
    places = dict.fromkeys(Path(place).resolve() for place in (*sys.path, *map(str, beside)))
    own = [place for place in places if place.is_dir() and is_users_own(place / "module.py")]
    # With pip install --target, packages are in a folder of any name.
    return [place for place in own if not any(place.glob("*.dist-info"))]


def misspelt(
    entry: EntryPoint, error: Exception, kind: str, fits: Callable[[Any], bool]
) -> str | None:
    """What to say of an entry that names no module, or nothing in it that fits, such as a class.

    None if the module fails while it is imported: its own error says more.
    """
    if isinstance(error, ModuleNotFoundError) and f"{entry.module}.".startswith(f"{error.name}."):
        package, _, last = (error.name or "").rpartition(".")
        places = [*getattr(sys.modules.get(package), "__path__", map(str, users_folders()))]
        close = nearest(last, {module.name for module in iter_modules(places)})
        return f"there is no module {error.name} in {' or '.join(places)}; {close}"
    module = sys.modules.get(entry.module)  # one that fails while it is imported is not kept
    if module is None or entry.module == "__main__" or not isinstance(error, AttributeError):
        return None
    known = {name for name, value in vars(module).items() if name[0] != "_" and fits(value)}
    source = getattr(module, "__file__", None) or entry.module
    return f"{source} has no {kind} {entry.attr}; {nearest(entry.attr, known)}"
