"""Running a comparison from Python: the same run as on the command line.

Without a folder of its own a comparison is kept in a temporary one, until Python ends. There, what
has been played is not played again: after an interruption, or with one more learner, only what is
missing is.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from contextlib import closing, nullcontext, suppress
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.comparison.progress_bar import Show, shown
from causal_openlock.errors import CellsFailed, ExperimentError, Interrupted, OpenLockError
from causal_openlock.experiment.condition import Condition, find_condition
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.making import (
    Changes,
    ConditionForm,
    LearnerForm,
    ProtocolForm,
    find_experiment,
    listed,
    make_experiment,
    read_experiment,
)
from causal_openlock.experiment.plan import forewarnings
from causal_openlock.files.atomic import folder_at
from causal_openlock.files.validation import known_arguments, present
from causal_openlock.running.runner import run
from causal_openlock.running.worker import Watching
from causal_openlock.storage.store import Store, StoredExperiment
from causal_openlock.world.rewards import RewardForm

if TYPE_CHECKING:
    from causal_openlock.comparison.results import Results


@known_arguments
def compare(
    what: str | Path | Experiment | ConditionForm | Sequence[ConditionForm],
    learners: LearnerForm | Sequence[LearnerForm] | None = None,
    *,
    subjects: int | None = None,
    protocol: ProtocolForm | None = None,
    attempt_limit: int | None = None,
    seed: int | None = None,
    reward: RewardForm | None = None,
    name: str | None = None,
    title: str | None = None,
    cell_size: int | None = None,
    out: Path | str | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    retry_failed: bool = False,
    allow_version: bool = False,
    checkpoint_every: float = 60.0,
    time_limit: float | None = None,
    tensorboard: Path | str | None = None,
    beside: Path | str | Sequence[Path | str] = (),
) -> Results:
    """Compare learners, with a progress bar in a notebook or on a terminal.

    Args:
        what: A list of conditions: each a name (``"CC4"``, ``"CC3-CC4"``, ``"my.yaml"``), a
            schema, a sequence of schemas whose last one is the test, a :class:`Condition`, or a
            mapping as in an experiment file. Or a single one of these; the name or path of an
            experiment file; or an :class:`Experiment`.
        learners: Learners: each a name, a class, or what :func:`~causal_openlock.learner` or
            :func:`~causal_openlock.sweep` returns. Not needed with an experiment; with an
            experiment file, these play in place of those in the file.
        subjects: Subjects of each learner in each condition; by default 40, or as the file says.
        protocol: The protocol: its name, a :class:`Protocol`, or settings as in an experiment file,
            ``{"based_on": "rl", "train_loops": 2}``; by default ``"human"``, or as the file says.
        attempt_limit: Attempts in a trial, if another number than the protocol's.
        seed: All randomness comes from it; by default 0, or as the file says.
        reward: The reward of actions, as in an experiment file, or a function of events; by
            default the paper's.
        name: A short name; by default ``"comparison"``.
        title: A line for the report; by default who plays what.
        cell_size: Most subjects in a unit of work; by default 40.
        out: Folder for the results; one that holds a part of this comparison is completed. By
            default they are kept until Python ends, or :meth:`Results.save` keeps them.
        workers: Number of processes; by default one for each core. With 0 this process plays, one
            cell after another: small comparisons need not wait for another one to start.
        cluster: Address of a Dask scheduler whose workers play, such as ``"tcp://host:8786"``.
        retry_failed: Whether cells that have failed three times are tried again.
        allow_version: Whether a folder that was made with other versions of packages is completed
            with those here.
        checkpoint_every: Seconds between checkpoints inside a cell.
        time_limit: Seconds after which a cell is ended and counted as failed; by default never.
        tensorboard: Folder for TensorBoard's logs.
        beside: Results folders whose people or learners these are compared with: see
            :func:`open_results`.

    Raises:
        LearnerError: If there is no such learner or parameter; the message has the nearest name.
        Interrupted: If it is stopped; finished cells are stored, and the same call continues.
        OpenLockError: If what is asked for cannot be done.

    Example:
        >>> results = compare(["CC3", "CC3-CC4"], ["oracle", "random"], subjects=2, workers=1)
        >>> results.headline[["learner", "condition", "attempts"]].head(1).values.tolist()
        [['oracle', 'CC3-CC4', 3.0]]
    """
    # Results load pandas, half a second, which declaring an experiment does not need.
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.results import open_results

    changes = {"subjects": subjects, "protocol": protocol, "seed": seed, "reward": reward}
    declared = {"attempt_limit": attempt_limit, "name": name, "title": title}
    given = present({**changes, **declared, "cell_size": cell_size})
    experiment = _experiment(what, learners, given, out)
    folder = _temporary_folder(experiment) if out is None else folder_at(out)
    console = Terminal(stderr=True)
    is_seen = console.is_jupyter or console.is_terminal  # by whoever runs Python, and not in a file
    try:
        with shown(experiment.name, console) if is_seen else nullcontext() as show:
            failed = play(
                experiment,
                folder,
                warn=_warn,
                progress=show,
                beside=beside,
                workers=workers,
                cluster=cluster,
                retry_failed=retry_failed,
                allow_version=allow_version,
                checkpoint_every=checkpoint_every,
                time_limit=time_limit,
                tensorboard=tensorboard,
            )
    except KeyboardInterrupt:
        store, cells = Store(folder), experiment.cells()
        done = sum(store.path(cell).exists() for cell in cells)
        raise Interrupted(
            f"stopped: {done} of {len(cells)} cells are done and stored; compare the same again, "
            "and it continues where it stopped"
        ) from None
    if failed and failed.every:
        raise failed
    return open_results(folder, beside=beside)


def play(
    experiment: Experiment,
    folder: Path,
    *,
    warn: Callable[[str], None],
    progress: Show | None = None,
    beside: Path | str | Sequence[Path | str] = (),
    checkpoint_every: float = 60.0,
    tensorboard: Path | str | None = None,
    **options: Any,
) -> CellsFailed | None:
    """Play the missing cells of an experiment, with warnings for the user.

    Arguments are those of :func:`compare`, further ones those of
    :func:`~causal_openlock.running.runner.run`. ``warn`` is called with a sentence for each thing
    to know: what takes long, which cells failed.

    Returns:
        That cells failed, if some did; the reasons have been told.
    """
    for place in listed(beside):  # before anything is played: one may be misspelt
        Store(folder_at(place)).experiment()
    watching = Watching(checkpoint_every, str(tensorboard) if tensorboard else None)
    reasons = experiment.reasons if experiment.cells() else ()  # else it is an error
    for warning in [*forewarnings(experiment), *reasons]:
        warn(warning)
    try:
        run(experiment, folder, warn=warn, progress=progress, watching=watching, **options)
    except CellsFailed as failed:
        return failed
    return None


def _experiment(
    what: Any, learners: Any, given: dict[str, Any], out: Path | str | None
) -> Experiment:
    """The experiment that is asked for."""
    learners = None if learners is None else listed(learners)
    if isinstance(what, StoredExperiment):
        raise ExperimentError(
            "this experiment is the record of one that was run; compare its file again, or "
            "declare it again"
        )
    if isinstance(what, Experiment):
        if given or learners:
            raise ExperimentError(
                "an Experiment has its learners and settings already; compare it without any, or "
                "declare another one with make_experiment"
            )
        return what
    named = isinstance(what, str | Path)
    is_condition = named and _is_found(find_condition, str(what))
    if named and not (learners and (is_condition or not _is_found(find_experiment, what))):
        if is_condition:
            raise ExperimentError(
                f"{what} is a condition; also name the learners: compare({str(what)!r}, ['bayes'])"
            )
        path = find_experiment(what)
        known = {field.name for field in fields(Changes)}
        if strange := sorted(given.keys() - known):
            raise ExperimentError(f"{path} decides the {strange[0]}; change it in that file")
        read = read_experiment(path, Changes(learners=learners, **given))
        if not learners:
            return read
        # With other learners it is one comparison all the same: cells are shared.
        return replace(read, name=(out and Store(folder_at(out)).name) or path.stem)
    if not learners:
        raise ExperimentError("name the learners to compare, such as learners=['bayes', 'ddqn']")
    return make_experiment(what, learners, **given)


def _is_found(find: Callable[[Any], Path | Condition], name: str | Path) -> bool:
    """Whether there is a condition, or an experiment file, of this name."""
    with suppress(OpenLockError):
        found = find(name)
        return not isinstance(found, Path) or found.exists()
    return False


@cache
def _temporary() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="causal_openlock-")


def _temporary_folder(experiment: Experiment) -> Path:
    """A folder until Python ends, with the cells of the experiment that were played before."""
    root = Path(_temporary().name)
    with closing(Store(root / experiment.identity[:12])) as store:
        store.open(experiment)
        for path in map(store.path, experiment.cells()):
            played = next(root.glob(f"*/cells/{path.name}"), None)
            if played and not path.exists():
                shutil.copyfile(played, path)
    return store.folder


def _warn(sentence: str) -> None:
    """Warn, with the line outside the package that asked for the comparison."""
    level, frame = 1, sys._getframe()
    while frame.f_back and frame.f_globals.get("__name__", "").startswith("causal_openlock"):
        level, frame = level + 1, frame.f_back
    warnings.warn(sentence, stacklevel=level)
