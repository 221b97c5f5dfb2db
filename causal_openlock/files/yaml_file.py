"""YAML files written by hand, with line and column for every fault.

Schemas and experiments are read by ruamel.yaml (YAML 1.2), which remembers the place of each key,
and then by a pydantic model. Faults of syntax, form or meaning become a
:class:`~causal_openlock.errors.FileError`. What nobody writes by hand is refused before anything is
built from it: more than 128 kB, 5,000 lines or values, nesting deeper than 16 levels, and the parts
of YAML that are ambiguous or make a small file large (anchors, aliases, merge keys, tags, keys that
are not names, several documents in one file).

Dumping a parsed file moves or loses comments. So a change is made in the text (:func:`rewritten`):
the parser gives the start and end of each value, and only those characters are replaced. Additions
are written in the style of :func:`styled`: keys on lines of their own, their values on one line.

>>> parse_document("name: CC3").data["name"]
'CC3'
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from causal_openlock.errors import Fault, FileError, OpenLockError
from causal_openlock.files.decoding import decoded
from causal_openlock.files.validation import Where as Where
from causal_openlock.files.validation import described, faults_of

if TYPE_CHECKING:
    from pydantic import BaseModel
    from ruamel.yaml import YAML

    Model = TypeVar("Model", bound=BaseModel)

MAX_BYTES = 128 * 1024
MAX_VALUES = MAX_LINES = 5000
MAX_DEPTH = 16
TOO_LARGE = Fault(1, 1, f"the file has more than {MAX_BYTES:,} bytes; is this the right file?")


def yaml_parser() -> YAML:
    """A YAML 1.2 reader and writer that keeps comments, order and quotes."""
    from ruamel.yaml import YAML

    yaml = YAML(typ="rt", pure=True)
    yaml.Constructor = _constructor()
    yaml.Emitter = _emitter()
    yaml.preserve_quotes = True
    yaml.width = 100
    yaml.indent(mapping=2, sequence=4, offset=2)
    return yaml


@cache
def _constructor() -> Any:
    """ruamel.yaml's constructor, with the place of values that it cannot construct."""
    from ruamel.yaml.constructor import ConstructorError, RoundTripConstructor

    class Constructor(RoundTripConstructor):
        def construct_object(self, node: Any, deep: bool = False) -> Any:
            try:
                return super().construct_object(node, deep=deep)
            except (ValueError, LookupError):  # a 31st of June, a number of 5,000 digits
                raise ConstructorError(
                    problem=f"{described(node.value)} looks like a number or a date and is none",
                    problem_mark=node.start_mark,
                ) from None

    return Constructor


@cache
def _emitter() -> Any:
    """ruamel.yaml's emitter, without its losses.

    It does not break texts into lines, where one of two spaces would be lost, and quotes texts with
    Unicode's line breaks or a question mark at the beginning, which would not be read back.
    """
    from ruamel.yaml.emitter import Emitter as Plain

    class Emitter(Plain):
        def choose_scalar_style(self) -> Any:
            text = self.event.value
            odd = text.startswith("?") or any(one in text for one in "\x85\u2028\u2029")
            return '"' if odd else super().choose_scalar_style()

        def process_scalar(self) -> None:
            width, self.best_width = self.best_width, sys.maxsize
            super().process_scalar()
            self.best_width = width

    return Emitter


@dataclass(frozen=True)
class Document:
    """A parsed file that remembers the place of everything.

    Attributes:
        path: The file.
        text: Its text.
        data: Its content as ruamel.yaml's dicts and lists.
    """

    path: Path
    text: str
    data: Any

    def fault(self, where: Where, message: str) -> Fault:
        """A fault at the deepest part of ``where`` that the file has."""
        line, column = 0, 0
        node = self.data
        for key in where:
            marks = getattr(node, "lc", None)
            if isinstance(node, Mapping):
                # Pydantic gives keys that are no text as text.
                known = next((own for own in node if own == key or str(own) == key), node)
                if known is node:
                    break
                line, column = marks.key(known) if marks else (line, column)
                node = node[known]
            elif isinstance(node, Sequence) and not isinstance(node, str):
                index = node.index(key) if isinstance(key, str) and key in node else key
                if not (isinstance(index, int) and 0 <= index < len(node)):
                    break
                line, column = marks.item(index) if marks else (line, column)
                node = node[index]
            else:
                break
        return Fault(line + 1, column + 1, message)

    def error(self, error: OpenLockError, where: Where = ()) -> FileError:
        """An error with the place of each of its parts, as seen from ``where``."""
        parts = [self.fault((*where, *part.at), str(part)) for part in error.parts]
        return FileError(self.path, parts)

    def validate(self, model: type[Model]) -> Model:
        """The content as a pydantic model.

        Raises:
            FileError: With one fault for every value that the model refuses.
        """
        from pydantic import ValidationError

        if not isinstance(self.data, Mapping):
            found = "is empty" if self.data is None else f"holds {described(self.data)}"
            message = f"the file {found}; it must hold keys such as name: and values"
            raise FileError(self.path, [self.fault((), message)])
        try:
            return model.model_validate(plain(self.data))
        except ValidationError as error:
            raise FileError(
                self.path, [self.fault(*fault) for fault in faults_of(error, model)]
            ) from None


