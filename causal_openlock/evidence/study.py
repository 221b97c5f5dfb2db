"""The file that declares a study: what is run, which claims it decides, and by which comparisons.

Example of a ``study.yaml``::

    title: Whether the double deep Q-network forgets
    experiment: experiment.yaml
    measured: course
    hours: 2.5
    claims:
      declines:
        text: The longer it trains, the fewer attempts open the door
        source: paper, Figure 6
        contrasts:
          CC4:
            measure: opens
            of: {learner: ddqn, condition: CC4, part: 5}
            minus: {learner: ddqn, condition: CC4, part: 1}
            expected: less
            smallest: 0.1
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field, model_validator

from causal_openlock.analysis.measures import SOLUTIONS
from causal_openlock.contract.parameters import Count
from causal_openlock.errors import EvidenceError
from causal_openlock.experiment.declare import NAME_FORM, PAPER_CONDITIONS, Experiment, Name
from causal_openlock.experiment.file import code_named, read_experiment
from causal_openlock.files.digest import digest
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import read_document
from causal_openlock.fitting.space import bundled_search
from causal_openlock.fitting.steps import seeds_of
from causal_openlock.scoring import LAPSE
from causal_openlock.wording import joined, nearest

FILE = "study.yaml"

OF_ALL = "derived"
"""The name of the table that is computed from all units."""

DRAWN = ("distances_from_people", "confusion")
"""Derived tables that have a figure."""

RL_2020 = {f"paper_{name.lower()}": name for name in ("DQN", "A2C", "TRPO", "PPO", "MAML")}
"""The published curves of AAAI 2020 by the names under which studies compare and show them."""

PUBLISHED = ("people", "published_model", "paper_ddqn", *RL_2020)
"""All published results by these names."""

TRIALS = ("attempts", "first_solution", "solved", "found")
COURSE = ("opens", "finds_all", "found", "unlocks", "else")
"""Measures of each trial, and of each part of a course."""

BLOCK = 50
"""Trials in a part of a curve; published points seem to be means of this number of trials."""

AFTER, SAVED = "after_first", "saved_after_first"
"""Attempts from the first solution to the last, and how many fewer than to the first; derived."""

ATTEMPTS = ("attempts", "first_solution", *SOLUTIONS, AFTER, SAVED)
"""Measures that are numbers of attempts."""

RECOVERED = ("single", "groups", "halves")
"""Measures of a recovery: shares attributed to the true learner; every row is a unit."""

IN_BITS = ("information", "per_minute")
TOLD = (*IN_BITS, "minutes", "certain", "unlike")
"""Measures of a design (:func:`~causal_openlock.design.telling.informed`); as above."""

NO_SHARES = (*ATTEMPTS, *IN_BITS, "minutes")
"""Measures that are not between 0 and 1."""

METRICS = ("differing_pairs", "differing_transitions")
"""Metrics of the DDQN's replay, which version 0.2 measured at the end of visits; all are shares."""

CORRELATION = "r"
"""Measure of a recovery: correlation of true parameters with fitted ones."""

EVERYONE = "everyone"
"""Name of all theories of a recovery or a design together."""

ATTRIBUTED = ("recovery", "design")
"""Kinds of studies in which subjects are attributed to the learners that made them."""

MEASURED: Mapping[str, Sequence[str]] = {
    "trials": (*TRIALS, *SOLUTIONS, AFTER, SAVED),
    "course": COURSE,
    "curve": (*TRIALS, *SOLUTIONS, AFTER, SAVED),
    "recovery": (*RECOVERED, CORRELATION),
    "design": (*RECOVERED, *TOLD),
    "metrics": METRICS,
}

Measure = Literal[
    "attempts", "first_solution", "first", "second", "third", "after_first", "saved_after_first",
    "solved", "found", "opens", "finds_all", "else", "unlocks", "single", "groups", "halves", "r",
    "information", "per_minute", "minutes", "certain", "unlike", "differing_pairs",
    "differing_transitions",
]  # fmt: skip
"""Measures of each unit: see :mod:`~causal_openlock.evidence.units`."""

Expected = Literal["less", "more", "same"]


