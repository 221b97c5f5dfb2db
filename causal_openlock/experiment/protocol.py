"""Protocols, the budgets of trials; and the names and numbers that all declarations are made of."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, WrapValidator
from pydantic.json_schema import SkipJsonSchema

from causal_openlock.errors import ExperimentError
from causal_openlock.files.checksums import digest
from causal_openlock.files.validation import Part, adapter, part, plain
from causal_openlock.schemas.schema import NAME, Schema
from causal_openlock.wording import nearest

HUMAN_PROTOCOL = "human"  #: the protocol under which people played in the paper
PAPER_ACTION_LIMIT = 3
MAX_ACTION_LIMIT = 63
NAME_FORM = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
MISSING = ("NA", "NaN", "nan", "NULL", "null", "None")
NAME_IN_WORDS = "letters, digits, underscores, dots and dashes, at most 64 in all"


def context_of(info: ValidationInfo) -> dict[str, Any]:
    """What is known while a declaration is read.

    ``folders`` to look for schemas in; ``protocols`` of the experiment's own; whether everything is
    ``recorded`` in a results folder, so that no code is loaded; and names that are taken.
    """
    return {} if info.context is None else info.context


def declares(info: ValidationInfo) -> bool:
    """Whether something is declared: not recorded, nor made of parts that were checked before."""
    return info.context is not None and not info.context.get("recorded")


def _well_formed(name: str, info: ValidationInfo) -> str:
    if declares(info) and not re.fullmatch(NAME_FORM, name):
        raise ExperimentError(f"{name[:80]!r} is not a name here; it must have {NAME_IN_WORDS}")
    if declares(info) and name in MISSING:
        raise ExperimentError(
            f"{name!r} is no label, as tables read it as a missing value; choose another name"
        )
    return name


Name = Annotated[
    str,
    AfterValidator(_well_formed),
    Field(description=NAME_IN_WORDS, json_schema_extra={"pattern": NAME_FORM}),
]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000), BeforeValidator(plain)]
Subjects = Annotated[int, Field(strict=True, ge=1, le=10_000_000), BeforeValidator(plain)]
ActionLimit = Annotated[int, Field(strict=True, ge=1, le=MAX_ACTION_LIMIT), BeforeValidator(plain)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63), BeforeValidator(plain)]


def _any(parts: Any, info: ValidationInfo) -> Any:
    if declares(info) and not parts:
        raise ExperimentError(f"{info.field_name} needs at least 1; add one")
    return parts


AT_LEAST_ONE = (AfterValidator(_any), Field(json_schema_extra={"minItems": 1}))
LayoutSource = Literal["published", "random"]


def default_action_limit(schema: Schema) -> int:
    """Actions in an attempt by default: the paper's 3, or as many as the schema needs."""
    return max(PAPER_ACTION_LIMIT, schema.least_action_limit)


@part()
class Protocol(Part):
    """Protocol: the budgets and rules under which a condition is played.

    Example:
        >>> from dataclasses import replace
        >>> short = replace(PROTOCOLS["human"], name="short", attempt_limit=5)
        >>> short.attempt_limit, short.training_trials
        (5, 6)
    """

    name: Name
    attempt_limit: Count = 30  #: attempts in a trial
    stop_when_solved: Annotated[bool, Field(strict=True)] = True  #: else a trial goes on
    # Trials where a condition does not say how many; at most as many as there are published
    # layouts, if those are used (five with four levers).
    baseline_trials: Count = 5  #: trials of a condition without a test
    training_trials: Count = 6  #: trials to train on
    test_trials: Count = 1  #: trials to test on
    baseline_loops: Count = 1  #: how often the trials of a baseline are repeated
    train_loops: Count = 1  #: how often those to train on are
    test_loops: Count = 1  #: how often those to test on are
    layouts: LayoutSource = "published"  #: those of the paper's authors, or random ones
    test_layout: SkipJsonSchema[str | None] = None  #: in results of 0.2: the layout of all tests
    action_limit: ActionLimit | None = None  #: by default 3, or as many as the schema needs

    def actions_for(self, schema: Schema) -> int:
        """Actions in an attempt in a room of this schema, which may need more than allowed."""
        limit = self.action_limit or default_action_limit(schema)
        if limit < schema.least_action_limit:
            raise ExperimentError(
                f"{schema.name} needs attempts of {schema.least_action_limit} actions and the "
                f"protocol {self.name} allows {limit}; raise its action_limit"
            )
        return limit


