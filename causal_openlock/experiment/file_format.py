"""The format of experiment files: pydantic models, and the JSON Schema for editors.

:class:`ExperimentFile` is the whole file; :mod:`~causal_openlock.experiment.file` shows one. The
same models describe learners and conditions that a Python program declares
(:mod:`~causal_openlock.experiment.building`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args, get_type_hints

from pydantic import BaseModel, Discriminator, Field, Tag, create_model, model_validator
from pydantic_core import PydanticCustomError

from causal_openlock.experiment.protocol import Protocol
from causal_openlock.files.validation import StrictModel
from causal_openlock.schemas.schema_file import JSON_SCHEMA_ID
from causal_openlock.world.rewards import PAPER_REWARD, WEIGHTS

Positive = Annotated[int, Field(ge=1)]
Subjects = Annotated[int, Field(ge=1, le=10_000_000)]
NAME_FORM = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
NAME_IN_WORDS = "letters, digits, underscores, dots and dashes, at most 64 in all"
Name = Annotated[str, Field(pattern=NAME_FORM, description=NAME_IN_WORDS)]


def _form(value: Any) -> str:
    """The tag of a union's member, by the type of the value."""
    if isinstance(value, Mapping | BaseModel):
        return "<mapping>"
    return "<list>" if isinstance(value, list) else "<name>"


def _written(*forms: str, but: str = "") -> Discriminator:
    *others, last = (f"a {form}" for form in forms)
    message = f"write {', '.join(others)} or {last} here{but}"
    return Discriminator(_form, custom_error_type="custom.form", custom_error_message=message)


A_NAME, A_LIST, A_MAPPING = Tag("<name>"), Tag("<list>"), Tag("<mapping>")


def _maybe(kind: Any, meaning: str) -> tuple[Any, None]:
    return Annotated[kind | None, Field(description=meaning)], None


_CHANGES: dict[str, Any] = {
    "preset": _maybe(str, "Preset that is changed; by default the paper's reward."),
    "terms": _maybe(list[str], "Terms that add up, instead of a preset."),
    **{
        name: _maybe(Annotated[float, Field(allow_inf_nan=False)], meaning)
        for name, meaning in WEIGHTS.items()
    },
}
RewardWeights = create_model("RewardWeights", __base__=StrictModel, **_CHANGES)
RewardWeights.__doc__ = "A reward with other weights."
RewardName = Annotated[
    Annotated[str, A_NAME] | Annotated[list[str], A_LIST] | Annotated[RewardWeights, A_MAPPING],
    _written("name", "list of terms", "mapping of weights"),
]
LayoutEntry = Annotated[
    Annotated[str, A_NAME] | Annotated[dict[str, str], A_MAPPING],
    _written("name such as trial1", "mapping such as {L0: LEFT}"),
]


ONLY_TRAIN = "only the whole of train can be shown, as in train: {shown: CC3}"


class TrialsFile(StrictModel):
    """Trials in rooms of one schema."""

    @model_validator(mode="before")
    @classmethod
    def _are_played(cls, data: Any) -> Any:
        if isinstance(data, Mapping) and "shown" in data:
            raise PydanticCustomError("custom.shown", ONLY_TRAIN)
        return data

    schema_: Annotated[str, Field(alias="schema", description="Name or path of a schema.")]
    layouts: Annotated[
        Annotated[Literal["published", "random"], A_NAME] | Annotated[list[LayoutEntry], A_LIST],
        _written("name (published, random)", "list of layouts"),
        Field(description="Where the levers stand; the protocol decides if this is left out."),
    ] = None  # type: ignore[assignment]
    trials: Annotated[Positive | None, Field(description="How many trials.")] = None
    shuffle: Annotated[bool, Field(description="Whether layouts come in random order.")] = True


SchemaName = Annotated[str, A_NAME]
SomeTrials = Annotated[Annotated[list[TrialsFile], Field(min_length=1)], A_LIST]
TRIALS_IN_WORDS = "schema by name or path", "list of trials"


class ShownFile(StrictModel):
    """Training that is shown: each solution of each room once."""

    shown: Annotated[SchemaName | SomeTrials, _written(*TRIALS_IN_WORDS)]


class ConditionFile(StrictModel):
    """A condition spelled out."""

    name: Annotated[
        Name | None,
        Field(description="Left out, that of the schemas, where no list of trials is given."),
    ] = None
    train: Annotated[
        SchemaName | SomeTrials | Annotated[ShownFile, A_MAPPING],
        _written(*TRIALS_IN_WORDS, "mapping such as {shown: CC3}"),
    ]
    test: Annotated[
        SchemaName | Annotated[list[TrialsFile], A_LIST],
        _written(*TRIALS_IN_WORDS, but=f"; {ONLY_TRAIN}"),
    ] = Field(default_factory=list)

    @model_validator(mode="after")
    def _has_a_name(self) -> ConditionFile:
        train = self.train.shown if isinstance(self.train, ShownFile) else self.train
        if self.name is None and any(
            isinstance(part, list) and part for part in (train, self.test)
        ):
            raise PydanticCustomError("custom.name", "name: is missing; add it")
        return self


def _setting(kind: Any) -> tuple[Any, None]:
    """A field of :class:`Protocol` as a key of the file that may be left out."""
    return (Positive if int in (kind, *get_args(kind)) else kind) | None, None


_SETTINGS: dict[str, Any] = {
    "based_on": (Annotated[str, Field(description="A protocol to start from.")], "human"),
    **{name: _setting(kind) for name, kind in get_type_hints(Protocol).items() if name != "name"},
}
ProtocolFile = create_model("ProtocolFile", __base__=StrictModel, **_SETTINGS)
ProtocolFile.__doc__ = "A protocol of one's own: another one with some settings changed."


class LearnerFile(StrictModel):
    """A learner that takes part, with what is different for it."""

    learner: Annotated[str, Field(description="Registered name, or module:Class.")]
    name: Annotated[Name | None, Field(description="Label in tables; the learner's name.")] = None
    parameters: dict[str, Any] = Field(default_factory=dict)
    sweep: Annotated[
        dict[str, Annotated[list[Any], Field(min_length=1)]],
        Field(description="Values of parameters; each combination is a learner."),
    ] = Field(default_factory=dict)
    protocol: str | None = None
    subjects: Subjects | None = None
    cell_size: Positive | None = None
    reward: RewardName | None = None


ConditionEntry = Annotated[
    Annotated[str, A_NAME] | Annotated[ConditionFile, A_MAPPING],
    _written("name such as CC4 or CC3-CC4", "mapping with name, train and test"),
]
LearnerEntry = Annotated[
    Annotated[str, A_NAME] | Annotated[LearnerFile, A_MAPPING],
    _written("name", "mapping with learner, name, parameters and so on"),
]


class ExperimentFile(StrictModel):
    """An experiment: learners, conditions, protocol, subjects."""

    name: Name
    title: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    protocol: str = "human"
    subjects: Subjects = 40
    cell_size: Annotated[Positive, Field(description="Most subjects in a unit of work.")] = 40
    reward: RewardName = PAPER_REWARD
    conditions: Annotated[list[ConditionEntry], Field(min_length=1)]
    learners: Annotated[list[LearnerEntry], Field(min_length=1)]
    protocols: dict[str, ProtocolFile] = Field(default_factory=dict)


def json_schema() -> dict[str, Any]:
    """The JSON Schema of experiment files, for editors."""
    made = ExperimentFile.model_json_schema(by_alias=True)
    return {"$schema": JSON_SCHEMA_ID, **made, "title": "causal_openlock experiment"}