class Selection(StrictModel):
    """Selection of units, and of trials or parts; what is left out is averaged over.

    Without ``phase``, ``trial`` and ``part`` it is the trial that a condition is judged by: its
    test, or the last trial of a baseline.
    """

    learner: str
    condition: str | list[str] | None = None
    phase: Literal["train", "test"] | None = None
    trial: Count | None = None
    part: Count | None = None
    parameter: Name | None = None

    @classmethod
    def parse(cls, words: Sequence[str]) -> Selection:
        """A selection in words: ``LEARNER [CONDITION] [train|test] [trial N|part N]``.

        Of a recovery it is ``LEARNER [CONDITION]``, or ``LEARNER parameter NAME``.

        >>> Selection.parse(["ddqn", "CC4", "part", "5"])
        Selection(learner='ddqn', condition='CC4', phase=None, trial=None, part=5, parameter=None)

        Raises:
            EvidenceError: If the words have another form.
        """
        if not words:
            raise EvidenceError("a selection names at least a learner")
        learner, *rest = words
        asked: dict[str, Any] = {}
        while rest:
            word = rest.pop(0)
            key = "phase" if word in ("train", "test") else "condition"
            value: Any = word
            if word == "parameter":
                if not (rest and re.fullmatch(NAME_FORM, rest[0])):
                    raise EvidenceError(f"{word} in {' '.join(words)!r} needs a name after it")
                key, value = word, rest.pop(0)
            elif word in ("trial", "part"):
                if not (rest and re.fullmatch("[1-9][0-9]{0,5}", rest[0])):
                    raise EvidenceError(f"{word} in {' '.join(words)!r} needs a number after it")
                key, value = word, int(rest.pop(0))
            if key in asked:
                raise EvidenceError(f"{' '.join(words)!r} names two of {key}; name one")
            asked[key] = value
        return cls(learner=learner, **asked)


class Contrast(StrictModel):
    """A difference between two selections, or between one and a known number."""

    measure: Measure
    of: Selection
    minus: Selection | Annotated[float, Field(allow_inf_nan=False)]
    expected: Expected
    smallest: Annotated[
        float, Field(ge=0, description="The smallest difference that matters; 0 from a bound.")
    ] = 0.0

    @model_validator(mode="after")
    def _says_what_matters(self) -> Contrast:
        if self.of.learner in PUBLISHED:
            raise ValueError("of: is what was run; give what is published as minus:")
        bound = isinstance(self.minus, float) and self.expected != "same"
        if not (self.smallest or bound):
            raise ValueError("smallest: is missing: from which difference on does it matter?")
        return self


class Claim(StrictModel):
    """A claim; it holds if all of its contrasts come out as expected."""

    text: str
    source: str = ""
    contrasts: Annotated[dict[str, Contrast], Field(min_length=1)]


class Table(StrictModel):
    """A table for a page: the mean over units in each row and column.

    A row and a column together are a selection in words (:meth:`Selection.parse`), such as
    ``ddqn CC4`` and ``part 5``, or ``bayes`` and ``CC4 trial 1``.
    """

    measure: Measure
    rows: Annotated[dict[str, str], Field(min_length=1, description="Selection: its label.")]
    columns: Annotated[list[str], Field(min_length=1, description="The rest of the selection.")]
    interval: bool = False
    trained_before: Annotated[
        bool,
        Field(description="A column for attempts of training before the experiment."),
    ] = False


class Networks(StrictModel):
    """Networks that are trained first; each is a unit."""

    command: Annotated[
        str, Field(description="Trains one; with {file}, {seed} and {out} where these belong.")
    ]
    files: Annotated[dict[Name, str], Field(min_length=1, description="Label: file of a training.")]
    seeds: Annotated[list[int], Field(min_length=1)]
    learner: str = "rl2"
    parameters: Annotated[
        dict[Name, dict[str, Any]],
        Field(description="Label of a variant of the first file's networks: other parameters."),
    ] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _command_can_be_run(self) -> Networks:
        try:
            words = self.words(file="", seed="", out="")
        except (ValueError, KeyError, IndexError) as error:
            raise ValueError(f"command: cannot be filled in ({error}); it may have {{file}}, "
                             "{seed} and {out}") from None  # fmt: skip
        if not words:
            raise ValueError("command: is empty; what trains a network?")
        return self

    def words(self, **places: str) -> list[str]:
        """The command as words, its places filled in."""
        return [word.format(**places) for word in shlex.split(self.command)]


