"""The file that declares a meta-training: on which rooms, and how."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from causal_openlock.contract.parameters import Count, Share
from causal_openlock.errors import ExperimentError
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import read_document
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import nearest
from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import PAPER_POSITIONS
from openlock_learners.meta.random_schemas import random_schemas
from openlock_learners.networks.recurrent_policy import Sizes


class RandomSchemas(StrictModel):
    """Random schemas: any acyclic graph of levers and a door, with gates."""

    number: Count
    levers: Annotated[list[Annotated[int, Field(ge=2, le=7)]], Field(min_length=1)]
    seed: Annotated[int | None, Field(ge=0, description="By default that of the training.")] = None
    weight: Annotated[float, Field(gt=0, description="Weight of all of them together.")] = 1.0
    excluded: Annotated[
        list[str], Field(description="Schemas; none of them behaves as one of these.")
    ] = Field(default_factory=list)
    solutions: Annotated[
        dict[int, Count] | None,
        Field(description="Number of levers: how many solutions a schema with that number has."),
    ] = None


class RoomsFile(StrictModel):
    """The distribution of rooms."""

    schemas: Annotated[
        dict[str, Annotated[float, Field(gt=0)]],
        Field(description="Name or path of a schema: its weight."),
    ] = Field(default_factory=dict)
    random_schemas: RandomSchemas | None = None
    excluded_layouts: Annotated[
        Literal["published"] | list[str],
        Field(description="Layouts; levers never stand at exactly the positions of one."),
    ] = "published"
    attempt_limit: Count = 30
    trials: Annotated[
        list[Count],
        Field(min_length=2, max_length=2, description="Fewest and most in a life."),
    ] = Field(default_factory=lambda: [1, 7])
    change: Annotated[Share, Field(description="Chance that a trial has another schema.")] = 0.15
    rewards: Annotated[
        list[str],
        Field(min_length=1, description="Reward functions to perceive, one in each life."),
    ]


class TrainingFile(StrictModel):
    """A meta-training."""

    seed: Annotated[int, Field(ge=0)] = 0
    rooms: RoomsFile
    action_cost: Annotated[
        float, Field(ge=0, description="Of every action; a new solution earns 1.")
    ] = 0.02
    at_once: Annotated[Count, Field(description="Rooms at a time.")] = 512
    steps: Annotated[Count, Field(description="Of each room, in a rollout.")] = 45
    actions: Annotated[Count, Field(description="Of all rooms together, in all.")] = 20_000_000
    network: Sizes = Field(default_factory=Sizes)
    learning_rate: Annotated[float, Field(gt=0, description="At first; it falls to a tenth.")] = (
        0.002
    )
    gamma: Share = 0.95
    credit: Annotated[
        Literal["trial", "life"], Field(description="Where returns end: with the trial, or later.")
    ] = "trial"
    decay: Share = 0.95
    clip: Annotated[float, Field(gt=0)] = 0.2
    epochs: Count = 2
    minibatches: Count = 4
    entropy_start: Annotated[float, Field(ge=0)] = 0.01
    entropy_end: Annotated[float, Field(ge=0)] = 0.001

    def schemas(self, beside: Path) -> dict[Schema, float]:
        """How often each schema is drawn; a name is searched in the folder ``beside`` first."""
        rooms, drawn = self.rooms, self.rooms.random_schemas
        weights = {find_schema(name, [beside]): weight for name, weight in rooms.schemas.items()}
        if drawn:
            others = [find_schema(name, [beside]) for name in drawn.excluded]
            seed = self.seed if drawn.seed is None else drawn.seed
            made = random_schemas(drawn.number, drawn.levers, seed, others, drawn.solutions)
            weights |= dict.fromkeys(made, drawn.weight / drawn.number)
        if not weights:
            raise ExperimentError("there is no schema to train with; add one under rooms: schemas:")
        if rooms.trials[0] > rooms.trials[1]:
            raise ExperimentError("rooms: trials: are the fewest and the most; write [1, 7]")
        return weights


def excluded_places(names: str | Sequence[str]) -> frozenset[frozenset[int]]:
    """The sets of positions at which these published layouts have their levers.

    To leave out these sets is to leave out more than these layouts: the same levers in any other
    order, and any other schema there.
    """
    known = room_facts()["layouts"]
    listed = known if names == "published" else names
    for name in listed:
        if name not in known:
            raise ExperimentError(f"there is no layout {name!r}; {nearest(name, known)}")
    return frozenset(
        frozenset(PAPER_POSITIONS.index(place) for place in known[name].values()) for name in listed
    )


def read_training(path: Path | str) -> TrainingFile:
    """Read a file that declares a meta-training.

    Raises:
        FileError: With line, column and remedy of every fault.
    """
    return read_document(path).validate(TrainingFile)
