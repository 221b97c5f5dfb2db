"""Declaring an experiment: in a YAML file, with line numbers for faults, or in Python.

A file needs only ``name``, ``conditions`` and ``learners``; editors check it by the JSON Schema
``experiments/schema.json``::

    name: first_look
    protocol: short               # or human, or rl
    reward: paper                 # a preset, a list of terms, weights, or module:function
    conditions:
      - CC3-CC4
      - name: keys_then_chain
        train: [{schema: two_keys, layouts: random, trials: 4}]
        test: [{schema: chain3, layouts: [trial1, {L0: LEFT, L1: UPPER, L2: LOWER}]}]
    learners:
      - random
      - {learner: ddqn, name: ddqn_slow, parameters: {learning_rate: 0.0001}, subjects: 10}
    protocols:
      short: {based_on: rl, attempt_limit: 60, train_loops: 2}
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from causal_openlock.contract.learner import LearnerBase
from causal_openlock.contract.registry import file_that_runs, name_of
from causal_openlock.errors import LearnerError, OpenLockError, together
from causal_openlock.experiment.condition import SHOWN, Condition
from causal_openlock.experiment.declare import AnyLearner, Experiment, LearnerSpec, points
from causal_openlock.experiment.plan import plan
from causal_openlock.experiment.protocol import HUMAN_PROTOCOL, Protocol, Seed, Subjects
from causal_openlock.files.validation import Part, known_arguments, part, plain, present, read
from causal_openlock.files.yaml_file import Document, read_document
from causal_openlock.schemas.finding import bundled, bundled_schemas
from causal_openlock.schemas.schema import Schema
from causal_openlock.usercode.own_files import look_beside
from causal_openlock.wording import nearest
from causal_openlock.world.rewards import PAPER_REWARD, RewardForm

ConditionForm = str | Path | Schema | Condition | Mapping[str, Any] | Sequence[str | Schema]
"""A condition by its name (``CC4``, ``CC3-CC4``, ``my.yaml``), as a schema (a baseline; also in a
line of text, ``A -> B -> door``), as a sequence of schemas (train on all but the last, then test on
the last), or spelled out as in an experiment file, ``{"train": {"shown": "CC3"}, "test": "CC4"}``.
"""

LearnerForm = str | type[LearnerBase] | Mapping[str, Any] | Sequence[Mapping[str, Any]]
"""A learner by its name (``ddqn``, ``my_module:Mine``), as a class, or as :func:`learner` describes
it; or the learners of a :func:`sweep`."""

ProtocolForm = str | Protocol | Mapping[str, Any]
"""A protocol by its name, as a :class:`Protocol`, or as an experiment file has one of its own:
``{"based_on": "human", "attempt_limit": 10}``, perhaps with a ``name``."""

LONGEST_NAMES = 28  #: of a list of learners or conditions in the name of a comparison


@part()
class Changes(Part):
    """Changes to an experiment file; ``None`` changes nothing. Only names have options.

    Example:
        >>> Changes(subjects=10, learners=["oracle"]).options
        ['--learner', 'oracle', '--subjects', '10']
    """

    conditions: Sequence[Any] | None = None
    learners: Sequence[Any] | None = None
    protocol: Any = None
    subjects: Subjects | None = None
    seed: Seed | None = None

    @property
    def given(self) -> dict[str, Any]:
        """What is changed, by name."""
        return present(vars(self))

    @property
    def options(self) -> list[str]:
        """The equivalent options of the command line."""
        named = [("--condition", name) for name in self.conditions or ()]
        named += [("--learner", name) for name in self.learners or ()]
        others = ("protocol", "subjects", "seed")
        named += [(f"--{key}", self.given[key]) for key in others if key in self.given]
        return [str(word) for option in named for word in option]

    def applied(self, data: Mapping[str, Any]) -> dict[str, Any]:
        """The data of an experiment file, changed; the file's entries are chosen by name."""
        changed = {**data, **self.given}
        for key in {"conditions", "learners"} & self.given.keys():
            changed[key] = [entry for form in self.given[key] for entry in _chosen(form, data, key)]
        if isinstance(changed.get("learners"), list):
            overruled = {"protocol", "subjects"} & self.given.keys()
            changed["learners"] = [
                {key: entry[key] for key in entry if key not in overruled}
                if isinstance(entry, Mapping)
                else entry
                for entry in changed["learners"]
            ]
        return changed


