"""Building an experiment: names, classes and objects become conditions and learners.

An experiment is declared in a file (:mod:`~causal_openlock.experiment.file`), on the command line
as changes to a file (:class:`Changes`), or in Python (:func:`make_experiment`). All three are
resolved here. In Python a condition may also be a schema or a sequence of schemas, and a learner
may be a class, an instance, or what :func:`learner` returns.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, is_dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.one_subject import OneSubjectLearner, PerSubjectAdapter
from causal_openlock.contract.registry import (
    changed_parameters,
    file_that_runs,
    name_of,
    parse_parameters,
)
from causal_openlock.errors import (
    ExperimentError,
    Faults,
    FileError,
    LearnerError,
    OpenLockError,
    together,
)
from causal_openlock.experiment.experiment import Experiment, LearnerSpec
from causal_openlock.experiment.file_format import (
    NAME_FORM,
    NAME_IN_WORDS,
    ConditionFile,
    ExperimentFile,
    LearnerFile,
    ProtocolFile,
    ShownFile,
    TrialsFile,
)
from causal_openlock.experiment.protocol import (
    HUMAN_PROTOCOL,
    PROTOCOLS,
    SHOWN,
    Condition,
    Protocol,
    Trials,
    find_protocol,
    plan,
)
from causal_openlock.experiment.sweeps import check_parameters, label_of, labels, points
from causal_openlock.files.digest import digest
from causal_openlock.files.validation import faults_of, plain, whole_number
from causal_openlock.files.yaml_file import Document, Where
from causal_openlock.schemas.declared import schema
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import NAME, Schema
from causal_openlock.usercode.own_files import look_beside
from causal_openlock.wording import joined
from causal_openlock.world.rewards import (
    PAPER_REWARD,
    PRESETS,
    RewardForm,
    RewardFunction,
    find_reward,
)
from causal_openlock.world.room import Layout

Model = TypeVar("Model", bound=BaseModel)

LONGEST_NAMES = 28
"""The longest list of learners or conditions in the name of a comparison, which has two."""

ConditionForm = (
    str | Path | Schema | Condition | ConditionFile | Mapping[str, Any] | Sequence[str | Schema]
)
"""A condition by its name (``CC4``, ``CC3-CC4``, ``my.yaml``), as a schema (a baseline; also in a
line of text, ``A -> B -> door``), as a sequence of schemas (train on all but the last, then test on
the last), or spelled out as in an experiment file, ``{"train": {"shown": "CC3"}, "test": "CC4"}``.
"""

LearnerForm = (
    str
    | type[Learner]
    | type[OneSubjectLearner]
    | Learner
    | OneSubjectLearner
    | LearnerFile
    | Sequence[LearnerFile]
)
"""A learner by its name (``ddqn``, ``my_module:Mine``), as a class, as an instance, whose
parameters count, or as :func:`learner` describes it; or the learners of a :func:`sweep`."""

ProtocolForm = str | Protocol | Mapping[str, Any]
"""A protocol by its name, as a :class:`Protocol`, or as an experiment file has one of its own:
``{"based_on": "human", "attempt_limit": 10}``, perhaps with a ``name``."""


@dataclass(frozen=True)
class Changes:
    """Changes to an experiment file; ``None`` changes nothing. Only names have options.

    Example:
        >>> Changes(subjects=10, learners=["oracle"]).options
        ['--learner', 'oracle', '--subjects', '10']
    """

    conditions: Sequence[ConditionForm] | None = None
    learners: Sequence[LearnerForm] | None = None
    protocol: ProtocolForm | None = None
    subjects: int | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        # NumPy's numbers become Python's; what is none is refused before anything is read.
        for name, least in (("subjects", 1), ("seed", 0)):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, whole_number(value, name, least))

    @property
    def options(self) -> list[str]:
        """The equivalent options of the command line."""
        words = [str(word) for name in self.conditions or () for word in ("--condition", name)]
        words += [str(word) for name in self.learners or () for word in ("--learner", name)]
        for option in ("protocol", "subjects", "seed"):
            if (value := getattr(self, option)) is not None:
                words += [f"--{option}", str(value)]
        return words


def _in_short(names: Sequence[str], what: str) -> str:
    """Names as a part of a name, or their number if they are too long."""
    short = re.sub(r"[^A-Za-z0-9_.-]+", "_", "_".join(names)).strip("_.-")
    return short if 0 < len(short) <= LONGEST_NAMES else f"{len(names)}_{what}"


def build(
    file: ExperimentFile,
    changes: Changes | None = None,
    document: Document | None = None,
    tell: Callable[[str], None] | None = None,
) -> Experiment:
    """The experiment that is declared.

    Args:
        file: The declaration; in place of names it may have objects.
        changes: Changes to it.
        document: The file that it was read from, for the places of faults.
        tell: Called with a sentence before code runs that the declaration names and that is not
            part of an installed package.

    Raises:
        FileError: With the place of every part of the document that cannot be resolved.
        OpenLockError: The same of changes, or without a document.
    """
    builder = _Builder(file, changes or Changes(), document)
    if tell:
        builder.tell_what_runs(tell)
    return builder.build()


class _Builder:
    """Resolves what an experiment is declared with, and reports the place of what it cannot."""

    def __init__(self, file: ExperimentFile, changes: Changes, document: Document | None) -> None:
        self.document, self.file, self.changes = document, file, changes
        self.folder = document.path.resolve().parent if document else Path.cwd()
        self.own_protocols: dict[str, Protocol] = {}
        self.faults = Faults()

    @contextmanager
    def at(self, *where: str | int) -> Iterator[None]:
        """Take note of errors, with their place in the file; changes to it have none."""
        try:
            yield
        except OpenLockError as error:
            changed = getattr(self.changes, str(where[0]), None) is not None
            if self.document is not None and not changed and not isinstance(error, FileError):
                error = self.document.error(error, where)
            self.faults.append(error)

    def tell_what_runs(self, tell: Callable[[str], None]) -> None:
        """Report the code files that the experiment file names and that will run."""
        chosen = self.changes.learners
        names = {one for one in chosen or () if isinstance(one, str)}
        learners = [
            one
            for one in map(as_learner, self.file.learners)
            if chosen is None or {one.learner, *labels(one)} & names
        ]
        runs = {file_that_runs(one.learner, self.folder) for one in learners}
        rewards = [self.file.reward, *(one.reward for one in learners)]
        runs |= {
            file_that_runs(one, self.folder, "reward") for one in rewards if isinstance(one, str)
        }
        for one in sorted(filter(None, runs)):
            tell(one)

    def build(self) -> Experiment:
        file, changes = self.file, self.changes
        for name, declared in file.protocols.items():
            self.own_protocols[name] = PROTOCOLS[HUMAN_PROTOCOL]  # if it is faulty, say so once
            with self.at("protocols", name):
                settings = declared.model_dump(exclude_unset=True)
                self.own_protocols[name] = self.own_protocol(settings, name)
        conditions = self.resolved("conditions", self.condition)
        learners = self.resolved("learners", self.learner)
        self.faults.check()
        check_together(conditions.values(), learners.values())
        name, title = file.name, file.title or file.name
        if changes.conditions is not None or changes.learners is not None:
            players, places = [*learners], [*conditions]
            name = f"{_in_short(players, 'learners')}_in_{_in_short(places, 'conditions')}"
            title = f"{joined(players)} in {joined(places)}"
        elif self.document is None and not file.title:
            title = f"{joined([*learners])} in {joined([*conditions])}"
        return Experiment(
            name=name,
            title=title,
            command=self.command(),
            seed=file.seed if changes.seed is None else changes.seed,
            cell_size=file.cell_size,
            conditions=tuple(conditions.values()),
            learners=tuple(learners.values()),
        )

    def command(self) -> str:
        """The command that runs the experiment again; empty if only a program can."""
        changes = self.changes
        changed: list[Any] = [*(changes.conditions or ()), *(changes.learners or ())]
        changed += [] if changes.protocol is None else [changes.protocol]
        if self.document is None or not all(isinstance(one, str) for one in changed):
            return ""
        words = [self.document.path.as_posix(), *changes.options]
        return shlex.join(["causal-openlock", "compare", *words])

    def resolved(self, key: str, resolve: Callable[[Any, int], list[Any]]) -> dict[str, Any]:
        """Conditions or learners by name: those of the file, or of the command line."""
        declared = getattr(self.file, key)
        if (chosen := getattr(self.changes, key)) is not None:
            known: dict[str, list[Any]] = {}
            for entry in declared:
                if not isinstance(entry, str):
                    for label, one in labels(entry).items():
                        known.setdefault(label, []).append(one)
            declared = [
                entry
                for one in chosen
                for entry in (known.get(one, [one]) if isinstance(one, str) else [one])
            ]
        if not declared:
            raise ExperimentError(f"there are no {key}; name at least one")
        found: dict[str, Any] = {}
        for index, entry in enumerate(declared):
            with self.at(key, index):
                for one in resolve(entry, index):
                    if one.name in found:
                        how = {
                            "learners": "learner(..., label=...)",
                            "conditions": "schema(..., name=...)",
                        }
                        way = f", as in {how[key]}" if self.document is None else " with name:"
                        rename = "" if chosen is not None else f", or give it another name{way}"
                        raise ExperimentError(
                            f"the {key[:-1]} {one.name} is listed twice; remove one of them{rename}"
                        )
                    found[one.name] = one
        return found

    def schema(self, name: str) -> Schema:
        return find_schema(name, beside=[self.folder])

    def protocol(self, given: Any) -> Protocol:
        """A protocol in any form."""
        if isinstance(given, str):
            return find_protocol(given, self.own_protocols)
        if isinstance(given, Mapping):
            settings = {**given}
            base, name = settings.pop("based_on", HUMAN_PROTOCOL), settings.pop("name", None)
            checked = _checked(ProtocolFile, settings).model_dump(exclude_unset=True)
            return self.own_protocol({**checked, "based_on": base}, name)
        if not isinstance(given, Protocol):
            raise ExperimentError(
                f"{given!r} is not a protocol; give its name, a Protocol, or settings such as "
                '{"attempt_limit": 10}'
            )
        return given

    def own_protocol(self, settings: dict[str, Any], name: str | None) -> Protocol:
        """Another protocol with some settings changed, which give it its name if it has none."""
        base = self.protocol(settings.pop("based_on", HUMAN_PROTOCOL))
        if not name:
            name = label_of(base.name, settings, "_")
            if not NAME.fullmatch(name):  # too many settings for a name
                name = f"{base.name[:40]}_{digest(repr(settings))[:8]}"
        if name in PROTOCOLS:
            raise ExperimentError(
                f"the protocol {name} comes with the package; choose another name"
            )
        if not NAME.fullmatch(name):
            raise ExperimentError(
                f"{name!r} is not a valid name of a protocol; use at most 64 letters and digits"
            )
        return replace(base, name=name, **settings)

    def condition(self, declared: ConditionForm, index: int) -> list[Condition]:
        if isinstance(declared, str) and "->" in declared:
            return [self.sequence(schema(declared))]
        if isinstance(declared, str | Path):
            return [Condition.named(str(declared), self.schema)]
        if isinstance(declared, Condition):
            # Files are called by its name, which is checked as that of a file's condition is.
            _checked(ConditionFile, {"name": declared.name, "train": [{"schema": "CC4"}]})
            return [declared]
        if isinstance(declared, Mapping):
            declared = _checked(ConditionFile, declared)
        if not isinstance(declared, ConditionFile):
            return [self.sequence(declared)]
        where, train, before = ("conditions", index), declared.train, len(self.faults)
        if shown := isinstance(train, ShownFile):
            first = self.group(train.shown, (*where, "train", "shown"))
        else:
            first = self.group(train, (*where, "train"))
        tested = self.group(declared.test, (*where, "test"))
        if len(self.faults) > before:
            return []
        names = [*([SHOWN] if shown else []), *(one.schema.name for one in (*first, *tested))]
        return [Condition(declared.name or "-".join(names), first, tested, shown=shown)]

    def group(self, declared: str | list[TrialsFile], where: Where) -> tuple[Trials, ...]:
        """Trials in a list; a name alone is that of the schema."""
        if isinstance(declared, str):
            with self.at(*where):
                return (Trials(self.schema(declared)),)
            return ()
        each = enumerate(declared)
        return tuple(one for number, part in each for one in self.trials(part, (*where, number)))

    def sequence(self, declared: Schema | Sequence[str | Schema]) -> Condition:
        """A baseline of one schema; or training with all but the last and a test with the last."""
        listed = list(declared) if isinstance(declared, Sequence) else [declared]
        schemas = [self.schema(one) if isinstance(one, str) else one for one in listed]
        if not schemas or not all(isinstance(one, Schema) for one in schemas):
            raise ExperimentError(
                f"{declared!r} is not a condition; give a name, a schema, or a list of schemas "
                "whose last one is the test"
            )
        trials = tuple(map(Trials, schemas))
        name = "-".join(one.name for one in schemas)
        if len(trials) == 1:
            return Condition(name, trials)
        return Condition(name, trials[:-1], trials[-1:])

    def trials(self, declared: TrialsFile, where: Where) -> Iterator[Trials]:
        with self.at(*where, "schema"):
            governs = self.schema(declared.schema_)
            layouts: Any = declared.layouts
            if isinstance(layouts, list):
                places = []
                for index, layout in enumerate(layouts):
                    with self.at(*where, "layouts", index):
                        places.append(Layout.of(governs, layout))
                if len(places) < len(layouts):
                    return
                layouts = tuple(places)
            with self.at(*where, "trials"):
                yield Trials(governs, layouts, declared.trials, declared.shuffle)

    def learner(self, entry: LearnerForm, index: int) -> list[LearnerSpec]:
        """A learner, or those of a sweep."""
        if isinstance(entry, Sequence) and not isinstance(entry, str):
            return [spec for one in entry for spec in self.learner(one, index)]
        declared, where, before = as_learner(entry), ("learners", index), len(self.faults)
        if ":" in declared.learner:
            look_beside(self.folder)
        with self.at(*where):
            check_parameters(declared)
        fits = len(self.faults) == before
        played, pays = self.played(declared, where), self.pays(declared, where)
        with self.at(*where, "parameters"):
            return [
                LearnerSpec(
                    name=one.name or "",
                    learner=one.learner,
                    parameters=asdict(parse_parameters(one.learner, one.parameters)),
                    protocol=played,
                    reward=pays,
                    subjects=self.changes.subjects or one.subjects or self.file.subjects,
                    cell_size=one.cell_size,
                )
                for one in (points(declared) if fits else ())
            ]
        return []

    def played(self, declared: LearnerFile, where: Where) -> Protocol:
        """The protocol of a learner: that of the command line, its own, or the file's."""
        own = declared.protocol and not self.changes.protocol
        with self.at(*(where if own else ()), "protocol"):
            return self.protocol(self.changes.protocol or declared.protocol or self.file.protocol)
        return PROTOCOLS[HUMAN_PROTOCOL]

    def pays(self, declared: LearnerFile, where: Where) -> RewardFunction:
        """The reward of a learner: its own, or the file's."""
        own = declared.reward is not None
        reward: Any = declared.reward if own else self.file.reward
        if isinstance(reward, BaseModel):
            reward = reward.model_dump(exclude_none=True)
        if isinstance(reward, str) and ":" in reward:
            look_beside(self.folder)
        with self.at(*(where if own else ()), "reward"):
            return find_reward(reward)
        return PRESETS[PAPER_REWARD]