def read_document(path: Path | str) -> Document:
    """Parse a YAML file written by hand.

    Raises:
        FileError: If it is not YAML 1.2, or uses what is refused here.
        OpenLockError: If it cannot be read.
    """
    return parse_document(read_text(path), path)


def read_text(path: Path | str) -> str:
    """The text of a file written by hand.

    Raises:
        FileError: If it is too large or not UTF-8.
        OpenLockError: If it cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise OpenLockError(f"{path}: cannot be read ({error.strerror}); check the name") from None
    except ValueError:
        raise OpenLockError(f"{str(path)!r} is not a name that a file can have") from None
    if len(content) > MAX_BYTES:
        raise FileError(path, [TOO_LARGE])
    try:
        return decoded(content)
    except UnicodeDecodeError as error:
        before = content[: error.start].decode("utf-8")
        message = f"this is not UTF-8 text ({error.reason}); save the file as UTF-8"
        raise FileError(path, [_fault_after(before, message)]) from None


def parse_document(text: str, path: Path | str = "<text>") -> Document:
    """Parse YAML text; ``path`` is what faults are reported against.

    Raises:
        FileError: If it is not YAML 1.2, or uses what is refused here.
    """
    from ruamel.yaml.error import MarkedYAMLError, YAMLError
    from ruamel.yaml.reader import ReaderError

    path = Path(path)
    if len(text) > MAX_BYTES:
        raise FileError(path, [TOO_LARGE])
    if len(text.splitlines()) > MAX_LINES:
        message = f"the file has more than {MAX_LINES:,} lines; is this the right file?"
        raise FileError(path, [Fault(MAX_LINES + 1, 1, message)])
    try:
        return Document(path, text, _reader().load(text))
    except _RefusedError as refused:
        mark, message = refused.args
        raise FileError(path, [Fault(mark.line + 1, mark.column + 1, message)]) from None
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line, column = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        problem = " ".join((error.problem or error.context or "it cannot be parsed").split())
        message = f"this is not valid YAML: {problem}; correct this line or the one before it"
        raise FileError(path, [Fault(line, column, message)]) from None
    except ReaderError as error:
        message = f"the character U+{ord(text[error.position]):04X} is not allowed; take it out"
        raise FileError(path, [_fault_after(text[: error.position], message)]) from None
    except YAMLError as error:
        problem = " ".join(str(error).split())[:200]
        raise FileError(
            path, [Fault(1, 1, f"this is not YAML: {problem}; is this the right file?")]
        ) from None
    except (AssertionError, ValueError):  # of ruamel.yaml, which knows 1.1 and 1.2
        message = "this version of YAML is not known; take the line %YAML out"
        raise FileError(path, [Fault(1, 1, message)]) from None


def _fault_after(before: str, message: str) -> Fault:
    """A fault at the character that follows the text ``before``."""
    lines = before.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return Fault(len(lines), len(lines[-1]) + 1, message)


_HUGE = re.compile(r"[-+]?((0[ob])?[0-9_]{400,}|0x[0-9a-f_]{400,})", re.IGNORECASE)
"""A whole number with so many digits that Python does not write it out."""


class _RefusedError(Exception):
    """Something that is not allowed here: its mark, and what to do about it."""


def _reader() -> YAML:
    """A parser that stops at what is refused, as soon as it is read, and drops comments."""
    from ruamel.yaml.parser import RoundTripParser
    from ruamel.yaml.scanner import Scanner as Plain

    class Scanner(Plain):
        def fetch_more_tokens(self) -> Any:
            try:
                return super().fetch_more_tokens()
            except (ValueError, OverflowError):  # \U00110000 is beyond all characters
                message = "a number here is larger than any that YAML knows; correct this line"
                raise _RefusedError(self.reader.get_mark(), message) from None

    class Parser(RoundTripParser):
        def __init__(self, loader: Any) -> None:
            super().__init__(loader)
            self.refusals = _refusals()
            next(self.refusals)

        def get_event(self) -> Any:
            event = super().get_event()
            self.refusals.send(event)
            return event

    yaml = yaml_parser()
    yaml.Parser, yaml.Scanner = Parser, Scanner
    return yaml


def _refusals() -> Generator[None, Any, None]:
    """Take the parser's events one by one, in time proportional to the length of the text.

    Raises:
        _RefusedError: At what is not allowed.
    """
    from ruamel.yaml.events import (
        AliasEvent,
        CollectionEndEvent,
        CollectionStartEvent,
        DocumentStartEvent,
        MappingStartEvent,
        NodeEvent,
        ScalarEvent,
    )

    # Of each collection around the present one: the keys so far (of a list: None), and whether
    # the next value is a key.
    open_: list[tuple[set[str] | None, bool]] = []
    documents = values = 0
    while True:
        event = yield
        mark = event.start_mark
        if isinstance(event, CollectionEndEvent):
            open_.pop()
        elif isinstance(event, DocumentStartEvent):
            documents += 1
            if documents > 1:
                raise _RefusedError(mark, "the file holds a second document; keep one of them")
            if event.version and event.version != (1, 2):
                raise _RefusedError(mark, "this is read as YAML 1.2; take the line %YAML out")
        if not isinstance(event, NodeEvent):
            continue
        values += 1
        if values > MAX_VALUES:
            raise _RefusedError(
                mark, f"the file has more than {MAX_VALUES:,} values; is this the right file?"
            )
        if isinstance(event, AliasEvent):
            raise _RefusedError(
                mark, f"the alias *{event.anchor:.40} is not allowed here; write the value out"
            )
        elif event.anchor:
            raise _RefusedError(
                mark, f"the anchor &{event.anchor:.40} is not allowed here; take it out"
            )
        elif tag := getattr(event, "tag", None):
            tag = str(tag).replace("tag:yaml.org,2002:", "!!")
            raise _RefusedError(mark, f"the tag {tag:.60} is not allowed here; take it out")
        keys, is_key = open_[-1] if open_ else (None, False)
        if keys is not None:
            open_[-1] = keys, not is_key
        if is_key and keys is not None:
            if not isinstance(event, ScalarEvent):
                raise _RefusedError(
                    mark, "a key must be a name, and this is several values; write one name"
                )
            elif event.value == "<<" and not event.style:
                raise _RefusedError(
                    mark, "the merge key << is not allowed here; write its values out"
                )
            elif event.value in keys:
                raise _RefusedError(
                    mark, f"the key {event.value[:64]!r} is written twice; remove one of them"
                )
            else:
                keys.add(event.value)
        if isinstance(event, CollectionStartEvent):
            a_mapping = isinstance(event, MappingStartEvent)
            open_.append((set() if a_mapping else None, a_mapping))
            if len(open_) > MAX_DEPTH:
                raise _RefusedError(
                    mark, f"nested deeper than {MAX_DEPTH} levels; is this the right file?"
                )
        elif isinstance(event, ScalarEvent) and not _is_text(event.value):
            raise _RefusedError(
                mark, "half a character is written here as \\u; write the character itself"
            )
        elif isinstance(event, ScalarEvent) and not event.style and _HUGE.fullmatch(event.value):
            raise _RefusedError(
                mark, f"this number has {len(event.value):,} digits; is this the right file?"
            )


def _is_text(value: str) -> bool:
    """Whether a text is free of unpaired surrogates, which no file can hold."""
    return value.isascii() or not any("\ud800" <= character <= "\udfff" for character in value)


def dump_yaml(data: Any, width: int = 100) -> str:
    """Data as YAML text; long lists and mappings are broken into lines."""
    stream = io.StringIO()
    yaml = yaml_parser()
    yaml.width = width
    yaml.dump(data, stream)
    return stream.getvalue()


def plain(node: Any) -> Any:
    """Builtin dicts, lists and scalars, so that pydantic's messages name familiar types."""
    if isinstance(node, Mapping):
        return {plain(key): plain(value) for key, value in node.items()}
    if isinstance(node, Sequence) and not isinstance(node, str):
        return [plain(value) for value in node]
    for kind in (bool, int, float, str):
        if isinstance(node, kind):
            return kind(node)
    return node


