"""Learners that are defined in a notebook or a script, and not in a module that can be imported.

Such a class is one of ``__main__``, which other processes do not have. So workers get what it is
made of: the class and everything of ``__main__`` that it uses, packed by cloudpickle
(:func:`packed`, :func:`unpack`). It goes from process to process and never into a results folder,
since reading it runs code. What stays with the results is its source (:func:`session_source`), for
people, and a hash of that, so that results of a changed class can be distinguished.
"""

from __future__ import annotations

import ast
import linecache
import pickle
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import MISSING
from io import BytesIO
from symtable import SymbolTable, symtable
from types import CodeType, FunctionType, ModuleType
from typing import Any
from uuid import uuid4

from causal_openlock.errors import LearnerError

SESSION = "__main__"
_OWN = uuid4().hex
"""Of this process, which has the classes that it packs."""


def is_of_session(name: str) -> bool:
    """Whether ``module:Class`` names a class of the running notebook or script.

    >>> is_of_session("__main__:Mine"), is_of_session("ddqn")
    (True, False)
    """
    return name.startswith(f"{SESSION}:")


def packed(names: Iterable[str]) -> bytes:
    """The classes of the session among these names, and all that they use, for a worker."""
    import cloudpickle

    found: dict[str, Any] = {}
    for name in filter(is_of_session, names):
        _collect(name.partition(":")[2].partition(".")[0], found)
    if not found:
        return b""

    class Pickler(cloudpickle.Pickler):  # type: ignore[misc]
        # Fields of dataclasses are compared with the one object MISSING: it goes by its name.
        dispatch_table = cloudpickle.Pickler.dispatch_table.new_child(
            {type(MISSING): lambda _: "MISSING"}
        )

    content = BytesIO()
    Pickler(content).dump(found)
    return pickle.dumps((_OWN, content.getvalue()))


def unpack(content: bytes) -> None:
    """Define what was packed in this process's ``__main__``, unless it was packed here."""
    if content:
        where, found = pickle.loads(content)
        if where != _OWN:  # loading a class that is there would write into it
            vars(sys.modules[SESSION]).update(pickle.loads(found))


def session_source(name: str) -> str:
    """The source of a class of the session and of all that it uses there, as a module.

    Args:
        name: As ``__main__:Class``.

    Raises:
        LearnerError: If the source cannot be found.
    """
    found: dict[str, Any] = {}
    _collect(name.partition(":")[2].partition(".")[0], found)
    imports, constants, defined = [], [], []
    for known, value in found.items():
        if isinstance(value, ModuleType):
            imports.append(f"import {value.__name__} as {known}")
        elif _is_definition(value) and value.__module__ == SESSION:
            defined.append(_source(value))
        elif _is_definition(value) and value.__name__ == value.__qualname__:
            renamed = f" as {known}" * (known != value.__name__)
            imports.append(f"from {value.__module__} import {value.__name__}{renamed}")
        else:
            constants.append(re.sub(" at 0x[0-9a-f]+", "", f"{known} = {value!r}"))
    parts = ["\n".join(sorted(imports)), "\n".join(sorted(constants)), *defined]
    return "\n\n\n".join(filter(None, parts)) + "\n"


def _is_definition(value: Any) -> bool:
    return isinstance(value, type | FunctionType)


def _collect(name: str, found: dict[str, Any]) -> None:
    """Add a global name of the session, after those that its definition uses."""
    space = vars(sys.modules[SESSION])
    if name in found or name not in space:
        return
    value = space[name]
    found[name] = value
    if _is_definition(value) and value.__module__ == SESSION:
        for used in _globals(symtable(_source(value), name, "exec")):
            _collect(used, found)
        found[name] = found.pop(name)


def _globals(scope: SymbolTable) -> list[str]:
    """The global names that a scope and those inside it use."""
    names = [
        symbol.get_name()
        for symbol in scope.get_symbols()
        if symbol.is_referenced() and (scope.get_type() == "module" or symbol.is_global())
    ]
    return names + [name for inner in scope.get_children() for name in _globals(inner)]


def _source(value: Any) -> str:
    """The source of a class or function of the session."""
    for lines in _texts(value):
        try:
            tree = ast.parse("".join(lines))
        except SyntaxError:  # a cell with a magic command
            continue
        definitions = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
        for node in reversed(tree.body):
            if isinstance(node, definitions) and node.name == value.__name__:
                first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
                return "".join(lines[first - 1 : node.end_lineno]).rstrip()
    raise LearnerError(
        f"the source of {value.__name__} cannot be found, and results are kept with it; define it "
        "in a notebook's cell or in a file"
    )


def _texts(value: Any) -> Iterator[list[str]]:
    """Source texts that may define it: that of its code, then cells from the last one on."""
    functions = [value] if isinstance(value, FunctionType) else vars(value).values()
    codes = (getattr(one, "__code__", None) for one in functions)
    files = [code.co_filename for code in codes if isinstance(code, CodeType)]
    if isinstance(main := getattr(sys.modules[SESSION], "__file__", None), str):
        files.append(main)
    files += [name for name in reversed(linecache.cache) if "ipykernel" in name]
    for file in dict.fromkeys(files):
        if lines := linecache.getlines(file):
            yield lines