def listed(learners: LearnerForm | Iterable[LearnerForm]) -> list[LearnerForm]:
    """One learner, or several, as a list."""
    given: Any = learners
    single = isinstance(given, str | type | BaseModel | Mapping)
    return [given] if single or not isinstance(given, Iterable) else list(given)


def as_learner(learner: LearnerForm) -> LearnerFile:
    """A learner in any form, as an experiment file has it.

    Raises:
        LearnerError: If it is none of these forms, or a class that no worker can find by its name.
    """
    if isinstance(learner, str):
        learner = LearnerFile(learner=learner)
    if isinstance(learner, LearnerFile):
        return learner
    kind: Any = learner
    parameters = None
    if not isinstance(learner, type):
        kind, parameters = type(learner), getattr(learner, "parameters", None)
        if isinstance(learner, PerSubjectAdapter):
            kind = learner.single
    if not (isinstance(kind, type) and issubclass(kind, Learner | OneSubjectLearner)):
        raise LearnerError(
            f"{learner!r} is not a learner; give a name, a class of learners, an instance of one, "
            "or learner(NAME, parameter=value)"
        )
    name = name_of(kind)
    given = asdict(parameters) if is_dataclass(parameters) else {}  # type: ignore[arg-type]
    # What has its default can still be swept.
    return LearnerFile(learner=name, parameters=changed_parameters(name, given) if given else {})