class RecoverySettings(StrictModel):
    """Settings of a recovery; see :mod:`~causal_openlock.design`."""

    parameters: Annotated[
        list[Name], Field(description="Learners whose parameters are also recovered.")
    ] = Field(default_factory=list)
    draws: Count = 128
    lapse: Annotated[float, Field(ge=0, le=1)] = LAPSE
    sets: Annotated[int, Field(ge=3)] = 20
    each: Count = 1
    candidates: Count = 40
    restarts: Count = 2


class DesignSettings(StrictModel):
    """Settings of a design; see :mod:`~causal_openlock.design`."""

    draws: Count = 8
    lapse: Annotated[float, Field(gt=0, le=1)] = LAPSE
    outside: Annotated[
        list[Name], Field(description="Learners that make subjects and are none of the theories.")
    ] = Field(default_factory=list)


class StudyFile(StrictModel):
    """A ``study.yaml``."""

    title: str
    about: str = ""
    experiment: Annotated[
        str,
        Field(pattern=r"^[^\x00]+$", description="Its file, as seen from the study's folder."),
    ]
    measured: Annotated[
        Literal["trials", "course", "curve", "recovery", "design", "metrics"],
        Field(
            description="Each trial of people's protocol, parts of a long course, the trials of "
            "one by fifties, who is attributed to whom, with parameters known (recovery) or not "
            "(design), or what learners measure of themselves."
        ),
    ] = "trials"
    recovery: RecoverySettings = Field(default_factory=RecoverySettings)
    design: DesignSettings = Field(default_factory=DesignSettings)
    derived: Annotated[
        Literal["distances_from_people", "learning_costs", "confusion"] | None,
        Field(description="A table that is computed from all units together."),
    ] = None
    fits: Annotated[
        list[str],
        Field(description="Stored fits (fit.json) that its learners' parameters come from."),
    ] = Field(default_factory=list)
    fitted: Annotated[
        dict[str, Count],
        Field(description="How many numbers of a learner were fitted to people's fourteen means."),
    ] = Field(default_factory=dict)
    networks: Networks | None = None
    published: Annotated[
        str | None,
        Field(
            pattern=r"^[0-9]+\.[0-9]+$",
            description="Version that it was played with, if its experiment uses what has been "
            "removed since: the experiment is not read, and what is stored stands.",
        ),
    ] = None
    hours: Annotated[float, Field(gt=0, description="Hours of one core for the whole study.")]
    claims: dict[str, Claim] = Field(default_factory=dict)
    tables: dict[str, Table] = Field(default_factory=dict)
    figures: Annotated[
        list[str], Field(description="Names of tables that are also drawn; or ``derived``.")
    ] = Field(default_factory=list)

    @model_validator(mode="after")
    def _figures_are_of_tables(self) -> StudyFile:
        known = [*self.tables, *([OF_ALL] if self.derived in DRAWN else [])]
        for name in self.figures:
            if name not in known:
                raise ValueError(f"figures: there is no table {name}; {nearest(name, known)}")
        return self

    @model_validator(mode="after")
    def _training_before_is_known(self) -> StudyFile:
        asks = [name for name, table in self.tables.items() if table.trained_before]
        if asks and self.derived != "learning_costs":
            raise ValueError(f"tables: {asks[0]}: trained_before needs derived: learning_costs")
        return self

    @model_validator(mode="after")
    def _recovery_is_by_itself(self) -> StudyFile:
        if self.derived == "confusion" and self.measured not in ATTRIBUTED:
            raise ValueError("derived: confusion is of measured: recovery or design")
        for name in ATTRIBUTED:
            if name in self.model_fields_set and self.measured != name:
                raise ValueError(f"{name}: is of measured: {name}")
        if self.measured not in ATTRIBUTED:
            return self
        if self.networks or self.derived not in (None, "confusion"):
            raise ValueError(f"a {self.measured} has no networks:, and derives only confusion")
        for claim in self.claims.values():
            for contrast in claim.contrasts.values():
                if self.measured == "recovery" and not isinstance(contrast.minus, float):
                    raise ValueError("minus: of a recovery is a number")
        return self

    @model_validator(mode="after")
    def _sides_can_be_selected(self) -> StudyFile:
        if self.measured in ATTRIBUTED:
            return self
        for claim in self.claims.values():
            for contrast in claim.contrasts.values():
                for side in (contrast.of, contrast.minus):
                    if not isinstance(side, Selection):
                        continue
                    if side.part and self.measured == "trials":
                        raise ValueError("part: is of a course; write trial: instead")
                    if not (self.networks or isinstance(side.condition, str)):
                        raise ValueError("name one condition: others have other subjects")
        return self


