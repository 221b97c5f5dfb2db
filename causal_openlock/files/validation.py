"""Pydantic's errors as sentences: each names the key, describes its value, and has a remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import field
from datetime import date
from functools import cache, wraps
from inspect import signature
from typing import Any, ParamSpec, TypeVar, dataclass_transform

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from causal_openlock.errors import OpenLockError, together
from causal_openlock.wording import nearest

P = ParamSpec("P")
T = TypeVar("T")

MOST = 2**63 - 1  #: the largest whole number of subjects, trials, attempts and so on

Where = tuple[str | int, ...]  #: a path of keys and list indices into a file


class StrictModel(BaseModel):
    """A part of a file: only the declared keys, and values of the declared types."""

    model_config = ConfigDict(extra="forbid", strict=True)


def described(value: Any) -> str:
    """A value of a file in a few words, for a message.

    >>> described([]), described(True), described("x")
    ('an empty list', 'true', "the text 'x'")
    """
    if isinstance(value, Mapping):
        return "keys and values" if value else "{}"
    if isinstance(value, str):
        return f"the text {value!r}" if len(value) <= 40 else f"a text of {len(value)} characters"
    if isinstance(value, Sequence):
        return "a list" if value else "an empty list"
    if isinstance(value, bool):
        return str(value).lower()
    return "nothing" if value is None else str(value)[:40]


def plain(value: Any) -> Any:
    """A value from Python as a file has it: NumPy's numbers and arrays, and tuples, are plain.

    >>> plain({"levers": ("A", "B"), "subjects": np.int64(3)})
    {'levers': ['A', 'B'], 'subjects': 3}
    """
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {plain(key): plain(held) for key, held in value.items()}
    if isinstance(value, list | tuple):
        return [plain(held) for held in value]
    return value


def present(values: Mapping[str, Any]) -> dict[str, Any]:
    """A mapping without what is None.

    >>> present({"name": "a", "license": None})
    {'name': 'a'}
    """
    return {name: value for name, value in values.items() if value is not None}


def several(value: Any) -> bool:
    """Whether a value is a collection of others; a text is one value."""
    return isinstance(value, Iterable) and not isinstance(value, str)


def whole_number(value: Any, name: str, least: int = 0) -> int:
    """An argument that has to be a whole number, and at most what tables hold; NumPy's are."""
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if whole and least <= value <= MOST:
        return int(value)
    ends = f"from {least} to {MOST:,}" if whole and value > MOST else f"of at least {least}"
    raise OpenLockError(f"{name} must be a whole number {ends}, and this is {value!r}")


def check_arguments(given: Iterable[str], function: Callable[..., Any], name: str) -> None:
    """Refuse keyword arguments that a function lacks; its first one is given otherwise."""
    _, *parameters = signature(function).parameters.values()
    names = [parameter.name for parameter in parameters]
    takes_any = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
    for argument in () if takes_any else given:
        if argument not in names:
            raise OpenLockError(f"{name} has no argument {argument}; {nearest(argument, names)}")


def known_arguments(function: Callable[P, T]) -> Callable[P, T]:
    """A function that refuses arguments it does not have in a sentence, with the nearest one."""

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        check_arguments(kwargs, function, function.__name__)
        return function(*args, **kwargs)

    return called


_WANTED = {
    "bool_type": "true or false",
    "list_type": "a list, written [one, another]",
    "tuple_type": "a list, written [one, another]",
    "dict_type": "keys and values, written {key: value}",
    "model_type": "keys and values, written {key: value}",
    "dataclass_type": "keys and values, written {key: value}",
}


def errors_of(error: ValidationError, kind: Any) -> list[OpenLockError]:
    """Faults that Pydantic found in data of a kind, or gathered from what raised errors of ours."""
    errors: list[OpenLockError] = []
    for fault in error.errors(include_url=False):
        ours = fault.get("ctx", {}).get("error")
        if not isinstance(ours, OpenLockError):
            ours = OpenLockError(_sentence(fault, kind))
        for part in ours.parts:
            part.at = (*fault["loc"], *part.at)
            errors.append(part)
    return errors


