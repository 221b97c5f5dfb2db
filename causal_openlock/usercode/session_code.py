"""Learners and rewards of a notebook or a script, and not of a module that can be imported.

Such a class or function is one of ``__main__``, which other processes do not have. So workers get
what it is made of: the class and everything of ``__main__`` that it uses, packed by cloudpickle
(:func:`packed`, :func:`unpack`). It goes from process to process and never into a results folder,
since reading it runs code. What stays with the results is its source (:func:`session_source`), for
people. A hash of that identifies the class, so it has the values of the names that it uses.
"""

from __future__ import annotations

import ast
import dis
import inspect
import linecache
import pickle
import re
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import MISSING
from functools import lru_cache
from io import BytesIO
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any
from uuid import uuid4

import numpy as np

from causal_openlock.errors import LearnerError, in_short
from causal_openlock.files.checksums import digest
from causal_openlock.usercode.own_files import digest_of, own_files

SESSION = "__main__"
MOST_SHOWN = 200  # characters of a value; of a longer one there is a hash
_OWN = uuid4().hex  # identifies the process that packed the classes
_ORIGINS = "_origins_of_causal_openlock"  # a worker's __main__ has them of what it was sent
_DEFINITIONS = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def is_of_session(name: str) -> bool:
    """Whether ``module:Class`` names a class of the running notebook or script.

    >>> is_of_session("__main__:Mine"), is_of_session("ddqn")
    (True, False)
    """
    return name.startswith(f"{SESSION}:")


# -- what goes to workers -------------------------------------------------------------------------


def packed(names: Iterable[str]) -> bytes:
    """The classes of the session among these names, and all that they use, for a worker."""
    origins = {name: session_origin(name) for name in names if is_of_session(name)}
    values = {used: value for name in origins for used, value in _used(name).items()}
    for used, value in values.items():
        try:
            _pickled(value)
        except Exception as error:  # objects of any library refuse in their own way
            raise LearnerError(
                f"{used}, which code of this session uses, cannot be sent to other processes "
                f"({in_short(error)}); make it where the code needs it, or compare with workers=0"
            ) from None
    return pickle.dumps((_OWN, origins, _pickled(values))) if origins else b""


def unpack(content: bytes) -> None:
    """Define what was packed in this process's ``__main__``, unless it was packed here."""
    if content:
        process, origins, values = pickle.loads(content)
        if process != _OWN:  # loading a class that is there would write into it
            vars(sys.modules[SESSION]).update(pickle.loads(values), **{_ORIGINS: origins})


def _pickled(value: Any) -> bytes:
    import cloudpickle

    class Pickler(cloudpickle.Pickler):  # type: ignore[misc]
        dispatch_table = cloudpickle.Pickler.dispatch_table.new_child(
            {
                # Fields of dataclasses are compared with the one object MISSING: it goes by name.
                type(MISSING): lambda _: "MISSING",
                # A cached function cannot be pickled; what it wraps is, and cached again there.
                type(lru_cache(len)): lambda f: (_cached, (f.__wrapped__, f.cache_parameters())),
            }
        )

    content = BytesIO()
    Pickler(content).dump(value)
    return content.getvalue()


def _cached(function: Any, settings: dict[str, Any]) -> Any:
    return lru_cache(**settings)(function)


# -- what stays with the results ------------------------------------------------------------------


def session_origin(name: str) -> str:
    """The recorded origin of a class or function of the session: its name and its source's hash."""
    known = getattr(sys.modules[SESSION], _ORIGINS, {})
    return known.get(name) or f"{name.partition(':')[2]}.py {digest(session_source(name))}"