def learner(
    learner: LearnerForm,
    /,
    *,
    label: str | None = None,
    subjects: int | None = None,
    protocol: str | None = None,
    reward: Any = None,
    **parameters: Any,
) -> LearnerFile:
    """A learner with other hyper-parameters, or another part in a comparison.

    Args:
        learner: Its registered name, ``module:Class``, its class, or an instance.
        label: What tables call it; by default its name.
        subjects: How many subjects it plays; by default as many as the others.
        protocol: The protocol that it plays under; by default that of the others.
        reward: The reward of its actions, as in an experiment file; by default that of the others.
        **parameters: Its hyper-parameters that differ from their defaults.

    Raises:
        LearnerError: If there is no such learner or parameter (the message has the nearest name),
            or a value does not fit.

    Example:
        >>> learner("ddqn", learning_rate=0.0005, label="slow").parameters
        {'learning_rate': 0.0005}
    """
    return _learner(learner, parameters, {}, label, reward, subjects=subjects, protocol=protocol)


def sweep(
    learner_: LearnerForm,
    /,
    *,
    label: str | None = None,
    subjects: int | None = None,
    protocol: str | None = None,
    reward: Any = None,
    **parameters: Any,
) -> list[LearnerFile]:
    """A learner once for each value of a parameter, or for each combination of several.

    Args:
        learner_: As in :func:`learner`, like the following.
        label: What labels begin with; by default the learner's name.
        subjects: How many subjects each of them plays.
        protocol: The protocol that they play under.
        reward: The reward of their actions.
        **parameters: Hyper-parameters: lists are swept, and everything else is the same for all.

    Raises:
        LearnerError: As for :func:`learner`, or if there is no list.

    Example:
        >>> [one.name for one in sweep("bayes", lapse=[0.1, 0.5])]
        ['bayes-lapse-0.1', 'bayes-lapse-0.5']
    """
    given = {key: plain(values) for key, values in parameters.items()}
    swept = {
        key: list(values)
        for key, values in given.items()
        if isinstance(values, Iterable) and not isinstance(values, str | Mapping)
    }
    fixed = {key: value for key, value in given.items() if key not in swept}
    if not swept or not all(swept.values()):
        raise LearnerError("a sweep needs a list of values, such as gamma=[0.5, 0.9]")
    return points(
        _learner(learner_, fixed, swept, label, reward, subjects=subjects, protocol=protocol)
    )


