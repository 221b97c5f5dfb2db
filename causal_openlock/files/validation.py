"""Pydantic's validation errors as sentences for people who write YAML.

Each error becomes one sentence that names the key, describes its value, and says what to write
instead.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import signature
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

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


def faults_of(error: ValidationError, model: type[BaseModel]) -> list[tuple[Where, str]]:
    """Faults that Pydantic found: the path of each, and a sentence with a remedy."""
    found = []
    for fault in error.errors(include_url=False):
        raised = fault.get("ctx", {}).get("error")
        if isinstance(raised, OpenLockError):
            found += [((*fault["loc"], *part.at), str(part)) for part in raised.parts]
            continue
        # <name>, <list>, <mapping>: the arm of a union, no key of the file.
        *above, last = fault["loc"] or ("",)
        arm = str(last)[:1] == "<" and fault["type"] != "extra_forbidden"
        kept = [part for part in above if str(part)[:1] != "<"]
        where = (*kept, *(() if arm or not fault["loc"] else (last,)))
        found.append((where, _sentence(fault, where, model)))
    return found


def _sentence(fault: Any, where: Where, model: type[BaseModel]) -> str:
    kind, value = fault["type"], fault.get("input")
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
        field = _fields(model, where[:-1]).get(str(where[-1]))
        inner = [note for arm in get_args(field and field.annotation) for note in get_args(arm)[1:]]
        words = [getattr(note, "description", None) for note in (*inner, field)]
        form = next(filter(None, words), fault["ctx"]["pattern"])
        return f"{name} must have the form: {form}; this is {described(value)}"
    message = fault["msg"].removeprefix("Value error, ").removeprefix("Input ")
    return f"{name} {message}, and this is {described(value)}"


def _fields(model: Any, where: Where) -> dict[str, Any]:
    """The fields of a model at a path of keys and indices, found by walking its annotations."""

    def arms(annotation: Any) -> list[Any]:
        """The types of a union, without what annotates them."""
        if get_origin(annotation) in (Annotated, Union, UnionType):
            inner = get_args(annotation)
            inner = inner[:1] if get_origin(annotation) is Annotated else inner
            return [found for one in inner for found in arms(one)]
        return [annotation]

    here = [model]
    for key in where:
        found = []
        for one in here:
            fields = getattr(one, "model_fields", {})
            if key in fields:
                found += arms(fields[key].annotation)
            elif (get_origin(one), type(key)) in ((list, int), (dict, str)):
                found += arms(get_args(one)[-1])
        here = found
    return {
        field.alias or name: field
        for one in here
        for name, field in getattr(one, "model_fields", {}).items()
    }
