"""Ways to spoil a file: bytes, text, JSON, archives of arrays and Parquet.

Where a file has a checksum, changed bytes are refused before anything is read, which says little
of the reader behind it. So values are changed too, and the checksum is made anew: what somebody
could send on purpose. All randomness comes from the generator that is passed in.
"""

from __future__ import annotations

import copy
import io
import json
import random
import re
import zipfile
import zlib
from collections.abc import Sequence
from tokenize import TokenError
from typing import Any

import numpy as np

NUMBERS = (
    *("0", "-1", "1", "2", "99", "1e9", "-0.0", "1e309", "-1e-320", "nan", ".inf", "Infinity"),
    *("2147483648", "9007199254740993", "9223372036854775808", "1" * 400, "0x1F", "0o17", "1_000"),
    *("1.5", "0.30000000000000004", "5000", "1000000000", "١٢", "٣.٥"),
)
SNIPPETS = (
    *" \n\t:,-?&*!|>%@`#[]{}'\"\\~=_;()<>/",
    *("\n  ", ": ", "- ", "? ", "<<: ", "*a", "&a ", "!!set ", "!!python/name:os.system ", "---\n"),
    *("null", "true", "on", "[]", "{}", "''", '""', "\r\n", "\r", "\x00", "\x85", "\u2028"),
    *("\ufeff", "\ud83d\ude00", "é", "\x1b[2J", "\\u0000", "\\ud800", "\\x41", "|\n", ">-\n"),
    *("->", "<-", "--", "<->", "digraph {", "graph [", "subgraph x {", "strict ", "/*", "*/", "//"),
    *("door", "L0", "L1", "levers", "edges", "gates", "inert", "any", "all", "at_least", "2 of ("),
    *("name", "title", "CC3", "CC4", "CC3-CE4", "trial1", "random", "published", "human", "rl"),
    *("../", "/dev/null", "C:\\x", "a" * 300, "%s", "{0}", "{file}", "$HOME", "node [", "edge ["),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2**31, 2**53 + 1, 2**63, 10**30, 0.5, -0.0, 1e308, float("nan")),
    *(float("inf"), "", "x", "CC4", "door", "random", "../x", "\x00", "\ud800", "é" * 50, "1"),
    *([], [[]], [None], {}, {"": None}, {"a": {"b": []}}, ["dict", []], ["array", "a0"], [0, 1, 2]),
)
MOST = 1 << 17
"""Most bytes of a spoiled text: a little more than readers accept."""


def spoil_bytes(content: bytes, rng: random.Random) -> bytes:
    """Change, remove, repeat or cut off a few bytes."""
    changed = bytearray(content)
    for _ in range(rng.choice((1, 1, 2, 8))):
        at = rng.randrange(len(changed) + 1)
        match rng.randrange(6):
            case 0 if changed:
                changed[at % len(changed)] ^= 1 << rng.randrange(8)
            case 1 if changed:
                changed[at % len(changed)] = rng.choice((0, 1, 0x7F, 0x80, 0xFF))
            case 2:
                del changed[at : at + rng.choice((1, 2, 8, 64))]
            case 3:
                changed[at:at] = changed[at : at + rng.choice((1, 4, 32))] * rng.choice((1, 2, 9))
            case 4:
                changed[at:at] = rng.randbytes(rng.choice((1, 4, 16)))
            case 5 if rng.random() < 0.3:
                del changed[at:]
    return bytes(changed)


def spoil_text(content: bytes, rng: random.Random, others: Sequence[bytes] = ()) -> bytes:
    """Change pieces of a text; ``others`` are texts of the same kind to take pieces from."""
    if rng.random() < 0.05:
        return spoil_bytes(content, rng)
    text = content.decode("utf-8", "replace")
    for _ in range(rng.choice((1, 1, 2, 3, 6))):
        text = _spoiled(text, rng, others)
    return text.encode("utf-8", "surrogatepass")[:MOST]


