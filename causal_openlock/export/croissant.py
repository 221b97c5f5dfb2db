"""Description of a bundle for programs and for people: Croissant metadata, and a data card.

Croissant (https://docs.mlcommons.org/croissant/docs/croissant-spec.html, version 1.0) is JSON-LD
that catalogues of data sets read: the files with their hashes, and the columns of their tables. The
data card says in sentences what a person asks before using data.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Template

from causal_openlock.experiment.beside_record import answers_schema, reactions_schema
from causal_openlock.experiment.declare import PERSON
from causal_openlock.experiment.record import played, record_schema
from causal_openlock.files.validation import present
from causal_openlock.storage.stored import StoredExperiment

if TYPE_CHECKING:
    import pyarrow as pa

PARQUET = "application/x-parquet"
CONFORMS_TO = "http://mlcommons.org/croissant/1.0"
_CONTEXT = Path(__file__).with_name("croissant_context.json")
"""The terms of Croissant 1.0, as its specification has them."""
_TABLES = {"cells": "attempts", "reactions": "reactions", "structures": "structures"}
"""The tables of a results folder, by their folder."""
_SCHEMAS = {"cells": record_schema, "reactions": reactions_schema, "structures": answers_schema}
"""The columns of these tables."""
_MEANING = {
    "attempts": "What every subject did: a row for each attempt.",
    "reactions": "How long people took: a row for each action.",
    "structures": "What people said of rooms: a row for each pair of levers.",
}


def croissant(
    experiment: StoredExperiment, contents: Mapping[str, bytes], licence: str = ""
) -> dict[str, Any]:
    """Croissant metadata of a bundle, as plain data.

    Args:
        experiment: What was run.
        contents: The bundle's files by their paths in it.
        licence: Under what the data may be used; an SPDX identifier or an address.
    """
    files = [
        {
            "@type": "cr:FileObject",
            "@id": path,
            "name": path,
            "contentUrl": path,
            "encodingFormat": PARQUET if path.endswith(".parquet") else _kind(path),
            "sha256": hashlib.sha256(content).hexdigest(),
        }
        for path, content in sorted(contents.items())
    ]
    tables = _tables(contents)
    sets = [
        {
            "@type": "cr:FileSet",
            "@id": f"{part}-files",
            "name": f"{part}-files",
            "encodingFormat": PARQUET,
            "includes": f"results/{part}/*.parquet",
        }
        for part in tables
    ]
    return present(
        {
            "@context": json.loads(_CONTEXT.read_text("utf-8")),
            "@type": "sc:Dataset",
            "conformsTo": CONFORMS_TO,
            "name": experiment.name,
            "description": " ".join((experiment.title or experiment.name).split()),
            "version": "1.0.0",
            "license": licence or None,
            "distribution": [*files, *sets],
            "recordSet": [_record_set(part) for part in tables],
        }
    )


def _tables(contents: Mapping[str, bytes]) -> list[str]:
    """The folders of the tables that a bundle has."""
    return [part for part in _TABLES if any(one.startswith(f"results/{part}/") for one in contents)]


def _record_set(part: str) -> dict[str, Any]:
    name = _TABLES[part]
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": _MEANING[name],
        "field": [
            present(
                {
                    "@type": "cr:Field",
                    "@id": f"{name}/{field.name}",
                    "name": field.name,
                    "description": meaning_of(field),
                    "dataType": _type(field.type),
                    "repeated": str(field.type).startswith("list") or None,
                    "source": {
                        "fileSet": {"@id": f"{part}-files"},
                        "extract": {"column": field.name},
                    },
                }
            )
            for field in _SCHEMAS[part]()
        ],
    }


def meaning_of(field: pa.Field) -> str:
    """Meaning of a column."""
    meaning: bytes = field.metadata[b"meaning"]
    return meaning.decode()


def _type(kind: pa.DataType) -> str:
    name = str(kind)
    for part, known in (("string", "Text"), ("bool", "Boolean"), ("int", "Integer")):
        if part in name.replace("indices=int32", ""):
            return f"sc:{known}"
    return "sc:Float"


def _kind(path: str) -> str:
    kinds = {
        ".csv": "text/csv",
        ".html": "text/html",
        ".json": "application/json",
        ".md": "text/markdown",
        ".png": "image/png",
        ".pdf": "application/pdf",
        ".svg": "image/svg+xml",
        ".yaml": "application/yaml",
    }
    return kinds.get(Path(path).suffix, "text/plain")


def as_json(metadata: Mapping[str, Any]) -> bytes:
    """Metadata as the content of a file."""
    return (json.dumps(metadata, indent=1, ensure_ascii=False) + "\n").encode()


def data_card(
    experiment: StoredExperiment, record: pa.Table, contents: Mapping[str, bytes], licence: str = ""
) -> str:
    """The data card of a bundle, in Markdown.

    Args:
        experiment: What was run.
        record: ``learner``, ``condition``, ``subject`` and ``phase`` of every attempt.
        contents: The bundle's files by their paths in it.
        licence: Under what the data may be used.
    """
    table = played(record).to_pandas()
    size = {"subjects": ("subject", "nunique"), "attempts": ("subject", "size")}
    grouped = table.groupby(["learner", "condition"], observed=True, sort=False)
    text = Path(__file__).with_name("data_card.md.j2").read_text("utf-8")
    return Template(text, trim_blocks=True, keep_trailing_newline=True).render(
        title=" ".join((experiment.title or experiment.name).split()),
        experiment=experiment,
        played=grouped.agg(**size).reset_index().to_dict("records"),
        people=any(spec.learner == PERSON for spec in experiment.learners),
        protocols=experiment.protocols,
        licence=licence,
        tables={
            part: [(one.name, meaning_of(one)) for one in _SCHEMAS[part]()]
            for part in _tables(contents)
        },
        consents=[path for path in sorted(contents) if path.startswith("results/consent_")],
    )
