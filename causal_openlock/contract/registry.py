"""Finding learners by name, and checking their hyper-parameters.

Any package can add learners, in the way in which those of the toolkit are declared::

    [project.entry-points."causal_openlock.learners"]
    mine = "my_package:MyLearner"

``module:Class`` names a learner that is not registered, such as one in a file of the working
directory or next to the experiment file. Hyper-parameters are the fields of its frozen dataclass
``Parameters``: values are checked against their types, and a text in an ``Annotated`` type explains
a parameter to users.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from functools import cache, lru_cache
from importlib.metadata import Distribution, EntryPoint
from inspect import getsourcefile
from os import fspath
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from pydantic import (
    ConfigDict,
    PydanticUndefinedAnnotation,
    PydanticUserError,
    ValidationError,
)

from causal_openlock.contract.learner import Learner, LearnerBase
from causal_openlock.contract.one_subject import OneSubjectLearner, PerSubjectAdapter
from causal_openlock.errors import LearnerError, OpenLockError, in_short, together
from causal_openlock.files.plugins import LEARNERS, registered
from causal_openlock.files.validation import adapter, errors_of, plain
from causal_openlock.usercode.misspelt import misspelt
from causal_openlock.usercode.own_files import (
    MODULE_AND_NAME,
    code_digest,
    imported_digest,
    is_installed,
    look_beside,
    module_source,
)
from causal_openlock.usercode.session_code import is_of_session, session_origin
from causal_openlock.wording import nearest

STRICT = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)
"""How parameters are read."""


def registry() -> Mapping[str, EntryPoint]:
    """Every installed learner by name; loads none.

    Raises:
        OpenLockError: If two packages register the same name.
    """
    return registered(LEARNERS)


@lru_cache(maxsize=100)  # its metadata would be parsed at each access
def _package(package: Distribution) -> tuple[str, bool]:
    """Name and version of a package, and whether it is edited where it lies."""
    described = json.loads(package.read_text("direct_url.json") or "{}")
    edited = described.get("dir_info", {}).get("editable", False)
    return f"{package.name} {package.version}", edited


def origin(name: str, *, imported: bool = False) -> str:
    """Name and version of a learner's package; for ``module:Class``, its file and a hash.

    The hash is that of the file and of all modules of the user that it imports. A package that is
    installed to be edited (``pip install -e``) has it after its version.

    Args:
        name: As for :func:`learner_class`.
        imported: Whether the hash is that of the files as this process imported them.

    Raises:
        OpenLockError: If there is no such learner, or a file that it imports is not valid Python.
    """
    entry = registry().get(name)
    package, edited = _package(entry.dist) if entry and entry.dist else ("", True)
    if is_ours(name) or not edited:
        return package
    if is_of_session(name):
        return session_origin(name)
    kind = learner_class(name)
    source = getsourcefile(kind)
    if source is None:
        return "unknown"
    # The class may be in another module than the one that it is named by.
    modules = {kind.__module__} if package else {name.partition(":")[0], kind.__module__}
    code = (imported_digest if imported else code_digest)(modules)
    return f"{package}+{code}" if package else f"{Path(source).name} {code}"


def is_ours(name: str) -> bool:
    """Whether a registered learner comes with the toolkit; ``module:Class`` never counts."""
    entry = registry().get(name)
    return bool(entry and entry.dist and _package(entry.dist)[0].startswith("causal-openlock "))


def file_that_runs(name: str, beside: Path, role: str = "learner") -> str | None:
    """A sentence about the file that loading a learner would run; this imports nothing.

    Args:
        name: As for :func:`learner_class`; the result is ``None`` for an installed learner.
        beside: The folder of the experiment file that names it.
        role: Its role in the sentence.
    """
    module, colon, kind = name.partition(":")
    installed = {entry.module.partition(".")[0] for entry in registry().values()}
    if not colon or module.partition(".")[0] in {"causal_openlock", *installed}:
        return None
    source = module_source(module, (Path.cwd(), beside))
    if source is None or is_installed(source):
        return None
    return f"{source.name} in {source.parent} will run as {role} {kind}"


def learner_class(name: str) -> type[LearnerBase]:
    """A learner's class by its registered name, or by ``module:Class``.

    Raises:
        LearnerError: If there is none, it cannot be imported, or it is not a learner.
    """
    # A notebook may define a class again.
    return _load.__wrapped__(name) if is_of_session(name) else _load(name)


@cache
def _load(name: str) -> type[LearnerBase]:
    entry = _entry(name)
    called = f"the learner {name!r} ({entry.value})"
    try:
        kind = entry.load()
    except Exception as error:  # a module can fail in any way while it is imported
        meant = misspelt(entry, error, "class", _is_whole) if name == entry.value else None
        what = f"{called} cannot be imported: {type(error).__name__}: {error}"
        raise LearnerError(meant or what) from error
    if not (isinstance(kind, type) and issubclass(kind, LearnerBase)):
        raise LearnerError(f"{called} is not a subclass of Learner or OneSubjectLearner")
    _require_methods(kind)
    return kind


def _entry(name: str) -> EntryPoint:
    if ":" not in name:
        known = registry()
        if name not in known:
            raise LearnerError(
                f"there is no learner {name!r}; {nearest(name, known)}; one that is not installed "
                "is written module:Class"
            )
        return known[name]
    if not MODULE_AND_NAME.fullmatch(name):
        raise LearnerError(f"{name!r} names no learner; write it like my_module:MyLearner")
    look_beside()
    return EntryPoint(name, name, LEARNERS)


def _missing(kind: type[LearnerBase]) -> list[str]:
    """Methods that a class of learners has to define and does not."""
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    says_nothing = Learner.act, Learner.probabilities
    if issubclass(kind, Learner) and (kind.act, kind.probabilities) == says_nothing:
        missing = [*missing, "act or probabilities"]
    return missing


def _is_whole(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, LearnerBase) and not _missing(kind)


def _require_methods(kind: type[LearnerBase]) -> None:
    if missing := " and no ".join(_missing(kind)):
        raise LearnerError(f"{kind.__module__}:{kind.__qualname__} has no {missing}; define it")


def name_of(kind: type[LearnerBase]) -> str:
    """The name by which a class is found: its registered one, or ``module:Class``.

    >>> name_of(learner_class("ddqn"))
    'ddqn'

    Raises:
        LearnerError: If it cannot be found by a name, such as a class defined in a function.
    """
    written = f"{kind.__module__}:{kind.__qualname__}"
    _require_methods(kind)
    name = next((name for name, entry in registry().items() if entry.value == written), written)
    forget()  # its module may have been loaded again
    if not MODULE_AND_NAME.fullmatch(written) or learner_class(name) is not kind:
        raise LearnerError(
            f"{written} cannot be found by its name, as workers have to; define the class at the "
            "top level of a notebook or of a module"
        )
    return name


def forget() -> None:
    """Load every learner again when it is next asked for: its file may have changed."""
    _load.cache_clear()


def create(name: str, parameters: Mapping[str, Any] | None = None) -> Learner:
    """A learner, ready for :meth:`Learner.begin`.

    Args:
        name: As for :func:`learner_class`.
        parameters: Hyper-parameters that differ from their defaults.

    Raises:
        LearnerError: If there is no such learner, or a parameter is unknown or has a wrong value.

    Example:
        >>> create("ddqn", {"gamma": 0.9}).parameters.gamma
        0.9
    """
    kind = learner_class(name)
    checked = parse_parameters(name, parameters or {})
    if issubclass(kind, OneSubjectLearner):
        return PerSubjectAdapter(kind, checked)
    learner: Learner = kind(checked)  # type: ignore[assignment]
    return learner


def parse_parameters(name: str, parameters: Mapping[str, Any]) -> Any:
    """Hyper-parameters from plain data, as an instance of the learner's ``Parameters``.

    Values are read as from a file: a list is accepted for a tuple, and otherwise nothing is
    converted, so ``"3"`` is not a number.

    Raises:
        LearnerError: With all faults: parameters that are unknown or missing, values that do not
            fit. Each has the parameter in its ``at``.
    """
    declared: Any = learner_class(name).Parameters
    declared.__pydantic_config__ = STRICT
    given = plain(parameters)
    try:
        made = adapter(declared).validate_json(_as_json(name, given, default=fspath))
    except ValidationError as error:
        raise together(
            [_named(name, fault, given) for fault in errors_of(error, declared)]
        ) from None
    except (PydanticUserError, PydanticUndefinedAnnotation) as error:
        raise LearnerError(
            f"{declared.__name__} of {name} has a type that no file can have: {in_short(error)}"
        ) from None
    _as_json(name, asdict(made))
    return made


def _as_json(name: str, parameters: Mapping[str, Any], default: Any = None) -> str:
    for key, value in parameters.items():
        try:
            json.dumps(value, default=default)
        except (TypeError, ValueError):
            raise LearnerError(
                f"{name}: {key} must be plain data, such as a number or a text, and this is "
                f"{value!r}",
                (key,),
            ) from None
    return json.dumps(parameters, default=default)


def _named(name: str, fault: OpenLockError, given: Mapping[str, Any]) -> LearnerError:
    """A fault of the parameters of a learner, with its name."""
    remedy = ""
    if len(fault.at) == 1 and isinstance(given.get(str(fault.at[0])), list):
        remedy = "; to compare values, sweep: them in a file, or with ol.sweep"
    return LearnerError(f"{name}: {fault}{remedy}", fault.at)


class ParameterInfo(NamedTuple):
    """A hyper-parameter, for help texts."""

    name: str
    default: Any
    meaning: str


def parameter_table(learner: str | type) -> list[ParameterInfo]:
    """The hyper-parameters of a learner, with defaults and meanings.

    >>> parameter_table("ddqn")[0]
    ParameterInfo(name='gamma', default=0.8, meaning='discount factor (paper: .8)')

    Args:
        learner: Its name, or its class of parameters.
    """
    declared: Any = learner_class(learner).Parameters if isinstance(learner, str) else learner
    hints = get_type_hints(declared, include_extras=True)
    table = []
    for field in fields(declared):
        notes = getattr(hints[field.name], "__metadata__", ())
        texts = [getattr(note, "description", note) for note in notes]
        default = None if field.default is MISSING else field.default
        if field.default_factory is not MISSING:
            default = field.default_factory()
        meaning = " ".join(text for text in texts if isinstance(text, str))
        table.append(ParameterInfo(field.name, default, meaning))
    return table


def changed_parameters(name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The hyper-parameters of a learner that differ from their defaults, as a file has them.

    >>> changed_parameters("bayes", {"policy": "thompson", "forgetting": 0.0})
    {'policy': 'thompson'}
    """
    defaults = {row.name: plain(row.default) for row in parameter_table(name)}
    given = plain(parameters)
    return {key: value for key, value in given.items() if value != defaults.get(key)}
