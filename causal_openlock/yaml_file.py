"""YAML files whose every fault has a line and a column.

Schemas and experiments are both written by hand, so both are read here: YAML 1.2 by
ruamel.yaml, which remembers where each key stood, then a pydantic model. A fault of either, or
one that only the meaning of the file shows, becomes a :class:`~causal_openlock.errors.FileError`.
Files that no one would write by hand (larger than 256 kB, nested deeper than 16 levels, or with
aliases, which can blow up a small file without end) are refused before they are built.
"""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from causal_openlock.errors import Fault, FileError, OpenLockError, nearest

if TYPE_CHECKING:
    from pydantic import BaseModel
    from ruamel.yaml import YAML

    Model = TypeVar("Model", bound=BaseModel)

MAX_BYTES = 256 * 1024
MAX_DEPTH = 16

Where = tuple[str | int, ...]


def yaml_parser() -> YAML:
    """A YAML 1.2 reader and writer that keeps comments, order and quotes."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="rt", pure=True)
    yaml.preserve_quotes = True
    yaml.width = 100
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


@dataclass(frozen=True)
class Document:
    """A parsed file that remembers where everything stood.

    Attributes:
        path: The file.
        data: Its content: ruamel.yaml's dicts and lists.
    """

    path: Path
    data: Any

    def fault(self, where: Where, message: str) -> Fault:
        """A fault at the deepest part of ``where`` that the file has."""
        line, column = 0, 0
        node = self.data
        for key in where:
            marks = getattr(node, "lc", None)
            if isinstance(node, Mapping) and key in node:
                line, column = marks.key(key) if marks else (line, column)
                node = node[key]
            elif isinstance(node, Sequence) and not isinstance(node, str):
                index = node.index(key) if key in node else key
                if not (isinstance(index, int) and 0 <= index < len(node)):
                    break
                line, column = marks.item(index) if marks else (line, column)
                node = node[index]
            else:
                break
        return Fault(line + 1, column + 1, message)

    def error(self, where: Where, message: str) -> FileError:
        """One fault as an error."""
        return FileError(self.path, [self.fault(where, message)])

    def validate(self, model: type[Model]) -> Model:
        """The content as a pydantic model.

        Raises:
            FileError: With one fault for every value that the model refuses.
        """
        from pydantic import ValidationError

        if not isinstance(self.data, Mapping):
            found = "is empty" if self.data is None else f"holds {_kind(self.data)}"
            raise self.error((), f"the file {found}; it must hold keys such as name: and values")
        try:
            return model.model_validate(_plain(self.data))
        except ValidationError as error:
            raise FileError(
                self.path,
                [
                    self.fault(fault["loc"], _sentence(fault, model))
                    for fault in error.errors(include_url=False)
                ],
            ) from None


def read_document(path: Path | str) -> Document:
    """Parse a YAML file written by hand.

    Raises:
        FileError: If it is no YAML 1.2, or nothing that a person would write.
        OpenLockError: If it cannot be read.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise FileError(
                path,
                [Fault(1, 1, f"the file has {size:,} bytes, more than the {MAX_BYTES:,} allowed; "
                       "is this the right file?")],
            )  # fmt: skip
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise FileError(
            path, [Fault(1, 1, f"the file is not UTF-8 text ({error.reason}); save it as UTF-8")]
        ) from None
    except OSError as error:
        raise OpenLockError(f"{path}: cannot be read ({error.strerror}); check the name") from None
    return parse_document(text, path)


def parse_document(text: str, path: Path | str = "<text>") -> Document:
    """Parse YAML text; ``path`` is what faults are reported against."""
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    path = Path(path)
    try:
        _refuse_the_boundless(text, path)
        return Document(path, yaml_parser().load(text))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        problem = " ".join((error.problem or error.context or "it cannot be parsed").split())
        message = f"this is not valid YAML: {problem}; correct this line or the one before it"
        raise FileError(path, [Fault(line, column, message)]) from None
    except YAMLError as error:
        problem = " ".join(str(error).split())[:200]
        raise FileError(
            path, [Fault(1, 1, f"this is not YAML: {problem}; is this the right file?")]
        ) from None


def _refuse_the_boundless(text: str, path: Path) -> None:
    """Walk the parser's events, which costs no more than the text is long."""
    from ruamel.yaml.events import (
        AliasEvent,
        CollectionEndEvent,
        CollectionStartEvent,
    )

    depth = 0
    for event in yaml_parser().parse(text):
        if isinstance(event, AliasEvent):
            message = f"the alias *{event.anchor} is not allowed here; write the value out"
        elif isinstance(event, CollectionStartEvent):
            depth += 1
            if depth <= MAX_DEPTH:
                continue
            message = f"the file is nested deeper than {MAX_DEPTH} levels; is this the right file?"
        else:
            depth -= isinstance(event, CollectionEndEvent)
            continue
        mark = event.start_mark
        raise FileError(path, [Fault(mark.line + 1, mark.column + 1, message)])


def write_text(path: Path | str, text: str) -> None:
    """Write a file so that a reader sees the old one or the new one, never a part.

    Raises:
        OpenLockError: If the folder cannot be written to or the disk is full; the old file stays.
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path | str, content: bytes) -> None:
    """As :func:`write_text`, for bytes."""
    path = Path(path)
    temporary = ""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        Path(temporary).chmod(0o666 & ~_umask())
        Path(temporary).replace(path)
    except OSError as error:
        if temporary:
            Path(temporary).unlink(missing_ok=True)
        raise OpenLockError(
            f"{path}: cannot be written ({error.strerror}); free some space or choose another place"
        ) from None


def _umask() -> int:
    current = os.umask(0)
    os.umask(current)
    return current


def dump_yaml(data: Any) -> str:
    """Data as YAML text."""
    stream = io.StringIO()
    yaml_parser().dump(data, stream)
    return stream.getvalue()


def _plain(node: Any) -> Any:
    """Builtin dicts, lists and scalars, so that pydantic's messages name familiar types."""
    if isinstance(node, Mapping):
        return {_plain(key): _plain(value) for key, value in node.items()}
    if isinstance(node, Sequence) and not isinstance(node, str):
        return [_plain(value) for value in node]
    for kind in (bool, int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node


def _kind(value: Any) -> str:
    if isinstance(value, Mapping):
        return "keys and values"
    if isinstance(value, str):
        return f"the text {value[:40]!r}" if len(value) <= 40 else "a text"
    if isinstance(value, Sequence):
        return "a list"
    return repr(value)


def _sentence(fault: Any, model: type[BaseModel]) -> str:
    """Pydantic's verdict as a sentence with a remedy."""
    where, kind, value = fault["loc"], fault["type"], fault.get("input")
    name = ".".join(str(part) for part in where) or "the file"
    if kind == "missing":
        return f"{where[-1]}: is missing; add it"
    if kind == "extra_forbidden":
        known = _fields(model, where[:-1])
        return f"{where[-1]!r} is no key here; {nearest(str(where[-1]), known)}"
    if kind.startswith("custom."):
        return f"{fault['msg']}"
    said = fault["msg"].removeprefix("Value error, ").removeprefix("Input ")
    return f"{name} {said}, and this is {_kind(value)}"


def _fields(model: Any, where: Where) -> list[str]:
    """The keys that a model knows at a place; found by walking its field annotations."""
    from typing import get_args

    from pydantic import BaseModel

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
    return [field.alias or name for part in here for name, field in part.model_fields.items()]
