"""Experiment files: YAML to an :class:`Experiment`, with line numbers for faults.

Only ``name``, ``conditions`` and ``learners`` are required; editors check files by the JSON Schema
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from causal_openlock.contract.registry import file_that_runs
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import SHOWN, Condition, Experiment, LearnerSpec
from causal_openlock.experiment.making import Changes, declared
from causal_openlock.files.yaml_file import read_document
from causal_openlock.schemas.finding import bundled, bundled_schemas
from causal_openlock.usercode.own_files import look_beside
from causal_openlock.wording import nearest

LONGEST_NAMES = 28
"""The longest list of learners or conditions in the name of a comparison, which has two."""


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

    Args:
        data: The content of the file; none of the code runs.
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
