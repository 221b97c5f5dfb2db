"""Edits of a YAML file that leave everything else in it unchanged.

Dumping a parsed file moves or loses comments. So a change is made in the text: the parser gives the
start and end of each value, and only those characters are replaced. Additions are written in the
style of :func:`styled`: keys on lines of their own, their values on one line.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from causal_openlock.files.yaml_file import dump_yaml, yaml_parser

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