@dataclass(frozen=True)
class Study:
    """A study in its folder.

    Attributes:
        folder: Where its files are.
        file: What ``study.yaml`` declares.
        tell: Called with a sentence before code runs that the study names and no package brings
            along; without it, no such code runs.
    """

    folder: Path
    file: StudyFile
    tell: Callable[[str], None] | None = None

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.folder.name

    @property
    def unit(self) -> Literal["network", "subject"]:
        """Unit that was drawn independently."""
        return "network" if self.file.networks else "subject"

    @property
    def experiment(self) -> Path:
        """The study's experiment file."""
        return (self.folder / self.file.experiment).resolve()

    @property
    def training_files(self) -> Mapping[str, Path]:
        """Files that declare trainings, by label."""
        files = self.file.networks.files if self.file.networks else {}
        return {label: (self.folder / file).resolve() for label, file in files.items()}

    @cached_property
    def asked(self) -> Experiment:
        """The experiment as its file declares it now.

        Raises:
            EvidenceError: If the study is published, or code would run to know it, and nobody
                would be told.
        """
        if self.file.published:
            raise EvidenceError(
                f"{self.name} was published with version {self.file.published} and cannot be run "
                "with this one, which lacks options that it uses; play it with that version"
            )
        if self.tell is None and (named := self.named_code()):
            raise EvidenceError(
                f"{self.folder / FILE} names code ({joined(named)}), which does not run here; if "
                f"you trust it, give --trust {self.name}"
            )
        return read_experiment(self.experiment, tell=self.tell)

    def named_code(self) -> list[str]:
        """The code that the study names, ``module:name``; it does not run."""
        found = [name for name, _ in code_named(read_document(self.experiment).data)]
        if self.file.networks and ":" in self.file.networks.learner:
            found.append(self.file.networks.learner)
        return [*dict.fromkeys(found)]

    @cached_property
    def declared(self) -> str:
        """A hash of what is run: of the experiment with all its schemas, and of trainings."""
        networks = self.file.networks
        run = {
            "experiment": self.asked.declaration,
            "measured": self.file.measured,
            "trainings": [self.training(label) for label in self.training_files],
            "parameters": networks and networks.parameters,
        }
        if networks:
            run["learner"] = networks.learner
        if self.file.measured in ATTRIBUTED:
            run[self.file.measured] = getattr(self.file, self.file.measured).model_dump()
        return _digest(run)

    def asks_of(self, label: str) -> str:
        """A hash of what a trained network plays, and as what; not of how it is trained."""
        assert self.file.networks
        networks = self.file.networks
        parameters = networks.parameters.get(label, {})
        played = [self.asked.declaration, self.file.measured, networks.learner, parameters]
        return _digest(played)

    def stored(self) -> set[str]:
        """Measures that stored units must have; those of a solution only where it is asked for."""
        asked = {measure for _, measure, _ in self._sides()}
        return {*MEASURED[self.file.measured]} - {AFTER, SAVED} - ({*SOLUTIONS} - asked)

    def faults(self) -> list[str]:
        """Faults: what is named and not played, and a seed that a stored fit played with."""
        networks = self.file.networks
        learners = {one.name for one in self.asked.learners}
        if networks:
            learners = {*networks.files, *networks.parameters}
        if self.file.measured in ATTRIBUTED:
            learners |= {EVERYONE}
        conditions = {one.name for one in self.asked.conditions}
        measures = MEASURED[self.file.measured]
        found = [
            f"fitted: {name!r} is not played; {nearest(name, learners)}"
            for name in self.file.fitted
            if name not in learners
        ]
        found += [
            f"fits: {name} played with the seed {self.asked.seed} of this study, so its rooms are "
            "not fresh; choose another seed"
            for name in self.file.fits
            if self.asked.seed in seeds_of(self.folder / name)
        ]
        for place, measure, side in self._sides():
            of = side.condition or []
            names = [of] if isinstance(of, str) else of
            published = side.learner in PUBLISHED
            for name, known in (
                (side.learner, {*learners, *PUBLISHED}),
                *((name, {*conditions, *PAPER_CONDITIONS} if published else conditions)
                  for name in names),
                (measure, {*measures, *(get_args(Measure) if published else ())}),
            ):  # fmt: skip
                if name not in known:
                    found.append(f"{place}: {name!r} is not played; {nearest(name, known)}")
            if (measure == CORRELATION) != (side.parameter is not None):
                found.append(f"{place}: r is of a parameter, and nothing else is")
            elif side.parameter and side.parameter not in (own := self._searched(side.learner)):
                found.append(
                    f"{place}: {side.parameter!r} of {side.learner} is not recovered; "
                    f"{nearest(side.parameter, own)}"
                )
        return found

    def _searched(self, label: str) -> list[str]:
        """The parameters that are recovered of a learner."""
        specs = [one for one in self.asked.learners if one.name == label]
        recovered = [one for one in specs if label in self.file.recovery.parameters]
        spaces = [bundled_search(one.learner) for one in recovered]
        return [name for space in spaces if space for name in space.ranges]

    def _sides(self) -> Iterator[tuple[str, str, Selection]]:
        for name, claim in self.file.claims.items():
            for part, contrast in claim.contrasts.items():
                for side in (contrast.of, contrast.minus):
                    if isinstance(side, Selection):
                        yield f"claims: {name}: {part}", contrast.measure, side
        for name, table in self.file.tables.items():
            for row in table.rows:
                for column in table.columns:
                    words = [*row.split(), *column.split()]
                    yield f"tables: {name}", table.measure, Selection.parse(words)

    def training(self, label: str) -> str:
        """A hash of a training: its command and the content of its file."""
        assert self.file.networks
        content = read_document(self.training_files[label]).data
        return _digest({"command": self.file.networks.command, "file": content})

    def margin(self, name: str) -> str:
        """A hash of the contrasts of a claim."""
        claim = self.file.claims[name]
        dumps = {part: one.model_dump() for part, one in claim.contrasts.items()}
        for sides in dumps.values():
            for side in (sides["of"], sides["minus"]):
                if isinstance(side, dict) and side["parameter"] is None:
                    del side["parameter"]  # the hashes of what has none are older than it
        return _digest(dumps)