def _chosen(form: Any, data: Mapping[str, Any], key: str) -> list[Any]:
    """What a form stands for: entries of its name or label in a file, or else itself."""
    in_file = data[key] if isinstance(data.get(key), list) else []
    spelled = [entry for entry in in_file if isinstance(entry, Mapping)]
    named = [part for entry in spelled for part in (entry, *points(entry))]
    return [part for part in named if form == (part.get("name") or part.get("learner"))] or [form]


def declared(
    data: Mapping[str, Any], document: Document | None = None, changed: Iterable[str] = ()
) -> Experiment:
    """The experiment that is declared by its parts, in any of their forms.

    Raises:
        FileError: With the place of every fault in the document, but for what was ``changed``.
        OpenLockError: With every fault elsewhere; or if schemas do not fit a protocol.
    """
    folder = document.path.resolve().parent if document else Path.cwd()
    context = {"folders": [folder], "protocols": {}}
    if document:
        experiment = document.validate(Experiment, data, context, changed)
    else:
        experiment = read(Experiment, data, context)
    errors = []
    for spec, condition in product(experiment.learners, experiment.conditions):
        once = replace(spec.protocol, baseline_loops=1, train_loops=1, test_loops=1)
        try:  # a comparison could fail after an hour
            plan(condition, once, np.random.default_rng(0))
        except OpenLockError as error:
            errors.append(error)
    if errors:
        raise together(errors)
    return experiment


def read_experiment(
    path: Path | str, changes: Changes | None = None, tell: Callable[[str], None] | None = None
) -> Experiment:
    """Read an experiment file.

    Args:
        path: The file.
        changes: Changes to it.
        tell: Called with a sentence before code runs that the file names and that is not part of an
            installed package.

    Raises:
        FileError: With line, column and remedy of every fault of the file, or of a schema file
            that it names.
        OpenLockError: If one of the changes does not fit.

    Example:
        >>> changes = Changes(learners=["oracle"], conditions=["CC3", "CC3-CC4"], subjects=10)
        >>> experiment = read_experiment(find_experiment("default"), changes)
        >>> [cell.in_words for cell in experiment.cells()]
        ['oracle in CC3, subjects 0-9', 'oracle in CC3-CC4, subjects 0-9']
    """
    document, changes = read_document(path), changes or Changes()
    data = document.data
    if isinstance(data, Mapping):
        if {"levers", "edges"} <= data.keys():
            raise OpenLockError(f"{path} is a schema; play it with: compare --condition {path}")
        name = data.get("name")
        data = changes.applied({"title": name if isinstance(name, str) else "", **data})
        folder, sentences = document.path.resolve().parent, set()
        for code, role in code_named(data):
            look_beside(folder)
            if code not in (changes.learners or ()):  # or who typed it knows
                sentences.add(file_that_runs(code, folder, role))
        for sentence in sorted(filter(None, sentences)) if tell else ():
            tell(sentence)  # type: ignore[misc]
    experiment = declared(data, document, changes.given)
    chosen = [*(changes.conditions or ()), *(changes.learners or ())]
    words = ["causal-openlock", "compare", document.path.as_posix(), *changes.options]
    can_be_typed = all(isinstance(form, str) for form in [*chosen, changes.protocol or ""])
    command = shlex.join(words) if can_be_typed else ""
    if not chosen:
        return replace(experiment, command=command)
    players = _in_short(experiment.learners, "learners")
    places = _in_short(experiment.conditions, "conditions")
    return replace(experiment, name=f"{players}_in_{places}", title="", command=command)


def _in_short(parts: Sequence[LearnerSpec] | Sequence[Condition], what: str) -> str:
    """Names of learners or conditions as a part of a name, or their number if they are too long."""
    names = re.sub(r"[^A-Za-z0-9_.-]+", "_", "_".join(part.name for part in parts)).strip("_.-")
    return names if 0 < len(names) <= LONGEST_NAMES else f"{len(parts)}_{what}"


def code_named(data: Any) -> Iterator[tuple[str, str]]:
    """The learners and rewards that an experiment file names as ``module:name``, with their role.

    None of the code runs.
    """
    whole = data if isinstance(data, Mapping) else {}
    learners = whole["learners"] if isinstance(whole.get("learners"), list) else []
    for entry in [{"reward": whole.get("reward")}, *learners]:
        named = entry if isinstance(entry, Mapping) else {"learner": entry}
        for role in ("learner", "reward"):
            if isinstance(name := named.get(role), str) and ":" in name:
                yield name, role


