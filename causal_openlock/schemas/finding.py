"""Finding schemas: by name in folders and in the package, or in a file of any format."""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from causal_openlock.errors import OpenLockError
from causal_openlock.schemas.graphs import FORMATS, read_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import nearest

PACKAGE = Path(__file__).parents[1]
SUFFIXES = tuple(suffix for format in FORMATS.values() for suffix in format.suffixes)
"""Suffixes of files that a schema can be read from or written to."""


def bundled(kind: str) -> Path:
    """Path of a bundled part: ``schemas``, ``experiments``, ``notebooks``, ``CITATION.cff``.

    In a checkout it is next to the package, in an installed wheel inside it.
    """
    inside = PACKAGE / "bundled" / kind
    return inside if inside.exists() else PACKAGE.parent / kind


def find_schema(name: str | os.PathLike[str] | Schema, beside: Iterable[Path] = ()) -> Schema:
    """A schema by name or path.

    Args:
        name: The path of a file of any format (``.yaml``, ``.dot``, ``.gml``), the name of a file
            ``NAME.yaml`` in one of the folders searched, or a schema, which is returned as it is.
        beside: Folders to search first, such as that of the experiment, then the working
            directory; then a folder ``schemas`` in each of them, and last the bundled schemas.

    Raises:
        FileError, SchemaError: If the file has faults.
        OpenLockError: If there is no such schema; the message names the nearest.

    Example:
        >>> find_schema("CC4").title
        'Common cause, four levers'
    """
    if isinstance(name, Schema):
        return name
    if not isinstance(name, str | os.PathLike):
        raise OpenLockError(
            f"a schema is given by its name, the path of a file or a Schema, not by {name!r:.64}"
        )
    text = os.fspath(name)
    folders = [*map(Path, beside), Path()]
    if text.lower().endswith(SUFFIXES):
        for folder in folders:
            if _is_file(folder / text):
                return read_schema(folder / text)
        return read_schema(text)
    collections = [*(folder / "schemas" for folder in folders), bundled("schemas")]
    for folder in [*folders, *collections]:
        if _is_file(folder / f"{text}.yaml"):
            read = _bundled_schema if folder is collections[-1] else read_schema
            return read(folder / f"{text}.yaml")
    known = {path.stem for folder in collections for path in folder.glob("*.yaml")}
    raise OpenLockError(
        f"there is no schema {text!r:.64}; {nearest(text[:64], known)}, or give the path of a file"
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # an invalid name
        return False


_bundled_schema = cache(read_schema)


def bundled_schemas() -> dict[str, Schema]:
    """The schemas that come with the package by name, the paper's four first."""
    paths = {path.stem: path for path in sorted(bundled("schemas").glob("*.yaml"))}
    names = dict.fromkeys(["CC3", "CE3", "CC4", "CE4", *paths])
    return {name: _bundled_schema(paths[name]) for name in names}
