"""The experiment of a results folder: what :meth:`Experiment.as_dict` gives, and its cells.

Reading it imports no code that it names, and stored parameters stay as they are.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import field
from typing import Annotated, Any

from pydantic import AliasChoices, Field, ValidationError

from causal_openlock.errors import StoreError, in_short
from causal_openlock.experiment.declare import Experiment
from causal_openlock.files.validation import adapter, errors_of, part
from causal_openlock.storage.versions import Versions


@part(kw_only=True)
class StoredExperiment(Experiment):
    """An experiment read from a results folder, with the state of its cells."""

    identity: str = ""  #: its identity when it was run
    files: Annotated[tuple[str, ...], Field(validation_alias=AliasChoices("cells", "files"))] = ()
    """Names of the files of its cells."""
    versions: Versions = field(default_factory=dict)  #: that it, or its record, was made with
    missing: tuple[str, ...] = ()  #: names of the missing cells
    failures: Mapping[str, str] = field(default_factory=dict)  #: why, by the name of the cell
    not_applicable: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """By learner and condition, why the learner could not play it."""
    excluded: Mapping[str, int] = field(default_factory=dict)
    """By the label of people, how many of them an analysis leaves out."""
    warned: tuple[str, ...] = ()  #: warnings while its cells were played


def parse_experiment(data: Mapping[str, Any]) -> StoredExperiment:
    """The experiment in the content of ``experiment.json``."""
    try:
        stored: StoredExperiment = adapter(StoredExperiment).validate_json(
            json.dumps(data), context={"recorded": True}
        )
        return stored
    except ValidationError as error:
        fault = errors_of(error, StoredExperiment)[0]
        if not fault.at:
            raise StoreError("it is nested too deeply, or holds text that is not Unicode") from None
        raise StoreError(f"{'.'.join(map(str, fault.at))}: {fault}") from None
    except (LookupError, TypeError, AttributeError) as error:
        raise StoreError(f"it holds something else ({in_short(error)})") from None
