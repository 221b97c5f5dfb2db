"""The file that declares a study: what is run, which claims it decides, and by which comparisons.

How a ``study.yaml`` looks is in ``evidence/README.md``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import Field, model_validator

from causal_openlock.contract.parameters import Count, NotNegative, Whole
from causal_openlock.errors import EvidenceError
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.making import code_named, read_experiment
from causal_openlock.experiment.protocol import Name
from causal_openlock.files.checksums import digest
from causal_openlock.files.validation import StrictModel, present
from causal_openlock.files.yaml_file import read_document
from causal_openlock.fitting.steps import seeds_of
from causal_openlock.wording import joined, nearest
from evidence.published import PUBLISHED

T = TypeVar("T")
FILE = "study.yaml"
DERIVED = "derived"
"""The name of the table that is computed from all units."""
EVERYONE = "everyone"
"""Name of all theories of a study together."""

ATTEMPTS = ("attempts", "first_solution", "after_first", "saved_after_first")
TRIALS = ("attempts", "first_solution", "solved", "found")
COURSE = ("opens", "finds_all", "found", "unlocks", "else")
"""Measures of each trial, and of each part of a course (:mod:`evidence.units`)."""
ATTRIBUTED = ("single", "groups", "halves")
TOLD = ("information", "per_minute", "minutes", "certain", "unlike")
"""Measures of theories (:mod:`evidence.theories`)."""
CORRELATION = "r"
"""Measure of theories: correlation of true parameters with fitted ones."""
METRICS = ("differing_pairs", "differing_transitions")
"""Shares in the DDQN's replay, which version 0.2 measured at the end of visits."""
MEASURES = (*ATTEMPTS, *TRIALS, *COURSE, *ATTRIBUTED, *TOLD, CORRELATION, *METRICS)
NO_SHARES = (*ATTEMPTS, "information", "per_minute", "minutes")
"""Measures that are not between 0 and 1."""

WORDS = re.compile(
    r"(?P<learner>\S+)(?: (?!(?:train|test|trial|part|parameter)\b)(?P<condition>\S+))?"
    r"(?: (?P<phase>train|test))?(?: trial (?P<trial>[1-9]\d*))?(?: part (?P<part>[1-9]\d*))?"
    r"(?: parameter (?P<parameter>[\w.-]+))?"
)


def selection(words: str) -> dict[str, list[Any]]:
    """What rows of units have, by column, where they are selected in words.

    ``LEARNER [CONDITION[+CONDITION]] [train|test] [trial N|part N]``; of a recovered parameter
    ``LEARNER parameter NAME``. What is left out is averaged over, as several conditions are; but
    without a phase, trial or part it is what a condition is judged by: its test, or the last trial
    of a baseline.

    >>> selection("ddqn CC4+CE4 part 5")
    {'learner': ['ddqn'], 'condition': ['CC4', 'CE4'], 'part': [5]}

    Raises:
        EvidenceError: If the words have another form.
    """
    found = WORDS.fullmatch(words)
    if found is None:
        raise EvidenceError(
            f"{words!r} has not the form LEARNER [CONDITION] [train|test] [trial N|part N], or "
            "LEARNER parameter NAME"
        )
    return {
        column: [int(value)] if column in ("trial", "part") else value.split("+")
        for column, value in present(found.groupdict()).items()
    }