def find_experiment(name: str | Path) -> Path:
    """The file of an experiment, by path or by the name of a bundled one.

    Raises:
        OpenLockError: If there is none; the message suggests the nearest name.
    """
    if Path(name).suffix in (".yaml", ".yml"):
        return Path(name)
    for folder in (Path("experiments"), bundled("experiments")):
        if (path := folder / f"{name}.yaml").is_file():
            return path
    known = [path.stem for path in folder.glob("*.yaml")]
    remedy = "or give the path of a .yaml file"
    if {*str(name).split("-")} <= {*bundled_schemas(), SHOWN}:
        remedy += f"; the condition {name} is played by: compare --condition {name}"
    raise OpenLockError(
        f"there is no experiment {str(name)!r}; {nearest(str(name), known)}, {remedy}"
    )


@known_arguments
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
        conditions: A condition or several, each in any form (:data:`ConditionForm`).
        learners: A learner or several: each a name, a class, or what :func:`learner` returns.
        name: A short name.
        title: A line for the report; by default who plays what.
        seed: All randomness comes from it.
        protocol: The protocol of learners that have none of their own.
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
    data = {"name": name, "title": title, "seed": seed, "subjects": subjects, "reward": reward}
    if attempt_limit is not None:
        protocol = {"based_on": protocol, "attempt_limit": attempt_limit}
    players = {"conditions": listed(conditions), "learners": listed(learners)}
    return declared({**data, "protocol": protocol, "cell_size": cell_size, **players})


def listed(forms: Any) -> list[Any]:
    """One condition or learner, or several, as a list; the learners of a sweep are several."""
    single = isinstance(forms, str | Path | Schema | Condition | Mapping | type)
    if single or not isinstance(forms, Iterable):
        return [forms]
    several: list[Any] = []
    for form in forms:
        is_sweep = isinstance(form, list) and form and isinstance(form[0], Mapping)
        several += form if is_sweep else [form]
    return several


def learner(
    learner: LearnerForm,
    /,
    *,
    label: str | None = None,
    subjects: int | None = None,
    protocol: ProtocolForm | None = None,
    reward: RewardForm | None = None,
    **parameters: Any,
) -> dict[str, Any]:
    """A learner with other hyper-parameters, or another part in a comparison.

    Args:
        learner: Its registered name, ``module:Class``, its class, or another :func:`learner`.
        label: What tables call it; by default its name.
        subjects: How many subjects it plays.
        protocol: The protocol that it plays under.
        reward: The reward of its actions, as in an experiment file.
        **parameters: Its hyper-parameters that differ from their defaults.

    Returns:
        What an experiment file says of it; what is not given is as for the other learners.

    Raises:
        LearnerError: If there is no such learner or parameter (the message has the nearest name),
            or a value does not fit.

    Example:
        >>> learner("ddqn", learning_rate=0.0005, label="slow")["parameters"]
        {'learning_rate': 0.0005}
    """
    given = {"name": label, "subjects": subjects, "protocol": protocol, "reward": reward}
    return _entry(learner, present(given), parameters)


def sweep(
    learner_: LearnerForm,
    /,
    *,
    label: str | None = None,
    subjects: int | None = None,
    protocol: ProtocolForm | None = None,
    reward: RewardForm | None = None,
    **parameters: Any,
) -> list[dict[str, Any]]:
    """A learner once for each value of a parameter, or for each combination of several.

    Arguments are those of :func:`learner`, but lists of values of hyper-parameters are swept.

    Raises:
        LearnerError: As for :func:`learner`, or if there is no list.

    Example:
        >>> [point["name"] for point in sweep("bayes", lapse=[0.1, 0.5])]
        ['bayes-lapse-0.1', 'bayes-lapse-0.5']
    """
    fixed = plain(parameters)
    swept = {key: fixed.pop(key) for key, value in [*fixed.items()] if isinstance(value, list)}
    if not swept or not all(swept.values()):
        raise LearnerError("a sweep needs a list of values, such as gamma=[0.5, 0.9]")
    given = {"name": label, "subjects": subjects, "protocol": protocol, "reward": reward}
    return points(_entry(learner_, {**present(given), "sweep": swept}, fixed))


def _entry(learner: Any, given: dict[str, Any], parameters: dict[str, Any]) -> dict[str, Any]:
    """An entry of an experiment file; its protocol may be one that only an experiment knows."""
    entry = {**(learner if isinstance(learner, Mapping) else {"learner": learner}), **given}
    if isinstance(entry["learner"], type):
        entry["learner"] = name_of(entry["learner"])
    entry["parameters"] = {**entry.get("parameters", {}), **parameters}
    read(AnyLearner, {key: value for key, value in entry.items() if key != "protocol"})
    return entry