def _spoiled(text: str, rng: random.Random, others: Sequence[bytes]) -> str:
    start = rng.randrange(len(text) + 1)
    end = min(len(text), start + rng.choice((0, 0, 1, 2, 5, 12, 40)))
    match rng.randrange(10):
        case 0:
            return text[:start] + text[end:]
        case 1 | 2:
            return text[:start] + rng.choice(SNIPPETS) + text[end:]
        case 3:
            return text[:end] + text[start:end] * rng.choice((1, 1, 2, 40)) + text[end:]
        case 4 if others:
            other = rng.choice(others).decode("utf-8", "replace")
            at = rng.randrange(len(other) + 1)
            return text[:start] + other[at : at + rng.choice((3, 20, 200))] + text[end:]
        case 5:
            return _number_changed(text, rng)
        case 6 | 7:
            return _word_changed(text, rng)
        case 8:
            return _lines_changed(text, rng)
        case 9 if rng.random() < 0.2:
            # Deep, wide or long: what a reader that calls itself or goes back would choke on.
            piece = rng.choice(
                ("[", "{", "(", "- ", '"', "\\", "a ", "{a: ", "[[", " ", "a->", "&")
            )
            return text[:start] + piece * rng.choice((20, 500, 20_000)) + text[end:]
    return text[:start] + chr(rng.choice((rng.randrange(128), rng.randrange(0x3000)))) + text[end:]


def _number_changed(text: str, rng: random.Random) -> str:
    found = [*re.finditer(r"-?\d+\.?\d*", text)]
    if not found:
        return text + rng.choice(NUMBERS)
    one = rng.choice(found)
    return text[: one.start()] + rng.choice(NUMBERS) + text[one.end() :]


def _word_changed(text: str, rng: random.Random) -> str:
    """Exchange a word for another one of the text, or take it out."""
    found = [*re.finditer(r"\w+", text)]
    if not found:
        return text
    one, other = rng.choice(found), rng.choice(found)
    word = rng.choice((other[0], other[0], "", one[0] * 2, rng.choice(SNIPPETS)))
    return text[: one.start()] + word + text[one.end() :]


def _lines_changed(text: str, rng: random.Random) -> str:
    lines = text.split("\n")
    one, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    match rng.randrange(4):
        case 0:
            del lines[one]
        case 1:
            lines.insert(other, lines[one])
        case 2:
            lines[one], lines[other] = lines[other], lines[one]
        case 3:
            lines[one] = " " * rng.choice((1, 2, 4)) + lines[one]
    return "\n".join(lines)


