"""The file that declares a meta-training: on which rooms, and how."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from causal_openlock.contract.parameters import Count, NotNegative, Positive, Share, Whole
from causal_openlock.errors import ExperimentError
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import read_document
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Schema
from openlock_learners.meta.random_schemas import random_schemas
from openlock_learners.networks.recurrent_policy import Sizes


class RandomSchemas(StrictModel):
    """Random schemas: any acyclic graph of levers and a door, with gates."""

    number: Count
    levers: Annotated[list[Annotated[int, Field(ge=2, le=7)]], Field(min_length=1)]
    seed: Whole | None = None  # by default that of the training
    weight: Positive = 1.0  # of all of them together


class RoomsFile(StrictModel):
    """The distribution of rooms."""

    schemas: dict[str, Positive] = Field(default_factory=dict)  # name or path: weight
    random_schemas: RandomSchemas | None = None
    excluded_layouts: Literal["published"] = "published"  # at whose positions levers never stand
    attempt_limit: Count = 30
    # Fewest and most in a life.
    trials: Annotated[list[Count], Field(min_length=2, max_length=2)] = Field(
        default_factory=lambda: [1, 7]
    )
    change: Share = 0.15  # chance that a trial has another schema
    # Reward functions to perceive, one in each life.
    rewards: Annotated[list[str], Field(min_length=1)]


class TrainingFile(StrictModel):
    """A meta-training."""

    seed: Whole = 0
    rooms: RoomsFile
    action_cost: NotNegative = 0.02  # a new solution earns 1
    at_once: Count = 512  # rooms
    steps: Count = 45  # of each room, in a rollout
    actions: Count = 20_000_000  # of all rooms together, in all
    network: Sizes = Sizes()
    learning_rate: Positive = 0.002  # at first; it falls to a tenth
    gamma: Share = 0.95
    credit: Literal["trial", "life"] = "trial"  # where returns end
    decay: Share = 0.95  # lambda of the advantage estimate
    clip: Positive = 0.2
    epochs: Count = 2
    minibatches: Count = 4
    entropy_start: NotNegative = 0.01
    entropy_end: NotNegative = 0.001

    def schemas(self, beside: Path) -> dict[Schema, float]:
        """How often each schema is drawn; a name is searched in the folder ``beside`` first."""
        rooms, drawn = self.rooms, self.rooms.random_schemas
        weights = {find_schema(name, [beside]): weight for name, weight in rooms.schemas.items()}
        if drawn:
            seed = self.seed if drawn.seed is None else drawn.seed
            made = random_schemas(drawn.number, drawn.levers, seed)
            weights |= dict.fromkeys(made, drawn.weight / drawn.number)
        if not weights:
            raise ExperimentError("there is no schema to train with; add one under rooms: schemas:")
        if rooms.trials[0] > rooms.trials[1]:
            raise ExperimentError("rooms: trials: are the fewest and the most; write [1, 7]")
        return weights


def read_training(path: Path | str) -> TrainingFile:
    """Read a file that declares a meta-training.

    Raises:
        FileError: With line, column and remedy of every fault.
    """
    return read_document(path).validate(TrainingFile)
