"""Learners and rewards of a notebook or a script, and not of a module that can be imported.

Such a class or function is one of ``__main__``, which other processes do not have. So workers get
what it is made of: the class and everything of ``__main__`` that it uses, packed by cloudpickle
(:func:`packed`, :func:`unpack`). It goes from process to process and never into a results folder,
since reading it runs code. What stays with the results is its source (:func:`session_source`), for
people. A hash of that identifies the class, so it covers values that the source does not show.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import linecache
import pickle
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import MISSING
from functools import lru_cache, partial
from io import BytesIO
from pathlib import Path
from symtable import SymbolTable, symtable
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any
from uuid import uuid4

import numpy as np

from causal_openlock.errors import LearnerError, in_short
from causal_openlock.files.digest import digest
from causal_openlock.usercode.code_digest import digest_of
from causal_openlock.usercode.local_modules import modules_of_text
from causal_openlock.wording import joined

SESSION = "__main__"
_OWN = uuid4().hex
"""Identifies the process that packed the classes."""


def is_of_session(name: str) -> bool:
    """Whether ``module:Class`` names a class of the running notebook or script.

    >>> is_of_session("__main__:Mine"), is_of_session("ddqn")
    (True, False)
    """
    return name.startswith(f"{SESSION}:")


# -- what goes to workers -------------------------------------------------------------------------


def packed(names: Iterable[str]) -> bytes:
    """The classes of the session among these names, and all that they use, for a worker.

    Raises:
        LearnerError: If they use something that cannot be sent to another process.
    """
    found: dict[str, Any] = {}
    for name in filter(is_of_session, names):
        _collect(_top(name), found)
    if not found:
        return b""
    try:
        content = _pickled(found)
    except Exception as error:  # objects of any library refuse in their own way
        first = next((one for one, value in found.items() if not _can_be_sent(value)), "it")
        raise LearnerError(
            f"{first}, which code of this session uses, cannot be sent to other processes "
            f"({in_short(error)}); make it where the code needs it, or compare with workers=0"
        ) from None
    return pickle.dumps((_OWN, content))


def unpack(content: bytes) -> None:
    """Define what was packed in this process's ``__main__``, unless it was packed here."""
    if content:
        where, found = pickle.loads(content)
        if where != _OWN:  # loading a class that is there would write into it
            vars(sys.modules[SESSION]).update(pickle.loads(found))


def _pickled(value: Any) -> bytes:
    import cloudpickle

    class Pickler(cloudpickle.Pickler):  # type: ignore[misc]
        dispatch_table = cloudpickle.Pickler.dispatch_table.new_child(
            {
                # Fields of dataclasses are compared with the one object MISSING: it goes by name.
                type(MISSING): lambda _: "MISSING",
                # A cached function cannot be pickled; what it wraps is, and cached again there.
                type(_cached): lambda one: (_cached_again, (one.__wrapped__, *_settings(one))),
            }
        )

    content = BytesIO()
    Pickler(content).dump(value)
    return content.getvalue()


def _can_be_sent(value: Any) -> bool:
    try:
        _pickled(value)
    except Exception:
        return False
    return True


@lru_cache
def _cached() -> None:
    """An example of a function with a cache, for its type."""


def _settings(cached: Any) -> tuple[int | None, bool]:
    return cached.cache_parameters()["maxsize"], cached.cache_parameters()["typed"]


def _cached_again(function: Any, maxsize: int | None, typed: bool) -> Any:
    return lru_cache(maxsize, typed)(function)


# -- what stays with the results ------------------------------------------------------------------


def session_source(name: str) -> str:
    """The source of a class of the session and of all that it uses there, as a module.

    Args:
        name: As ``__main__:Class``.

    Raises:
        LearnerError: If the source cannot be found.
    """
    found: dict[str, Any] = {}
    _collect(_top(name), found)
    imports, constants, defined = [], [], []
    for known, value in found.items():
        if isinstance(value, ModuleType):
            imports.append(f"import {value.__name__} as {known}")
        elif _is_defined_here(value):
            defined.append(_source(value))
            if known != value.__name__:
                defined.append(f"{known} = {value.__name__}")
        elif _is_elsewhere(value):
            renamed = "" if known == value.__name__ else f" as {known}"
            imports.append(f"from {value.__module__} import {value.__name__}{renamed}")
        else:
            constants.append(_constant(known, value))
    values = _fingerprint([found[known] for known in sorted(found)], set())
    covered = f"# The hash of all values that it uses: {values}"
    parts = ["\n".join(sorted(imports)), "\n".join(sorted(constants)), *defined, covered]
    text = "\n\n\n".join(filter(None, parts)) + "\n"
    # Its objects are of classes, and its partial functions of functions, that nothing else names.
    kinds = [one.func if isinstance(one, partial) else type(one) for one in found.values()]
    if files := modules_of_text(text, [one.__module__ for one in kinds if one.__module__]):
        text += f"# The hash of {joined(sorted(files))}: {digest_of(files)}\n"
    return text


def session_origin(name: str) -> str:
    """The recorded origin of a class or function of the session: its name and its source's hash.

    Raises:
        LearnerError: If the source cannot be found.
    """
    return f"{name.partition(':')[2]}.py {digest(session_source(name))}"


def _top(name: str) -> str:
    return name.partition(":")[2].partition(".")[0]