def _digest(content: Any) -> str:
    return digest(json.dumps(content, sort_keys=True))


def read_study(folder: Path, tell: Callable[[str], None] | None = None) -> Study:
    """Read a study; nothing that it names runs.

    Args:
        folder: Its folder.
        tell: As for :class:`Study`.

    Raises:
        FileError: With line, column and remedy of the first fault.
        EvidenceError: If a file that it names is missing.
    """
    study = Study(folder, read_document(folder / FILE).validate(StudyFile), tell)
    for path in (study.experiment, *study.training_files.values()):
        if not (study.file.published or path.is_file()):
            raise EvidenceError(f"{folder / FILE} names {path}, which is not a file; fix the name")
    return study


def read_studies(
    root: Path,
    names: tuple[str, ...] = (),
    tell: Callable[[str], None] | None = None,
    trusted: Collection[str] | None = None,
) -> list[Study]:
    """The studies of a folder, by name; all of them by default.

    Args:
        root: The folder.
        names: Names of studies.
        tell: As for :class:`Study`.
        trusted: Names of those whose code may run; by default all, if somebody is told.

    Raises:
        EvidenceError: If there is none, or none of a name.
    """
    known = sorted(path.parent.name for path in root.glob(f"*/{FILE}"))
    if not root.is_dir():
        raise EvidenceError(
            f"there is no folder {root} here; run this in a checkout of the project, or name one "
            "with --folder"
        )
    if not known:
        raise EvidenceError(f"{root} holds no study; name the folder of evidence with --folder")
    for name in names:
        if name not in known:
            raise EvidenceError(f"there is no study {name!r} in {root}; {nearest(name, known)}")
    return [
        read_study(root / name, tell if trusted is None or name in trusted else None)
        for name in names or known
    ]
