"""The form of ``experiment.json``: what must be there, and of which type, before anything reads it.

Whoever reads a results folder takes its description at its word: learners have protocols, trials
have schemas, cells are names of files. A file that somebody has edited or made up keeps no such
word, so its form is looked at once, where it is read, and nowhere else.
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from causal_openlock.experiment.from_description import condition_from_dict
from causal_openlock.experiment.protocol import Protocol


class _Part(BaseModel):
    """What is declared here must be there; whatever else there is may be."""

    model_config = ConfigDict(strict=True)


class _Named(_Part):
    name: str


class _Learner(_Named):
    learner: str
    protocol: dict[str, Any]
    parameters: dict[str, Any]
    reward: _Named
    subjects: Annotated[int, Field(ge=1)]
    package: str = ""
    material: str = ""


class _Description(_Named):
    identity: str
    version: str
    title: str
    command: str
    seed: int
    cell_size: int
    learners: list[_Learner]
    conditions: list[_Named]
    cells: list[Any]  # causal_openlock.experiment.inside looks at these


def description_fault(held: Any) -> str | None:
    """What is wrong with the form of a description: where it is, or ``None`` if nothing is."""
    try:
        _Description.model_validate(held)
    except ValidationError as error:
        where = error.errors(include_url=False)[0]["loc"]
        return ".".join(map(str, where)) or "what it holds"
    for number, entry in enumerate(held["learners"]):
        try:
            hash(Protocol(**entry["protocol"]))
        except Exception:  # what is in it may be of any type
            return f"learners.{number}.protocol"
    for number, condition in enumerate(held["conditions"]):
        try:
            hash(condition_from_dict(condition))
        except Exception:
            return f"conditions.{number}"
    return None