def spoil_value(data: Any, rng: random.Random) -> Any:
    """Change a few values somewhere in nested lists and mappings."""
    data = copy.deepcopy(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        holders = [*_holders(data)]
        if not holders:
            return rng.choice(VALUES)
        # As often near the root as in the leaves, of which there are far more.
        depth = rng.choice(sorted({level for level, _ in holders}))
        holder = rng.choice([one for level, one in holders if level == depth])
        key = rng.choice([*(holder if isinstance(holder, dict) else range(len(holder)))])
        match rng.randrange(6):
            case 0:
                del holder[key]
            case 1 | 2:
                holder[key] = copy.deepcopy(rng.choice(VALUES))
            case 3:
                other = rng.choice(holders)[1]
                holder[key] = copy.deepcopy(rng.choice([*_parts(other)]))
            case 4 if isinstance(holder, dict):
                holder[rng.choice(("", "x", "name", str(key) * 2))] = holder.pop(key)
            case 4:
                holder.insert(rng.randrange(len(holder) + 1), copy.deepcopy(holder[key]))
            case 5:
                holder[key] = _altered(holder[key], rng)
    return data


def _holders(data: Any, level: int = 0) -> Any:
    """All lists and mappings that hold something, with their depth."""
    if isinstance(data, dict | list) and data:
        yield level, data
        for part in _parts(data):
            yield from _holders(part, level + 1)


def _parts(data: Any) -> Any:
    return data.values() if isinstance(data, dict) else data


def _altered(value: Any, rng: random.Random) -> Any:
    """A value of the same type."""
    if isinstance(value, bool) or value is None:
        return not value
    if isinstance(value, int):
        return rng.choice((value + 1, value - 1, -value, value * 1000, 2**40))
    if isinstance(value, float):
        return rng.choice((-value, value * 1e6, float("nan"), 0.0))
    if isinstance(value, str):
        return _spoiled(value, rng, ())
    return [value]


def spoil_json(data: Any, rng: random.Random) -> Any:
    """The same, and what JSON cannot hold is left out."""
    while True:
        changed = spoil_value(data, rng)
        try:
            json.dumps(changed).encode()
        except (ValueError, TypeError):
            continue
        return changed


def spoil_archive(content: bytes, rng: random.Random) -> bytes:
    """Change arrays of an ``.npz`` file: a text in JSON, a header, the numbers, or which there are.

    A third of the time only bytes of the archive.
    """
    if rng.random() < 0.33:
        return spoil_bytes(content, rng)
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        members = {one: file.read(one) for one in file.namelist()}
    for _ in range(rng.choice((1, 1, 2))):
        name = rng.choice([*members, *(one for one in members if "a" not in one[1:-4])])
        match rng.randrange(5):
            case 0:
                members[name] = spoil_bytes(members[name], rng)
            case 1:
                head = spoil_text(members[name][10:128], rng)[:118]
                members[name] = members[name][:10] + head + members[name][128:]
            case 2:
                members[name] = members[rng.choice([*members])]
            case 3:
                members[rng.choice(("x.npy", "a0.npy", "a", "../a.npy"))] = members.pop(name)
            case 4:
                members |= _outline_changed(members, rng)
        if not members:
            break
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", rng.choice((zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as file:
        for name, held in members.items():
            file.writestr(name, held)
    return made.getvalue()


def _outline_changed(members: dict[str, bytes], rng: random.Random) -> dict[str, bytes]:
    """Another JSON text in place of that of ``outline`` or ``about``."""
    for name in ("outline.npy", "about.npy"):
        if name not in members:
            continue
        try:
            held = np.load(io.BytesIO(members[name]), allow_pickle=False)
            text = held.tobytes().decode() if name == "outline.npy" else str(held)
            text = json.dumps(spoil_json(json.loads(text), rng))
        except (ValueError, OSError, EOFError, TokenError):  # spoiled before
            return {}
        array = np.frombuffer(text.encode(), np.uint8) if name == "outline.npy" else np.array(text)
        made = io.BytesIO()
        np.save(made, array)
        return {name: made.getvalue()}
    return {}


def spoil_log(content: bytes, rng: random.Random) -> bytes:
    """Change entries of a log of people's actions, or their order; checksums of lines fit."""
    if rng.random() < 0.2:
        return spoil_bytes(content, rng)
    lines = content.splitlines()
    for _ in range(rng.choice((1, 1, 2))):
        at = rng.randrange(len(lines))
        match rng.randrange(4):
            case 0:
                lines.insert(rng.randrange(len(lines) + 1), lines[at])
            case 1 if len(lines) > 1:
                del lines[at]
            case _:
                entry = json.loads(lines[at].rpartition(b"\t")[0])
                text = json.dumps(spoil_json(entry, rng), separators=(",", ":")).encode()
                lines[at] = b"%b\t%08x" % (text, zlib.crc32(text))
    return b"".join(line + b"\n" for line in lines)


def spoil_table(content: bytes, rng: random.Random) -> bytes:
    """Change a Parquet file: its columns, values or metadata, or its bytes; the checksum fits.

    A fifth of the time it does not.
    """
    import pyarrow as pa

    from causal_openlock.files.checksums import BLANK, IN_PARQUET, fill_in, read_table, table_bytes

    kind = rng.random()
    if kind < 0.2:
        return spoil_bytes(content, rng)
    if kind < 0.6:
        place = content.rindex(IN_PARQUET) + len(IN_PARQUET)
        blank = content[:place] + BLANK + content[place + len(BLANK) :]
        changed = spoil_bytes(blank, rng)
        return fill_in(changed, IN_PARQUET) if IN_PARQUET + BLANK in changed else changed
    table = read_table(content)
    about = dict(table.schema.metadata or {})
    at = rng.randrange(table.num_columns)
    name, rows = table.column_names[at], table.num_rows
    match rng.randrange(7):
        case 0:
            table = table.drop_columns([name])
        case 1:
            table = table.append_column(rng.choice((name, "x")), table.column(at))
        case 2:
            held = [rng.choice(VALUES[:4]) for _ in range(rows)]
            table = table.set_column(at, name, pa.array([str(one) for one in held]))
        case 3:
            values = table.column(at).to_pylist()
            values[rng.randrange(rows)] = None
            table = table.set_column(at, name, pa.array(values))
        case 4:
            table = table.slice(0, rng.randrange(rows))
        case 5:
            about = {
                key: spoil_text(value, rng) if rng.random() < 0.5 else value
                for key, value in about.items()
            }
        case 6:
            table = table.set_column(
                at, name, pa.array(range(rows), rng.choice((pa.int64(), pa.float64())))
            )
    return table_bytes(table, about)