def _learner(
    learner: LearnerForm,
    parameters: Mapping[str, Any],
    sweep: Mapping[str, Any],
    label: str | None,
    reward: Any,
    **given: Any,
) -> LearnerFile:
    """A learner, perhaps swept.

    Raises:
        OpenLockError: With every value that does not fit.
    """
    faults, declared = Faults(), as_learner(learner)
    if label is not None and not re.fullmatch(NAME_FORM, label):
        faults.append(ExperimentError(f"{label!r} is not a label; it must have {NAME_IN_WORDS}"))
        label = None
    if callable(reward):
        with faults.noted():
            reward = find_reward(reward).name
    own = {"parameters": {**declared.parameters, **parameters}, "sweep": sweep}
    given |= {"name": label, "reward": reward}
    changed = {key: value for key, value in given.items() if value is not None}
    with faults.noted():
        check_parameters(declared.model_copy(update=own))
    with faults.noted():
        declared = _checked(LearnerFile, {**declared.model_dump(), **own, **changed})
    faults.check()
    for one in points(declared):
        parse_parameters(one.learner, one.parameters)
    return declared


def make_experiment(
    conditions: ConditionForm | Sequence[ConditionForm],
    learners: LearnerForm | Sequence[LearnerForm],
    *,
    name: str = "comparison",
    title: str = "",
    seed: int = 0,
    protocol: ProtocolForm = HUMAN_PROTOCOL,
    attempt_limit: int | None = None,
    subjects: int = 40,
    reward: RewardForm = PAPER_REWARD,
    cell_size: int = 40,
) -> Experiment:
    """An experiment from names and objects; an experiment file declares the same in YAML.

    Args:
        conditions: A condition or several: each a name (``CC4``, ``CC3-CC4``, ``my.yaml``), a
            schema, a sequence of schemas whose last one is the test, a :class:`Condition`, or a
            mapping as in an experiment file.
        learners: A learner or several: each a name, a class, an instance, or what :func:`learner`
            returns.
        name: A short name.
        title: A line for the report; by default who plays what.
        seed: All randomness comes from it.
        protocol: The protocol of learners that have none of their own: its name, a
            :class:`Protocol`, or settings as in an experiment file, ``{"test_trials": 2}``.
        attempt_limit: Attempts in a trial, if another number than the protocol's.
        subjects: Subjects of each learner in each condition.
        reward: The reward of actions, as in an experiment file.
        cell_size: Most subjects in a unit of work.

    Raises:
        OpenLockError: If something is unknown (the message has the nearest name), or does not fit.

    Example:
        >>> made = make_experiment(["CC3", ["CC3", "CC4"]], ["oracle"], subjects=10)
        >>> [cell.in_words for cell in made.cells()]
        ['oracle in CC3, subjects 0-9', 'oracle in CC3-CC4, subjects 0-9']
    """
    file = _settings(name=name, title=title, seed=seed, subjects=subjects, cell_size=cell_size)
    places: Any = conditions
    single = isinstance(places, str | Path | Schema | Condition | BaseModel | Mapping)
    places = [places] if single or not isinstance(places, Iterable) else [*places]
    given = {"conditions": places, "learners": listed(learners), "reward": reward}
    if attempt_limit is not None:
        protocol = {"based_on": protocol, "attempt_limit": attempt_limit}
    return build(file.model_copy(update={**given, "protocol": protocol}))