def session_source(name: str) -> str:
    """The source of a class of the session and of all that it uses there, as a module."""
    lines, definitions = [], []
    for known, value in _used(name).items():
        origin, as_named = getattr(value, "__module__", ""), getattr(value, "__name__", known)
        if _is_definition(value):
            definitions.append(_source(value))
            if as_named != known:
                definitions.append(f"{known} = {as_named}")
        elif isinstance(value, ModuleType):
            lines.append(f"import {value.__name__} as {known}")
        elif origin != SESSION and getattr(sys.modules.get(origin), as_named, None) is value:
            lines.append(f"from {origin} import {as_named} as {known}")
        else:
            lines.append(_constant(known, value))
    text = "\n\n\n".join(["\n".join(sorted(lines)), *definitions]) + "\n"
    if files := own_files((), text):
        text += f"# The hash of {', '.join(sorted(files))}: {digest_of(files)}\n"
    return text


def _constant(name: str, value: Any) -> str:
    """A line that defines a value; if only a program can make it, a comment."""
    with np.printoptions(threshold=sys.maxsize, floatmode="unique"):
        text = repr(value)
    if isinstance(value, set) and value:  # the same text in every process
        text = f"{{{', '.join(sorted(map(repr, value)))}}}"
    elif getattr(value, "__name__", "") == "<lambda>":
        with suppress(OSError):
            text = inspect.getsource(value)
    text = re.sub(" at 0x[0-9a-f]+", "", " ".join(text.split()))
    with suppress(ValueError, SyntaxError, MemoryError, RecursionError):
        ast.literal_eval(text)
        return f"{name} = {text}"
    return f"# {name} = {text if len(text) <= MOST_SHOWN else digest(text)}"


def _used(name: str) -> dict[str, Any]:
    """What a class of the session uses there, by name, and itself: each after what it uses."""
    used: dict[str, Any] = {}
    space = vars(sys.modules[SESSION])

    def collect(name: str) -> None:
        if name in used or name not in space:
            return
        value = used[name] = space[name]
        if _is_definition(value):
            names = _names(compile(_source(value), name, "exec"))
        elif isinstance(value, FunctionType) and value.__module__ == SESSION:  # a lambda
            names = _names(value.__code__)
        else:
            names = {getattr(getattr(value, "func", type(value)), "__name__", "")}
        for other in sorted(names):
            collect(other)
        used[name] = used.pop(name)

    collect(name.partition(":")[2].partition(".")[0])
    return used


def _names(code: CodeType) -> set[str]:
    """The global names that code and what is inside it uses."""
    steps = dis.get_instructions(code)
    names = {step.argval for step in steps if step.opname in ("LOAD_NAME", "LOAD_GLOBAL")}
    return names.union(*(_names(one) for one in code.co_consts if isinstance(one, CodeType)))


def _is_definition(value: Any) -> bool:
    """Whether a value has a definition in the session that is its whole source."""
    value = inspect.unwrap(value) if callable(value) else value
    is_definition = isinstance(value, type | FunctionType) and value.__module__ == SESSION
    return is_definition and "<" not in value.__qualname__


def _source(value: Any) -> str:
    """The source of a class or function of the session."""
    value = inspect.unwrap(value)
    functions = [value] if isinstance(value, FunctionType) else [*vars(value).values()]
    codes = [getattr(function, "__code__", None) for function in functions]
    files = [code.co_filename for code in codes if isinstance(code, CodeType)]
    files.append(getattr(sys.modules[SESSION], "__file__", None) or "")
    files += [name for name in reversed(linecache.cache) if not Path(name).is_file()]
    for file in dict.fromkeys(files):
        lines = linecache.getlines(file)
        with suppress(SyntaxError):  # a cell with a magic command
            for node in reversed([*ast.walk(ast.parse("".join(lines)))]):
                if isinstance(node, _DEFINITIONS) and node.name == value.__name__:
                    first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
                    text = "".join(lines[first - 1 : node.end_lineno])
                    return inspect.cleandoc("\n" + text) if node.col_offset else text.rstrip()
    raise LearnerError(
        f"the source of {value.__name__} cannot be found, and results are kept with it; define it "
        "in a file, or in a notebook's cell without a magic command such as %%time"
    )