class Contrast(StrictModel):
    """A difference between two selections in words, or between one and a known number.

    ``smallest`` is the smallest difference that matters, 0 from a bound.
    """

    measure: Literal[MEASURES]  # type: ignore[valid-type]
    of: str
    minus: str | float
    expected: Literal["less", "more", "same"]
    smallest: NotNegative = 0.0

    @model_validator(mode="after")
    def _says_what_matters(self) -> Contrast:
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

    A row, by its label, and a column together are a :func:`selection` in words, such as ``ddqn
    CC4`` and ``part 5``. With ``trained_before`` a column has the attempts of
    training before the experiment.
    """

    measure: Literal[MEASURES]  # type: ignore[valid-type]
    rows: dict[str, str]
    columns: list[str]
    interval: bool = False
    trained_before: bool = False


class Networks(StrictModel):
    """Networks that are trained first, each of which is a unit: files of trainings by label.

    A variant plays with the first file's networks, and has other ``parameters`` by its label.
    """

    files: Annotated[dict[Name, str], Field(min_length=1)]
    seeds: Annotated[list[int], Field(min_length=1)]
    learner: Name = "rl2"
    parameters: dict[Name, dict[str, Any]] = Field(default_factory=dict)

    def played_by(self, label: str) -> str:
        """The label of the networks that a learner plays with."""
        return label if label in self.files else next(iter(self.files))


class Theories(StrictModel):
    """How theories predict subjects, and which learners' parameters are recovered.

    With ``draws`` likelihoods are averaged over so many draws of parameters that no theory knows.
    Learners ``outside`` make subjects and predict none. Of each learner in ``parameters`` as many
    ``sets`` are fitted, with ``candidates``.
    """

    draws: Whole = 0
    outside: list[Name] = Field(default_factory=list)
    parameters: list[Name] = Field(default_factory=list)
    sets: Count = 20
    candidates: Count = 40


class StudyFile(StrictModel):
    """A ``study.yaml``.

    What is ``measured`` are trials of people's protocol, parts of a long course, trials of one by
    fifties, which theory is taken for which, or what learners of 0.2 measured of themselves. Its
    ``fits`` are files that parameters come from, ``fitted`` how many numbers of a learner were
    fitted to people's fourteen means. Of a ``published`` study, whose experiment uses what has been
    removed since that version, the experiment is not read, and what is stored stands.
    """

    title: str
    about: str = ""
    experiment: str
    measured: Literal["trials", "course", "curve", "theories", "metrics"] = "trials"
    theories: Theories = Field(default_factory=Theories)
    derived: Literal["distances_from_people", "learning_costs", "confusion"] | None = None
    fits: list[str] = Field(default_factory=list)
    fitted: dict[str, Count] = Field(default_factory=dict)
    networks: Networks | None = None
    published: str | None = None
    hours: float
    claims: dict[str, Claim] = Field(default_factory=dict)
    tables: dict[str, Table] = Field(default_factory=dict)
    figures: list[str] = Field(default_factory=list)


@dataclass(frozen=True)
class Study:
    """A study: its folder, and what its ``study.yaml`` declares."""

    folder: Path
    file: StudyFile

    @property
    def name(self) -> str:
        """The name of its folder."""
        return self.folder.name

    @property
    def unit(self) -> Literal["network", "subject"]:
        """Unit that was drawn independently."""
        return "network" if self.file.networks else "subject"

    @cached_property
    def asked(self) -> Experiment:
        """The experiment as its file declares it now.

        Raises:
            EvidenceError: If the study is published, or names code besides this project's.
        """
        if self.file.published:
            raise EvidenceError(
                f"{self.name} was published with version {self.file.published} and cannot be run "
                "with this one, which lacks options that it uses; play it with that version"
            )
        path = (self.folder / self.file.experiment).resolve()
        if code := [name for name, _ in code_named(read_document(path).data)]:
            raise EvidenceError(
                f"{path} names code ({joined(code)}), which studies do not run; give a learner "
                "or reward of this project"
            )
        return read_experiment(path)

    @property
    def learners(self) -> list[str]:
        """Labels of what plays."""
        if networks := self.file.networks:
            return [*networks.files, *networks.parameters]
        return [spec.name for spec in self.asked.learners]

    @cached_property
    def declared(self) -> str:
        """A hash of what is run: of the experiment with all its schemas, and of trainings."""
        file, networks = self.file, self.file.networks
        run: dict[str, Any] = {"experiment": self.asked.declaration, "measured": file.measured}
        if networks:
            trainings = [read_document(self.folder / one).data for one in networks.files.values()]
            run |= {"trainings": trainings, "networks": networks.model_dump()}
        if file.measured == "theories":
            run["theories"] = file.theories.model_dump(exclude_defaults=True)
        return _digest(run)

    def margin(self, claim: str) -> str:
        """A hash of the contrasts of a claim."""
        contrasts = self.file.claims[claim].contrasts.items()
        return _digest({part: one.model_dump(exclude_defaults=True) for part, one in contrasts})

    def faults(self) -> list[str]:
        """Faults: what is named and not played, and a seed that a stored fit played with."""
        seed, conditions = self.asked.seed, [one.name for one in self.asked.conditions]
        faults = [
            f"fits: {name} played with the seed {seed} of this study, so its rooms are not fresh; "
            "choose another seed"
            for name in self.file.fits
            if seed in seeds_of(self.folder / name)
        ]
        named = [("fitted", name, self.learners) for name in self.file.fitted]
        named += [("figures", name, [*self.file.tables, DERIVED]) for name in self.file.figures]
        everyone = [EVERYONE] if self.file.measured == "theories" else []
        for place, words in self._selected():
            selected = selection(words)
            (learner,) = selected["learner"]
            published = PAPER_CONDITIONS if learner in PUBLISHED else ()
            named.append((place, learner, [*self.learners, *PUBLISHED, *everyone]))
            named += [(place, name, [*conditions, *published])
                      for name in selected.get("condition", ())]  # fmt: skip
        return faults + [
            f"{place}: {name!r} is not there; {nearest(name, known)}"
            for place, name, known in named
            if name not in known
        ]

    def _selected(self) -> Iterator[tuple[str, str]]:
        """What claims and tables select, in words, each with its place."""
        for name, claim in self.file.claims.items():
            for contrast in claim.contrasts.values():
                sides = (contrast.of, contrast.minus)
                yield from ((f"claims: {name}", side) for side in sides if isinstance(side, str))
        for name, table in self.file.tables.items():
            for row, column in product(table.rows, table.columns):
                yield f"tables: {name}", f"{row} {column}"


def named(what: str, name: str, known: Mapping[str, T]) -> T:
    """The study, claim, ... of a name.

    Raises:
        EvidenceError: If there is none; the message suggests the nearest name.
    """
    if name not in known:
        raise EvidenceError(f"there is no {what} {name!r}; {nearest(name, known)}")
    return known[name]


def _digest(content: Any) -> str:
    return digest(json.dumps(content, sort_keys=True))


def read_studies(root: Path, names: Sequence[str] = ()) -> list[Study]:
    """The studies of a folder, by name; all of them by default.

    Raises:
        FileError: With line, column and remedy of the first fault of a ``study.yaml``.
        EvidenceError: If there is no study of a name.
    """
    known = {path.parent.name: path for path in sorted(root.glob(f"*/{FILE}"))}
    files = [named("study", name, known) for name in names or known]
    return [Study(path.parent, read_document(path).validate(StudyFile)) for path in files]