def _settings(**values: Any) -> ExperimentFile:
    """Settings of an experiment, checked as those of a file."""
    anything = {"name": "comparison", "conditions": ["CC4"], "learners": ["random"]}
    return _checked(ExperimentFile, {**anything, **values})


def _checked(model: type[Model], values: Mapping[str, Any]) -> Model:
    """Values as a model of the file's format.

    Raises:
        ExperimentError: With every value that does not fit.
    """
    try:
        return model.model_validate(plain(values))
    except ValidationError as error:
        raise together([ExperimentError(said) for _, said in faults_of(error, model)]) from None


def check_together(conditions: Iterable[Condition], learners: Iterable[LearnerSpec]) -> None:
    """Refuse different schemas with the same name, and schemas that do not fit a protocol.

    Otherwise a comparison could fail after an hour.
    """
    known: dict[str, Schema] = {}
    faults = Faults()
    for condition in conditions:
        for one in condition.schemas:
            if known.setdefault(one.name, one) != one:
                message = f"two different schemas are called {one.name}; rename one of them"
                faults.append(ExperimentError(message))
    for spec, condition in product(learners, conditions):
        once = replace(spec.protocol, baseline_loops=1, train_loops=1, test_loops=1)
        with faults.noted():
            plan(condition, once, np.random.default_rng(0))
    faults.check()