# -- edits that leave everything else unchanged ---------------------------------------------------

Edit = tuple[int, int, str]
"""First character, the one after the last, and the new text."""


def styled(data: Any, depth: int = 0, block: int = 2) -> Any:
    """Data to be dumped in block style down to a depth, and in flow style below."""
    from ruamel.yaml.comments import CommentedMap, CommentedSeq

    if isinstance(data, Mapping):
        node: Any = CommentedMap(
            (key, styled(value, depth + 1, block)) for key, value in data.items()
        )
    elif isinstance(data, Sequence) and not isinstance(data, str):
        node = CommentedSeq(styled(value, depth + 1, block) for value in data)
    else:
        return data
    if depth >= block or isinstance(data, Sequence):
        node.fa.set_flow_style()
    return node


def rewritten(text: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    r"""YAML text with the differences between two states of its content applied.

    Args:
        text: A YAML mapping. It may contain more than ``before``, such as defaults; that stays.
        before: The present content, as nested mappings, lists and scalars.
        after: The new content. The caller has to verify it, as defaults written out can contradict.

    Example:
        >>> print(rewritten("a: 1  # one\nb: 2\n", {"a": 1, "b": 2}, {"a": 3, "b": 2}), end="")
        a: 3  # one
        b: 2
    """
    root = yaml_parser().compose(text)
    newline = "\r\n" if "\r\n" in text else "\n"
    pieces, position = [], 0
    for start, end, new in sorted(_edits(text, root, before, after, 0), key=lambda edit: edit[:2]):
        pieces += [text[position:start], new.replace("\n", newline)]
        position = max(position, end)
    return "".join([*pieces, text[position:]])


def _edits(text: str, node: Any, before: Any, after: Any, depth: int) -> Iterator[Edit]:
    """The edits that turn the value of one node into ``after``."""
    from ruamel.yaml.nodes import MappingNode, SequenceNode

    block = not getattr(node, "flow_style", True)
    if block and isinstance(node, MappingNode) and isinstance(after, Mapping):
        entries = {key.value: (key, value) for key, value in node.value}
        known = before if isinstance(before, Mapping) else {}
        yield from (
            _without(text, *entries[key]) for key in known if key not in after and key in entries
        )
        last = list(entries.values())[-1]
        for key, value in after.items():
            if key not in entries:
                indent = " " * last[0].start_mark.column
                yield _line_after(text, last[1], indent + _in_line({key: value}, depth))
                continue
            last = entries[key]
            if known.get(key) != value:
                yield from _edits(text, last[1], known.get(key), value, depth + 1)
    elif block and isinstance(node, SequenceNode) and isinstance(after, list):
        items = {item.value: item for item in node.value}
        yield from (_without(text, item, item) for key, item in items.items() if key not in after)
        last_item = node.value[-1]
        indent = " " * node.start_mark.column
        for key in after:
            if key not in items:
                yield _line_after(text, last_item, f"{indent}- {key}\n")
    else:
        start, end = node.start_mark.index, _end(text, node)
        yield start, end, _in_line({"_": after}, block=0).removeprefix("{_: ")[:-2]


def _in_line(data: Mapping[str, Any], depth: int = 0, block: int = 2) -> str:
    """Data as YAML text without line breaks inside."""
    return dump_yaml(styled(data, depth, block), width=1_000_000)


def _end(text: str, node: Any) -> int:
    """The end of a node: the character after its last, comments excluded."""
    block = not getattr(node, "flow_style", True)
    if block:
        last = node.value[-1]
        return _end(text, last[1] if isinstance(last, tuple) else last)
    end: int = node.end_mark.index
    return node.start_mark.index + len(text[node.start_mark.index : end].rstrip(" \t\r\n"))


def _line_after(text: str, node: Any, line: str) -> Edit:
    """An edit that adds a line below the last one of a node."""
    at = text.find("\n", _end(text, node)) + 1
    return (at, at, line) if at else (len(text), len(text), "\n" + line)


def _without(text: str, first: Any, last: Any) -> Edit:
    """An edit that removes the lines of an entry, with its comment at the end of the line."""
    start = text.rfind("\n", 0, first.start_mark.index) + 1
    end = text.find("\n", _end(text, last)) + 1
    return start, end or len(text), ""