def _constant(name: str, value: Any) -> str:
    """A line that defines it; if only a program can make it, a comment."""
    if isinstance(value, set) and value:  # the same text in every process
        shown = f"{{{', '.join(sorted(map(repr, value)))}}}"
    else:
        shown = repr(value)
    text = re.sub(" at 0x[0-9a-f]+", "", " ".join(shown.split()))
    try:
        ast.literal_eval(text)
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        return f"# {name} = {text[:200]}"
    return f"{name} = {text}"


def _is_defined_here(value: Any) -> bool:
    """Whether a value has a definition in the session that is its whole source."""
    value = inspect.unwrap(value) if callable(value) else value
    is_definition = isinstance(value, type | FunctionType) and value.__module__ == SESSION
    return is_definition and "<" not in value.__qualname__


def _is_elsewhere(value: Any) -> bool:
    kinds = type | FunctionType | BuiltinFunctionType
    return (
        isinstance(value, kinds)
        and value.__module__ not in (SESSION, None)
        and value.__name__ == value.__qualname__
        and "<" not in value.__name__
    )


def _collect(name: str, found: dict[str, Any]) -> None:
    """Add a global name of the session, after those that it uses."""
    space = vars(sys.modules[SESSION])
    if name in found or name not in space:
        return
    value = found[name] = space[name]
    if _is_defined_here(value):
        used = _globals(symtable(_source(value), name, "exec"))
    else:
        used = [one for code in _codes(value) for one in code.co_names]
    for one in used:
        _collect(one, found)
    found[name] = found.pop(name)


def _globals(scope: SymbolTable) -> list[str]:
    """The global names that a scope and those inside it use."""
    names = [
        symbol.get_name()
        for symbol in scope.get_symbols()
        if symbol.is_referenced() and (scope.get_type() == "module" or symbol.is_global())
    ]
    return names + [name for inner in scope.get_children() for name in _globals(inner)]


def _codes(value: Any) -> Iterator[CodeType]:
    """The code of a function of the session without a definition, such as a lambda."""
    if isinstance(value, partial):
        yield from _codes(value.func)
        return
    code = getattr(inspect.unwrap(value) if callable(value) else value, "__code__", None)
    if isinstance(code, CodeType) and getattr(value, "__module__", None) == SESSION:
        yield code
        yield from (one for one in code.co_consts if isinstance(one, CodeType))


def _source(value: Any) -> str:
    """The source of a class or function of the session."""
    value = inspect.unwrap(value)
    definitions = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    for lines in _texts(value):
        try:
            tree = ast.parse("".join(lines))
        except SyntaxError:  # a cell with a magic command
            continue
        for node in reversed([*ast.walk(tree)]):
            if isinstance(node, definitions) and node.name == value.__name__:
                first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
                text = "".join(lines[first - 1 : node.end_lineno])
                return inspect.cleandoc("\n" + text) if node.col_offset else text.rstrip()
    raise LearnerError(
        f"the source of {value.__name__} cannot be found, and results are kept with it; define it "
        "in a file, or in a notebook's cell without a magic command such as %%time"
    )


def _texts(value: Any) -> Iterator[list[str]]:
    """Source texts that may define it: that of its code, then cells from the last one on."""
    functions = [value] if isinstance(value, FunctionType) else vars(value).values()
    codes = (getattr(one, "__code__", None) for one in functions)
    files = [code.co_filename for code in codes if isinstance(code, CodeType)]
    if isinstance(main := getattr(sys.modules[SESSION], "__file__", None), str):
        files.append(main)
    files += [name for name in reversed(linecache.cache) if not Path(name).is_file()]
    for file in dict.fromkeys(files):
        if lines := linecache.getlines(file):
            yield lines


def _fingerprint(value: Any, inside: set[int]) -> str:
    """A hash of a value that is the same in every process; of functions, of their code."""
    value = inspect.unwrap(value) if callable(value) else value
    if id(value) in inside:  # it holds itself
        return ""
    inside = inside | {id(value)}
    parts: Iterable[Any]
    if isinstance(value, CodeType):
        parts = [value.co_code, value.co_names, list(value.co_consts)]
    elif isinstance(value, FunctionType):
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        parts = [value.__code__, value.__defaults__, value.__kwdefaults__, cells]
    elif isinstance(value, partial):
        parts = [value.func, value.args, value.keywords]
    elif isinstance(value, type) and value.__module__ == SESSION:
        parts = [(name, one) for name, one in sorted(vars(value).items()) if _counts(name, one)]
    elif isinstance(value, classmethod | staticmethod):
        parts = [value.__func__]
    elif isinstance(value, property):
        parts = [value.fget, value.fset, value.fdel]
    elif isinstance(value, ModuleType):
        parts = [value.__name__]
    elif isinstance(value, list | tuple | dict):
        parts = value.items() if isinstance(value, dict) else value
    elif isinstance(value, set | frozenset):
        parts = sorted(_fingerprint(one, inside) for one in value)
    else:
        return hashlib.sha256(_content(value)).hexdigest()
    made = [type(value).__name__, *(_fingerprint(part, inside) for part in parts)]
    return hashlib.sha256(" ".join(made).encode()).hexdigest()


def _counts(name: str, one: Any) -> bool:
    """Whether an attribute of a class decides what it does."""
    return callable(one) or not (name.startswith("__") or name == "_abc_impl")


def _content(value: Any) -> bytes:
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return f"{value.dtype} {value.shape}".encode() + value.tobytes()
    try:
        return pickle.dumps(value)
    except Exception:  # objects of any library refuse in their own way
        return re.sub(" at 0x[0-9a-f]+", "", repr(value)).encode()