@part()
class ProtocolChanges(Protocol):
    """A protocol of one's own: another one with some settings changed."""

    name: Name = ""
    based_on: str = HUMAN_PROTOCOL


# Those of the paper ("Materials and Procedure", "Model Results"; where its figures show other
# numbers, these follow its text), and that of "Theory-based Causal Transfer" (AAAI 2020).
PROTOCOLS = {
    "human": Protocol("human", 30, True),
    "rl": Protocol("rl", 300, False, 5, 6, 5, baseline_loops=10, train_loops=100, test_loops=10),
    "rl_2020": Protocol("rl_2020", 700, True, 5, 6, 5, 200, 200, 200),
}
HUMAN = PROTOCOLS[HUMAN_PROTOCOL]


def find_protocol(name: str, own: Mapping[str, Protocol] | None = None) -> Protocol:
    """A protocol by name; a refusal suggests the nearest."""
    known = {**PROTOCOLS, **(own or {})}
    if name not in known:
        raise ExperimentError(f"there is no protocol {name!r:.80}; {nearest(name, known)}")
    return known[name]


def label_of(name: str, values: Mapping[str, Any], mark: str) -> str:
    """A name with the values that are changed: ``bayes-policy-solve_and_learn-lapse-0.3``."""
    words = [name]
    for key, value in values.items():
        text = f"{value:.10g}" if isinstance(value, float) else str(value)
        words += [str(key), re.sub(r"[^A-Za-z0-9.-]+", "_", text).strip("_")]
    return mark.join(words)


def _protocol(value: Any, info: ValidationInfo) -> Any:
    """A protocol by its name, or another one with some settings changed."""
    if isinstance(value, str):
        return find_protocol(value, context_of(info).get("protocols"))
    if isinstance(value, Protocol) or context_of(info).get("recorded"):
        return value
    if not isinstance(value, Mapping):
        raise ExperimentError(
            f"{value!r:.200} is not a protocol; give its name, or settings: {{attempt_limit: 10}}"
        )
    if value.get("test_layout"):
        raise ExperimentError(
            "test_layout belongs to conditions now, as in test: [{schema: CC4, layouts: [trial7]}]"
        )
    fields = [key for key in ProtocolChanges.__dataclass_fields__ if key in value]
    settings = {key: value[key] for key in [*fields, *value]}  # in an order that names it
    base = settings.pop("based_on", HUMAN_PROTOCOL)
    if base == value.get("name"):
        raise ExperimentError(f"the protocol {base} is based on itself; name another one")
    protocol = adapter(AnyProtocol).validate_python(base, context=info.context)
    name = settings.pop("name", None) or label_of(protocol.name, settings, "_")
    if name in PROTOCOLS and (settings or "name" in value):
        raise ExperimentError(f"the protocol {name} comes with the package; choose another name")
    if "name" not in value and not NAME.fullmatch(name):  # too many settings for a name
        name = f"{protocol.name[:40]}_{digest(repr(settings))[:8]}"
    return {**asdict(protocol), **settings, "name": name}


AnyProtocol = Annotated[
    Protocol, BeforeValidator(_protocol, json_schema_input_type=str | ProtocolChanges)
]


def _own_protocol(value: Any, read: Callable[[Any], Protocol], info: ValidationInfo) -> Protocol:
    """A protocol of an experiment's own; those below may be based on it."""
    known = context_of(info).get("protocols", {})
    known[value["name"]] = HUMAN  # a faulty one is said to be so once
    known[value["name"]] = protocol = read(value)
    return protocol


def _with_names(protocols: Any) -> Any:
    if not isinstance(protocols, Mapping):
        return protocols
    forms = {k: v if isinstance(v, Mapping) else {"based_on": v} for k, v in protocols.items()}
    return {name: {**form, "name": name} for name, form in forms.items()}


OwnProtocols = Annotated[
    dict[str, Annotated[AnyProtocol, WrapValidator(_own_protocol)]],
    BeforeValidator(_with_names, json_schema_input_type=dict[str, ProtocolChanges]),
]