class Part:
    """A part of a declaration; :func:`part` makes its subclasses."""

    def as_dict(self) -> dict[str, Any]:
        """The part as plain data, which is what a results folder stores."""
        kind: Any = type(self)
        return dict(plain(adapter(kind).dump_python(self)))


@cache
def adapter(kind: Any) -> TypeAdapter[Any]:
    """What reads and writes data of a kind; making one takes a hundred times as long as its use."""
    return TypeAdapter(kind)


@dataclass_transform(frozen_default=True, field_specifiers=(field, Field))
def part(*, kw_only: bool = False) -> Callable[[type[T]], type[T]]:
    """A frozen dataclass that Pydantic checks, in a program too, in sentences of ours."""

    def made(kind: type[T]) -> type[T]:
        summary: Any = {"description": (kind.__doc__ or "").partition("\n")[0]}
        config = ConfigDict(extra="forbid", json_schema_extra=summary)
        checked: Any = dataclass(frozen=True, kw_only=kw_only, config=config)(kind)
        plain_init = checked.__init__

        @wraps(plain_init)
        def init(self: Any, *args: Any, **kwargs: Any) -> None:
            try:
                plain_init(self, *args, **kwargs)
            except ValidationError as error:
                raise together(errors_of(error, kind)) from None

        checked.__init__ = init
        return checked

    return made


def _sentence(fault: Any, kind: Any) -> str:
    """A fault that Pydantic found, in a sentence with a remedy."""
    what, value, where = fault["type"], fault.get("input"), fault["loc"]
    name = ".".join(str(key)[:64] for key in where) or "the file"
    quotes = "; write it in quotes" if isinstance(value, int | float | date) else ""
    if what == "missing":
        return f"{where[-1]}: is missing; add it"
    if what in ("extra_forbidden", "unexpected_keyword_argument"):
        known = nearest(str(where[-1])[:64], _keys(kind, where[:-1]))
        return f"{where[-1]!r:.64} is not a key here; {known}"
    if where and where[-1] == "[key]":
        return f"a key must be a text, and this is {described(value)}{quotes}"
    if what == "too_short":
        return f"{name} needs at least {fault['ctx']['min_length']}; add one"
    if what == "too_long":
        return f"{name} has {len(value)}, and at most {fault['ctx']['max_length']} are allowed"
    if what == "string_pattern_mismatch":
        form = _keys(kind, where[:-1]).get(where[-1], {}).get("description", "another one")
        return f"{name} must have the form: {form}; this is {described(value)}"
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input ")
    if what == "value_error" and not where:  # values at odds
        return message
    wanted = f"must be {_WANTED[what]}" if what in _WANTED else message
    remedy = quotes if what == "string_type" else ""
    return f"{name} {wanted}, and this is {described(value)}{remedy}"


def _keys(kind: Any, where: Where) -> dict[str, Any]:
    """The keys that may stand at a path of keys and indices, by the JSON Schema of a kind."""
    whole = adapter(kind).json_schema()

    def forms(schema: Any) -> list[dict[str, Any]]:
        """A schema, or those that it says are possible."""
        if "$ref" in schema:
            return forms(whole["$defs"][schema["$ref"].rpartition("/")[2]])
        inner = [form for one in schema.get("anyOf", ()) for form in forms(one)]
        return inner or [schema]

    parts = forms(whole)
    for key in where:
        inside = "items" if isinstance(key, int) else "additionalProperties"
        below = [part.get("properties", {}).get(key, part.get(inside)) for part in parts]
        parts = [form for schema in below if isinstance(schema, dict) for form in forms(schema)]
    return {key: schema for part in parts for key, schema in part.get("properties", {}).items()}


def read(kind: Any, data: Any, context: dict[str, Any] | None = None) -> Any:
    """Data as a part, in any of its forms; every fault is refused together."""
    try:
        return adapter(kind).validate_python(data, context=context or {})
    except ValidationError as error:
        raise together(errors_of(error, kind)) from None
