"""Experiment files: YAML to an :class:`Experiment`, with line numbers for faults.

An experiment file looks like this; only ``name``, ``conditions`` and ``learners`` are required::

    name: first_look
    title: Random against the oracle
    seed: 2018
    protocol: human               # or rl, or one defined below
    subjects: 40
    reward: paper                 # a preset, a list of terms, weights, or module:function
    conditions: [CC4, CC3-CC4, chain3]
    learners:
      - random
      - oracle
      - {learner: ddqn, name: ddqn_slow, parameters: {learning_rate: 0.0001}, subjects: 10}
    protocols:
      short: {based_on: rl, attempt_limit: 60, train_loops: 2}

Any other condition than ``A`` or ``A-B`` is a sequence of schemas and layouts::

    - name: keys_then_chain
      train: [{schema: two_keys, layouts: random, trials: 4}]
      test: [{schema: chain3, layouts: [trial1, {L0: LEFT, L1: UPPER, L2: LOWER}]}]

The pydantic model :class:`~causal_openlock.experiment.file_format.ExperimentFile` defines the
format; the JSON Schema for editors (``experiments/schema.json``) is generated from it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.building import Changes, as_learner, build
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file_format import ExperimentFile
from causal_openlock.experiment.protocol import SHOWN
from causal_openlock.files.yaml_file import read_document
from causal_openlock.schemas.finding import bundled, bundled_schemas
from causal_openlock.wording import nearest


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
    document = read_document(path)
    if isinstance(document.data, dict) and {"levers", "edges"} <= document.data.keys():
        raise OpenLockError(f"{path} is a schema; play it with: compare --condition {path}")
    file = document.validate(ExperimentFile)
    return build(file, changes, document, tell)


def code_named_in(path: Path) -> list[str]:
    """The learners and rewards that an experiment file names as code, ``module:name``.

    Nothing of it runs.

    Raises:
        FileError: If the file has faults.
    """
    file = read_document(path).validate(ExperimentFile)
    entries = [as_learner(one) for one in file.learners]
    named = [*(one.learner for one in entries), file.reward, *(one.reward for one in entries)]
    return [one for one in named if isinstance(one, str) and ":" in one]


def find_experiment(name: str | Path) -> Path:
    """The file of an experiment, by path or by the name of a bundled one.

    Raises:
        OpenLockError: If there is none; the message suggests the nearest name.
    """
    if Path(name).suffix in (".yaml", ".yml"):
        return Path(name)
    here = Path("experiments") / f"{name}.yaml"
    folder = bundled("experiments")
    for path in (here, folder / f"{name}.yaml"):
        if path.is_file():
            return path
    known = [path.stem for path in folder.glob("*.yaml")]
    remedy = "or give the path of a .yaml file"
    if {*str(name).split("-")} <= {*bundled_schemas(), SHOWN}:
        remedy += f"; the condition {name} is played by: compare --condition {name}"
    raise OpenLockError(
        f"there is no experiment {str(name)!r}; {nearest(str(name), known)}, {remedy}"
    )
