"""The data card of a bundle: what a person asks before using data, in sentences."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from jinja2 import Template

from causal_openlock.experiment.beside_record import answers_schema, reactions_schema
from causal_openlock.experiment.declare import PERSON
from causal_openlock.experiment.record import played, record_schema
from causal_openlock.storage.stored import StoredExperiment

if TYPE_CHECKING:
    import pyarrow as pa

COLUMNS = {"cells": record_schema, "reactions": reactions_schema, "structures": answers_schema}
"""Columns of the tables of a results folder, by their folder."""


def data_card(
    experiment: StoredExperiment, record: pa.Table, contents: Mapping[str, bytes], licence: str = ""
) -> str:
    """The data card of a bundle, in Markdown.

    Args:
        experiment: What was run.
        record: ``learner``, ``condition``, ``subject`` and ``phase`` of every attempt.
        contents: The bundle's files by their paths in it.
        licence: Under what the data may be used; an SPDX identifier or an address.
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
            folder: [(column.name, column.metadata[b"meaning"].decode()) for column in columns()]
            for folder, columns in COLUMNS.items()
            if any(path.startswith(f"results/{folder}/") for path in contents)
        },
        consents=[path for path in sorted(contents) if path.startswith("results/consent_")],
    )
