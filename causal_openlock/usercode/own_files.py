"""The user's files that a learner or a reward is in: found by reading, with nothing run.

They have to go where it goes, and a change in one of them makes it another learner. What a module
loads in another way than by importing (``importlib``, a file that it opens) is not found.
"""

from __future__ import annotations

import ast
import re
import site
import sys
import sysconfig
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from importlib.machinery import PathFinder
from importlib.metadata import EntryPoint
from importlib.util import find_spec, resolve_name
from pathlib import Path
from typing import Any

from causal_openlock.errors import (
    ExperimentError,
    LearnerError,
    OpenLockError,
    in_short,
    is_stop,
    with_kind,
)
from causal_openlock.files.checksums import digest
from causal_openlock.wording import nearest

_INSTALLED_IN = Path(__file__).resolve().parents[2]
_PACKAGES = ("causal_openlock", "openlock_learners")
TOOLKIT = tuple(_INSTALLED_IN / name for name in (*_PACKAGES, "learners/openlock_learners"))
"""The toolkit's own packages; in a checkout the learners are in a folder of their own."""
_NOT_FOLLOWED = {*sys.stdlib_module_names, *_PACKAGES}
MODULE_AND_NAME = re.compile(r"\w+(\.\w+)*:\w+(\.\w+)*")
_ROLES = {
    "learner": ("class", "MyLearner", LearnerError),
    "reward": ("function", "my_function", ExperimentError),
}


def own_files(modules: Iterable[str], text: str = "") -> dict[str, Path]:
    """The user's files that modules or a source text are made of; of an installed one, its own.

    Returns:
        Them, by their paths from the folders that they are imported from.
    """
    files: dict[str, Path] = {}
    named, seen = set(modules), {""}
    waiting = [*named, *_imports(text, "text", "")]
    while waiting:
        name = waiting.pop()
        top, parent = name.partition(".")[0], name.rpartition(".")[0]
        if name in seen or (top in _NOT_FOLLOWED and name not in named):
            continue
        seen.add(name)
        source = module_source(name)
        if source is None:
            waiting.append(parent)
            continue
        is_package = source.name == "__init__.py"
        folder = source.parents[name.count(".") + is_package]
        inside = source.relative_to(folder)
        # With pip install --target, packages are in a folder of any name.
        if is_users_own(folder / inside) and not any(folder.glob("*.dist-info")):
            files[inside.as_posix()] = source
            imports = _imports(source.read_bytes(), str(source), name if is_package else parent)
            waiting += [parent, *imports]
        elif name in named:
            files[source.name] = source
    return files


def _imports(content: bytes | str, file: str, package: str) -> set[str]:
    """The names that the source of a module imports, some of which may be no modules."""
    try:
        tree = ast.parse(content, file)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise OpenLockError(
            f"{file} is imported and cannot be read as Python ({in_short(error)}); fix it"
        ) from None
    names: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            with suppress(ImportError):  # there is nothing above a top-level module
                module = resolve_name("." * node.level + (node.module or ""), package)
                names.update([module, *(f"{module}.{alias.name}" for alias in node.names)])
    return names


def digest_of(files: Mapping[str, Path]) -> str:
    """The hash of files, by the names that they are imported by."""
    contents = {inside: path.read_bytes() for inside, path in sorted(files.items())}
    # An empty __init__.py does nothing.
    kept = [(inside, digest(content)) for inside, content in contents.items() if content.strip()]
    return kept[0][1] if len(kept) == 1 else digest(repr(kept))


_imported: dict[frozenset[str], tuple[dict[str, Any], str]] = {}


def code_digest(modules: Iterable[str], *, imported: bool = False) -> str:
    """The hash of the user's files that modules are made of, now or as they were ``imported``.

    A process keeps what it has imported, also when the file is changed. Reloading a module makes a
    new spec.
    """
    names = frozenset(modules)
    specs, before = _imported.get(names, ({}, ""))
    present = {name: getattr(sys.modules.get(name), "__spec__", None) for name in specs}
    same = specs and all(present[name] is spec for name, spec in specs.items())
    if imported and same:
        return before
    files = own_files(names)
    code = digest_of(files)
    if not same:
        inside = (name.removesuffix(".py").removesuffix("/__init__") for name in files)
        loaded = {name.replace("/", ".") for name in inside} & sys.modules.keys()
        _imported[names] = {name: sys.modules[name].__spec__ for name in loaded}, code
    return code


def module_source(name: str, beside: Iterable[Path] = ()) -> Path | None:
    """The source file that importing a module would run, maybe a link; None if there is none.

    Importing ``a.b`` would run ``a``: here only ``a`` is located, and ``b`` is searched for in its
    folder. The folders ``beside`` are searched last.

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
    return source if source and source.suffix == ".py" and source.is_file() else None


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
    return any(source.resolve().is_relative_to(Path(folder).resolve()) for folder in folders)


def is_users_own(source: Path) -> bool:
    """Whether a source file is neither installed nor one of the toolkit's."""
    source = source.parent.resolve() / source.name
    # Shared machines have packages in such folders outside the environment.
    installed = {"site-packages", "dist-packages"} & {*source.parts} or is_installed(source)
    return not (installed or any(map(source.is_relative_to, TOOLKIT)))


def load_named(name: str, role: str, fits: Callable[[Any], bool]) -> Any:
    """What ``module:name`` names, for the role of a learner or a reward.

    Raises:
        LearnerError: If it is no name, or cannot be imported; if there is none, the message has the
            nearest that ``fits``. For a reward, an ExperimentError.
    """
    kind, example, refusal = _ROLES[role]
    if not MODULE_AND_NAME.fullmatch(name) or ".py:" in name:
        file, is_file, attribute = name.rpartition(".py:")
        meant = f"did you mean {Path(file).name}:{attribute}? " if is_file else ""
        raise refusal(f"{name!r} names no {role}; {meant}write it like my_module:{example}")
    look_beside()
    entry = EntryPoint(name, name, "")
    try:
        return entry.load()
    except BaseException as error:  # a module can fail in any way while it is imported
        if is_stop(error):
            raise
        why = f"the {role} {name!r} cannot be imported: {with_kind(error)}"
        module = sys.modules.get(entry.module)  # one that fails while it is imported is not kept
        missing = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
        if missing and f"{entry.module}.".startswith(f"{missing}."):
            why = f"no module {missing} is installed or in {Path.cwd()}; check its name"
        elif module and entry.module != "__main__" and isinstance(error, AttributeError):
            fitting = {key for key, value in vars(module).items() if key[0] != "_" and fits(value)}
            source = getattr(module, "__file__", None) or entry.module
            why = f"{source} has no {kind} {entry.attr}; {nearest(entry.attr, fitting)}"
        raise refusal(why) from error
