"""YAML files written by hand, with line and column for every fault.

What nobody writes by hand is refused: more than 128 kB, and the parts of YAML 1.2 that are
ambiguous or make a small file large (anchors, aliases, merge keys, tags, keys that are not names,
several documents in one file).

>>> Document("name: CC3").data["name"]
'CC3'
"""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from causal_openlock.errors import Fault, FileError, OpenLockError, together
from causal_openlock.files.validation import Where, adapter, described, errors_of

Model = TypeVar("Model")

MAX_BYTES = 128 * 1024
_KINDS = ("str", "int", "float", "bool", "null", "timestamp", "seq", "map")


class Document:
    """A parsed YAML file that remembers the place of everything.

    Attributes:
        path: The file, which faults name.
        data: Its content as dicts, lists and scalars.
        places: Line and column, from 1, by the path of keys and indices as texts; names in a list
            are known by their text as well.

    Raises:
        FileError: If it is not YAML 1.2, or uses what is refused here.
    """

    def __init__(self, text: str, path: Path | str = "<text>") -> None:
        from ruamel.yaml import YAML
        from ruamel.yaml.error import MarkedYAMLError
        from ruamel.yaml.reader import ReaderError

        self.path = Path(path)
        self.places: dict[tuple[str, ...], tuple[int, int]] = {(): (1, 1)}
        self._yaml = YAML(typ="safe", pure=True)
        try:
            root = self._yaml.compose(text)
            self.data: Any = root and self._content(root, ())
            return
        except FileError:
            raise
        except MarkedYAMLError as error:
            problem = ", ".join(filter(None, (error.context, error.problem)))
            message = f"this is not valid YAML: {problem}; correct this line or the one before it"
            fault = Fault(*_place(error.problem_mark or error.context_mark), message)
        except ReaderError as error:
            message = f"the character U+{ord(text[error.position]):04X} is not allowed; take it out"
            fault = _fault_after(text[: error.position], message)
        except RecursionError:
            fault = Fault(1, 1, "this is nested too deeply; is it the right file?")
        except (AssertionError, ValueError, OverflowError):  # of ruamel.yaml
            message = "this is not YAML 1.2: correct %YAML, or a \\U that is beyond all characters"
            fault = Fault(1, 1, message)
        raise FileError(path, [fault])

    def _content(self, node: Any, where: tuple[str, ...]) -> Any:
        """What a node of ruamel.yaml holds; the place of each part is noted."""
        kind = str(node.tag).removeprefix("tag:yaml.org,2002:")
        if node.anchor:
            raise self._refused(node, f"the anchor &{node.anchor:.40} is not allowed; take it out")
        if kind not in _KINDS:
            said = "<<" if kind == "merge" else f"!!{kind:.60}"
            raise self._refused(node, f"{said} is not allowed here; write the value out")
        if isinstance(node.value, str):
            try:
                node.value.encode()
                return self._yaml.constructor.construct_object(node)
            except (ValueError, LookupError):  # half a character; a 31st of June; 5,000 digits
                what = f"{described(node.value)} is no text, number or date; correct it"
                raise self._refused(node, what) from None
        if kind == "map":
            return self._entries(node, where)
        items: list[Any] = []
        for item in node.value:
            below = (*where, str(len(items)))
            self.places[below] = _place(item.start_mark)
            items.append(self._content(item, below))
            if isinstance(item.value, str):
                self.places.setdefault((*where, item.value), self.places[below])
        return items

    def _entries(self, node: Any, where: tuple[str, ...]) -> dict[Any, Any]:
        entries: dict[Any, Any] = {}
        for key, value in node.value:
            name = self._content(key, where)
            if not isinstance(key.value, str):
                raise self._refused(key, "a key must be a name, and this is several; write one")
            below = (*where, str(name))
            if below in self.places:
                raise self._refused(key, f"the key {key.value!r:.64} is written twice; remove one")
            self.places[below] = _place(key.start_mark)
            entries[name] = self._content(value, below)
        return entries

    def _refused(self, node: Any, message: str) -> FileError:
        return FileError(self.path, [Fault(*_place(node.start_mark), message)])

    def validate(
        self,
        kind: type[Model],
        data: Any = None,
        context: dict[str, Any] | None = None,
        changed: Iterable[str] = (),
    ) -> Model:
        """The content as a model or a part; pydantic passes ``context`` to validators.

        ``data`` is the content if something in it is changed; faults of the keys that are
        ``changed`` have no place in the file.

        Raises:
            FileError: With one fault for every value that is refused.
            OpenLockError: The same, together with faults of other files, or of what is changed.
        """
        try:
            content = self.data if data is None else data
            checked: Model = adapter(kind).validate_python(content, context=context)  # type: ignore[arg-type]
            return checked
        except ValidationError as error:
            errors = errors_of(error, kind)
        elsewhere = [e for e in errors if isinstance(e, FileError) or {*e.at[:1]} & {*changed}]
        here = [Fault(*self._place_of(e.at), str(e)) for e in errors if e not in elsewhere]
        raise together([*elsewhere, *([FileError(self.path, here)] if here else [])])

    def _place_of(self, at: Where) -> tuple[int, int]:
        """Place of the deepest part of a path that the file has."""
        path = tuple(map(str, at))
        while path not in self.places:
            path = path[:-1]
        return self.places[path]


def _place(mark: Any) -> tuple[int, int]:
    """Line and column, from 1, of a mark of ruamel.yaml."""
    return mark.line + 1, mark.column + 1


def _fault_after(before: str, message: str) -> Fault:
    """A fault at the character that follows the text ``before``."""
    lines = before.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return Fault(len(lines), len(lines[-1]) + 1, message)


def read_document(path: Path | str) -> Document:
    """Parse a YAML file written by hand.

    Raises:
        FileError: If it is not YAML 1.2, or uses what is refused here.
        OpenLockError: If it cannot be read.
    """
    return Document(read_text(path), path)


def read_text(path: Path | str) -> str:
    """The text of a file written by hand; refused are large files and other encodings."""
    try:
        with Path(path).open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        message = f"{path!s:.200}: cannot be read ({error.strerror}); check the name"
        raise OpenLockError(message) from None
    except ValueError:
        raise OpenLockError(f"{str(path)!r:.200} is not a name that a file can have") from None
    if len(content) > MAX_BYTES:
        message = f"the file has more than {MAX_BYTES:,} bytes; is this the right file?"
        raise FileError(path, [Fault(1, 1, message)])
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = error.object[: error.start].decode()
        message = "this is not UTF-8 text; save the file as UTF-8"
        raise FileError(path, [_fault_after(before, message)]) from None


def dump_yaml(data: Any, innermost_in_a_line: bool = False) -> str:
    """Data as YAML text; no line is broken."""
    from ruamel.yaml import YAML
    from ruamel.yaml.emitter import Emitter

    class Lossless(Emitter):
        """With quotes where ruamel.yaml forgets them."""

        def choose_scalar_style(self) -> Any:
            quotes = re.search("^\\?|[\x85\u2028\u2029]", self.event.value)
            return '"' if quotes else super().choose_scalar_style()

    yaml = YAML(typ="rt", pure=True)
    yaml.Emitter = Lossless
    yaml.width = sys.maxsize
    yaml.default_flow_style = None if innermost_in_a_line else False
    yaml.indent(mapping=2, sequence=4, offset=2)
    stream = io.StringIO()
    yaml.dump(data, stream)
    return stream.getvalue()
