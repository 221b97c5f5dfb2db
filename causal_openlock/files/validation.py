"""Pydantic's validation errors as sentences for people who write YAML.

Each error becomes one sentence that names the key, describes its value, and says what to write
instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import signature
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict

from causal_openlock.errors import OpenLockError
from causal_openlock.wording import nearest

MOST = 2**63 - 1
"""The largest whole number of subjects, trials, attempts and so on."""

Where = tuple[str | int, ...]
"""A path of keys and list indices into a file."""


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


def several(value: Any) -> bool:
    """Whether a value is a collection of others; a text is one value.

    >>> several("CC4"), several(["CC4"])
    (False, True)
    """
    return isinstance(value, Iterable) and not isinstance(value, str)


def whole_number(value: Any, name: str, least: int = 0) -> int:
    """An argument that has to be a whole number; NumPy's are.

    >>> whole_number(3, "trial", 1)
    3

    Raises:
        OpenLockError: If it is something else, less, or more than tables hold (:data:`MOST`).
    """
    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if whole and least <= value <= MOST:
        return int(value)
    ends = f"from {least} to {MOST:,}" if whole and value > MOST else f"of at least {least}"
    raise OpenLockError(f"{name} must be a whole number {ends}, and this is {value!r}")


def check_arguments(given: Iterable[str], function: Callable[..., Any], name: str) -> None:
    """Refuse arguments that a function or method does not have, with the nearest that it has.

    Args:
        given: Names of keyword arguments.
        function: Its first argument is given otherwise, as ``self`` is.
        name: What users call it.

    Raises:
        OpenLockError: If it has no argument of a name.
    """
    known = [*signature(function).parameters.values()][1:]
    names = [one.name for one in known]
    for one in given if all(one.kind is not one.VAR_KEYWORD for one in known) else ():
        if one not in names:
            raise OpenLockError(f"{name} has no argument {one}; {nearest(one, names)}")


_WANTED = {
    "string_type": "a valid string",
    "int_type": "a valid integer",
    "float_type": "a valid number",
    "bool_type": "true or false",
    "list_type": "a list, written [one, another]",
    "dict_type": "keys and values, written {key: value}",
    "model_type": "keys and values, written {key: value}",
}


def sentence(fault: Any, model: type[BaseModel]) -> str:
    """One of Pydantic's ``ValidationError.errors()`` as a sentence with a remedy."""
    where, kind, value = fault["loc"], fault["type"], fault.get("input")
    name = ".".join(str(part) for part in where) or "the file"
    in_quotes = value is not None and not isinstance(value, str | Mapping | Sequence)
    quotes = "; write it in quotes" if in_quotes else ""
    if kind == "missing":
        return f"{where[-1]}: is missing; add it"
    if kind == "extra_forbidden":
        known = _fields(model, where[:-1])
        return f"{where[-1]!r} is not a key here; {nearest(str(where[-1]), known)}"
    if kind.startswith("custom."):
        return f"{fault['msg']}"
    if where and where[-1] == "[key]":
        return f"a key must be a text, and this is {described(value)}{quotes or '; write a name'}"
    if kind in _WANTED:
        remedy = quotes if kind == "string_type" else ""
        return f"{name} must be {_WANTED[kind]}, and this is {described(value)}{remedy}"
    if kind == "too_short":
        return f"{name} needs at least {fault['ctx']['min_length']}; add one"
    if kind == "string_pattern_mismatch":
        field = _fields(model, where[:-1])[str(where[-1])]
        inner = [note for part in get_args(field.annotation) for note in get_args(part)[1:]]
        form = next(note.description for note in (*inner, field) if note.description)
        return f"{name} must have the form: {form}; this is {described(value)}"
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input ")
    return f"{name} {message}, and this is {described(value)}"


def _fields(model: Any, where: Where) -> dict[str, Any]:
    """The fields of a model at a path of keys, found by walking its field annotations."""

    def models(annotation: Any) -> list[type[BaseModel]]:
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return [annotation]
        return [found for part in get_args(annotation) for found in models(part)]

    here = [model]
    for key in where:
        here = [
            found
            for part in here
            if isinstance(key, str) and key in part.model_fields
            for found in models(part.model_fields[key].annotation)
        ] or here
    return {
        field.alias or name: field for part in here for name, field in part.model_fields.items()
    }
