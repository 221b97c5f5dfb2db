"""Finding learners by name, and checking their hyper-parameters.

Any package can register learners (:mod:`causal_openlock.files.plugins`). ``module:Class`` names one
that is not registered, such as one in a file of the working directory. Hyper-parameters are the
fields of its frozen dataclass ``Parameters``, whose ``Annotated`` types explain them to users.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, fields
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint
from inspect import getsourcefile
from os import fspath
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from pydantic import ConfigDict, PydanticUserError, ValidationError

from causal_openlock.contract.learner import Learner, LearnerBase
from causal_openlock.contract.one_subject import PerSubjectAdapter
from causal_openlock.errors import LearnerError, in_short, together
from causal_openlock.files.plugins import LEARNERS, loaded, registered
from causal_openlock.files.validation import adapter, errors_of, plain
from causal_openlock.usercode.own_files import (
    MODULE_AND_NAME,
    code_digest,
    is_installed,
    load_named,
    module_source,
)
from causal_openlock.usercode.session_code import is_of_session, session_origin
from causal_openlock.wording import nearest


def registry() -> Mapping[str, EntryPoint]:
    """Every installed learner by name; loads none."""
    return registered(LEARNERS)


@lru_cache(maxsize=100)  # its metadata would be parsed at each access
def _package(package: Distribution) -> tuple[str, bool]:
    """Name and version of a package, and whether it is edited where it lies."""
    described = json.loads(package.read_text("direct_url.json") or "{}")
    edited = described.get("dir_info", {}).get("editable", False)
    return f"{package.name} {package.version}", edited


def origin(name: str, *, imported: bool = False) -> str:
    """Name and version of a learner's package; for ``module:Class``, its file and a hash.

    The hash is that of all the user's modules that it is made of, as this process ``imported`` them
    or as they are now. A package that is installed to be edited (``pip install -e``) has it too.
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
    code = code_digest(modules, imported=imported)
    return f"{package}+{code}" if package else f"{Path(source).name} {code}"


def is_ours(name: str) -> bool:
    """Whether a registered learner comes with the toolkit; ``module:Class`` never counts."""
    entry = registry().get(name)
    return bool(entry and entry.dist and _package(entry.dist)[0].startswith("causal-openlock "))


def file_that_runs(name: str, beside: Path, role: str = "learner") -> str | None:
    """A sentence about the user's file that loading ``module:Class`` would run; imports nothing.

    The module is searched for in the working directory and ``beside`` an experiment file.
    """
    module, colon, kind = name.partition(":")
    installed = {entry.module.partition(".")[0] for entry in registry().values()}
    if not colon or module.partition(".")[0] in {"causal_openlock", *installed}:
        return None
    source = module_source(module, (Path.cwd(), beside))
    if source is None or is_installed(source):
        return None
    file = source.resolve()
    return f"{file.name} in {file.parent} will run as {role} {kind}"


def learner_class(name: str) -> type[LearnerBase]:
    """A learner's class by its registered name, or by ``module:Class``.

    Raises:
        LearnerError: If there is none, it cannot be imported, or it is not a learner.
    """
    if ":" in name:
        kind = load_named(name, "learner", lambda kind: not _fault(kind))
    elif name in registry():
        kind = loaded(registry()[name])
    else:
        raise LearnerError(
            f"there is no learner {name!r}; {nearest(name, registry())}; one that is not installed "
            "is written module:Class"
        )
    if fault := _fault(kind):
        raise LearnerError(f"the learner {name!r} {fault}")
    return kind


def _fault(kind: Any) -> str:
    """What keeps something from being a class of learners; empty if it is one."""
    if not (isinstance(kind, type) and issubclass(kind, LearnerBase)):
        return "is not a subclass of Learner or OneSubjectLearner"
    missing = sorted(getattr(kind, "__abstractmethods__", ()))
    undefined = Learner.act, Learner.probabilities
    if issubclass(kind, Learner) and (kind.act, kind.probabilities) == undefined:
        missing.append("act or probabilities")
    return f"has no {' and no '.join(missing)}; define it" if missing else ""


def name_of(kind: type[LearnerBase]) -> str:
    """The name by which a class is found: its registered one, or ``module:Class``.

    A class that has none, such as one defined in a function, is refused by a LearnerError.

    >>> name_of(learner_class("ddqn"))
    'ddqn'
    """
    written = f"{kind.__module__}:{kind.__qualname__}"
    name = next((name for name, entry in registry().items() if entry.value == written), written)
    if not MODULE_AND_NAME.fullmatch(written) or learner_class(name) is not kind:
        raise LearnerError(
            f"{written} cannot be found by its name, as workers have to; define the class at the "
            "top level of a notebook or of a module"
        )
    return name


def create(name: str, parameters: Mapping[str, Any] | None = None) -> Learner:
    """A learner, ready for :meth:`Learner.begin`; LearnerError if a parameter does not fit.

    >>> create("ddqn", {"gamma": 0.9}).parameters.gamma
    0.9
    """
    kind: Any = learner_class(name)
    values = parse_parameters(name, parameters or {})
    return kind(values) if issubclass(kind, Learner) else PerSubjectAdapter(kind, values)


def parse_parameters(name: str, parameters: Mapping[str, Any]) -> Any:
    """Hyper-parameters from plain data, as an instance of the learner's ``Parameters``.

    Values are read as from a file: a list is accepted for a tuple, and otherwise nothing is
    converted, so ``"3"`` is not a number.

    Raises:
        LearnerError: With all faults, each with the parameter in its ``at``.
    """
    declared: Any = learner_class(name).Parameters
    declared.__pydantic_config__ = ConfigDict(extra="forbid", allow_inf_nan=False, strict=True)
    given = plain(parameters)
    try:
        made = adapter(declared).validate_json(_as_json(name, given, default=fspath))
    except ValidationError as error:
        faults = errors_of(error, declared)
        lists = {(key,) for key, value in given.items() if isinstance(value, list)}
        remedy = "; to compare values, sweep: them in a file, or with ol.sweep"
        raise together(
            [LearnerError(f"{name}: {e}{remedy * (e.at in lists)}", e.at) for e in faults]
        ) from None
    except PydanticUserError as error:
        raise LearnerError(
            f"{declared.__name__} of {name} has a type that no file can have: {in_short(error)}"
        ) from None
    _as_json(name, asdict(made))
    return made


def _as_json(name: str, parameters: Mapping[str, Any], default: Any = None) -> str:
    try:
        return json.dumps(parameters, default=default)
    except (TypeError, ValueError):
        raise LearnerError(
            f"{name}: parameters must be plain data, such as numbers and texts; these are "
            f"{parameters}"
        ) from None


class ParameterInfo(NamedTuple):
    """A hyper-parameter, for help texts."""

    name: str
    default: Any
    meaning: str


def parameter_table(learner: str | type) -> list[ParameterInfo]:
    """The hyper-parameters of a learner, or of a class of parameters.

    >>> parameter_table("rl2")[-1].default
    'condition'
    """
    declared: Any = learner_class(learner).Parameters if isinstance(learner, str) else learner
    hints = get_type_hints(declared, include_extras=True)
    table = []
    for field in fields(declared):
        default = field.default if field.default_factory is MISSING else field.default_factory()
        notes = getattr(hints[field.name], "__metadata__", ())
        texts = [getattr(note, "description", note) for note in notes]
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
