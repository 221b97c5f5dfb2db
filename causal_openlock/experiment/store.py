"""A results folder: what was run, one Parquet file for each cell, and the report.

::

    DIR/
      experiment.json       everything that determines the results, and the files they are in
      cells/                one file a cell; its name ends with the cell's identity. Beside it, as
                            long as the cell is played: its checkpoint, and how far it is
      report.html  summary.csv  figures/
      errors/               why cells failed: a file each, a sentence and the traceback

A cell's file is complete or not there, so a comparison killed at any moment goes on where it was.
Cells and ``experiment.json`` carry checksums (:mod:`causal_openlock.files.checksums`): a file that
is not what was written, for whatever reason, is named, and its cell is played again.

A folder keeps every cell that was ever done in it, by identity. What is shown are those of the
experiment that was asked for last; so a learner can be mended, taken out, put back or added, and
only cells that are not there are played. One process at a time works in a folder: it holds a lock
on it, which the system takes back when the process ends, however it ends.
"""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from causal_openlock.errors import OpenLockError, StoreError, in_short
from causal_openlock.experiment.experiment import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.protocol import Condition
from causal_openlock.files.atomic import PARTIAL, sweep, write_bytes
from causal_openlock.files.checksums import (
    ChecksumError,
    json_bytes,
    read_json,
    read_table,
    table_bytes,
)
from causal_openlock.version import __version__

if TYPE_CHECKING:
    import pyarrow as pa

    from causal_openlock.experiment.stored import StoredExperiment

IDENTITY = b"causal_openlock.cell"
VERSIONS = b"causal_openlock.versions"
LOCK = ".lock"
CHECKPOINT, ATTEMPTS, PROGRESS = ".checkpoint", ".attempts", ".progress"
"""What is beside a cell's file while it is played; see
:mod:`causal_openlock.experiment.checkpoint`."""
LOG = "log.jsonl"
"""What people did, in a folder of theirs; see :mod:`causal_openlock.play.log`."""
_ERRORS = re.compile(r".+_[0-9a-f]{12}\.txt")
_CELL = re.compile(r"(?!\.)[^/\\:\x00-\x1f\x7f-\x9f]{1,240}\.parquet")
"""A file name, and nothing that any system takes for a path."""


class Store:
    """A results folder, as :func:`~causal_openlock.experiment.runner.run` leaves it.

    Args:
        folder: Where it is.

    Example:
        >>> store = Store("results/first_look")
        >>> store.name is None  # nothing was played there
        True
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.cells = self.folder / "cells"
        self._declared = self.folder / "experiment.json"
        self._lock: IO[bytes] | None = None

    # -- the folder -----------------------------------------------------------------------------

    def open(self, experiment: Experiment, *, changed: bool = True) -> None:
        """Make the folder ready for an experiment: a new one, or one that is done in part.

        Args:
            experiment: What is to be played.
            changed: Whether a changed form of the experiment that the folder is of may be played
                there. The rule: they share a cell, or at least name, seed and version, and a
                learner with the same parameters in the same condition.

        Raises:
            StoreError: If it holds something else, is in use, or cannot be written to.
        """
        try:
            self._prepare(experiment, changed)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise _unusable(self.folder, error.strerror) from None
            if isinstance(error, OpenLockError) and not isinstance(error, StoreError):
                raise StoreError(str(error)) from None
            raise

    def _prepare(self, experiment: Experiment, changed: bool) -> None:
        if self.folder.exists() and not self.folder.is_dir():
            raise StoreError(f"{self.folder} is a file; choose a folder for the results")
        check_inside(self.folder)
        there = self.folder.iterdir() if self.folder.exists() else ()
        # A start that was cut short leaves a lock and parts of files.
        foreign = any(path.name != LOCK and not path.match(PARTIAL) for path in there)
        if foreign and not self._declared.exists():
            raise StoreError(
                f"{self.folder} is not empty and holds no results; choose another folder"
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        self._take_lock()
        files = {cell.file_name for cell in experiment.cells()}
        if self._is_of(experiment, files, changed):
            self.declare(experiment, experiment.cells())
        self.cells.mkdir(exist_ok=True)
        sweep(self.folder)
        sweep(self.cells)
        known = {Path(name).stem for name in files}
        for path in self.cells.iterdir():
            foreign = path.suffix in (CHECKPOINT, ATTEMPTS) and path.stem not in known
            if foreign or path.suffix == PROGRESS:
                path.unlink(missing_ok=True)
        for path in (self.folder / "errors").glob("*.txt"):
            if path.stem not in known and _ERRORS.fullmatch(path.name):
                path.unlink(missing_ok=True)

    def _is_of(self, experiment: Experiment, files: set[str], changed: bool) -> bool:
        """Whether the folder is to be declared as of an experiment; refuses if it must not be."""
        done = {path.name for path in self.cells.glob("*.parquet")}
        if not self._declared.exists():
            return True
        try:
            held = self.experiment()
        except StoreError:
            if not changed and (self.folder / LOG).exists():
                return False  # the log tells what it is of
            # The names of cells end with their identities.
            if not done or done & files:
                return True
            raise
        if held.identity == experiment.identity:
            return False
        # Where nothing is done yet, nothing is lost by another experiment.
        if not done or (changed and (done & files or _akin(held, experiment))):
            return True
        made = f", made with version {held.version}" * (held.version != __version__)
        raise StoreError(
            f"{self.folder} holds another experiment ({held.name}, seed {held.seed}{made}), "
            "or this one with other settings, schemas or learners, and no cell of what is asked "
            "for; choose another folder"
        )

    @property
    def name(self) -> str | None:
        """The name of the experiment that the folder is of, if it is of one."""
        try:
            return self.experiment().name
        except OpenLockError:
            return None

    def declare(
        self, experiment: Experiment, cells: Iterable[Cell], identity: str | None = None
    ) -> None:
        """Write ``experiment.json``, if that is not what it holds: the experiment and these cells.

        The identity is by default the experiment's own.

        Raises:
            OpenLockError: If it cannot be written.
        """
        held = {
            "identity": identity or experiment.identity,
            **experiment.as_dict(),
            "cells": [cell.file_name for cell in cells],
        }
        content = json_bytes(held)
        with suppress(OSError):
            if self._declared.read_bytes() == content:
                return
        write_bytes(self._declared, content)

    def close(self) -> None:
        """Let others work in the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _take_lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # a system without such locks
            return
        self.close()
        lock = (self.folder / LOCK).open("wb")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            raise StoreError(
                f"{self.folder} is in use by another comparison; wait for it, or choose another "
                "folder"
            ) from None
        self._lock = lock

    def experiment(self) -> StoredExperiment:
        """The experiment that the folder is of, from ``experiment.json``.

        Raises:
            StoreError: If the folder holds no results, or the file is damaged or malformed.
        """
        from causal_openlock.experiment.stored import parse_experiment

        try:
            found = parse_experiment(read_json(self._declared.read_bytes()))
        except OSError:
            raise StoreError(
                f"{self.folder} holds no results (there is no experiment.json); give the folder "
                "that compare wrote to"
            ) from None
        except (ChecksumError, StoreError) as error:
            raise self._damaged(self._declared, str(error)) from None
        check_inside(self.folder, found.files)
        return found

    # -- its cells ------------------------------------------------------------------------------

    def path(self, cell: Cell) -> Path:
        """Where a cell's record belongs."""
        return self.cells / cell.file_name

    def clear(self, cell: Cell) -> None:
        """Remove what stood beside a cell's record while it was played."""
        for suffix in (CHECKPOINT, ATTEMPTS, PROGRESS):
            self.path(cell).with_suffix(suffix).unlink(missing_ok=True)

    def share(self, cell: Cell) -> tuple[int, float] | None:
        """How far a cell is that is being played: the number of its report, and the share over."""
        path = self.path(cell).with_suffix(PROGRESS)
        with suppress(OSError, ValueError):  # just written, or just removed
            return path.stat().st_mtime_ns, float(path.read_text(encoding="utf-8"))
        return None

    def blame(self, cell: Cell, what: str, trace: str) -> str:
        """Keep why a cell failed: a clause that follows its name, and the traceback.

        Returns the sentence.

        Raises:
            OpenLockError: If it cannot be written.
        """
        why = f"the learner {cell.in_words}, {what}"
        write_bytes(self.error(cell), f"{why}\n\n{trace}".encode("utf-8", "backslashreplace"))
        return why

    def error(self, cell: Cell) -> Path:
        """Where it is kept why a cell failed."""
        return self.folder / "errors" / f"{Path(cell.file_name).stem}.txt"

    def forgive(self, cell: Cell) -> None:
        """Forget that a cell failed."""
        self.error(cell).unlink(missing_ok=True)

    def check(self, cell: Cell) -> str | None:
        """What is wrong with a cell's record: ``"missing"``, or what is damaged; else ``None``."""
        path = self.path(cell)
        if not path.exists():
            return "missing"
        try:
            self.read(path, cell.identity)
        except StoreError as error:
            return str(error).rpartition("; ")[0]  # the remedy: its cell is run again anyway
        return None

    def read(
        self, path: Path, identity: str | None = None, columns: Sequence[str] | None = None
    ) -> pa.Table:
        """The record in a cell's file; its metadata hold :data:`IDENTITY` and :data:`VERSIONS`.

        Args:
            path: Its file.
            identity: The cell that it is to be of; by default the one that the file's name gives.
            columns: Those to read; by default all.

        Raises:
            StoreError: If the file is missing, damaged, or belongs to another cell.
        """
        import pyarrow as pa

        from causal_openlock.experiment.record import record_schema

        try:
            table = read_table(path.read_bytes(), columns)
        except FileNotFoundError:
            raise StoreError(f"{path} is missing; run compare again to make it") from None
        except (OSError, ChecksumError) as error:
            raise self._damaged(path, str(error)) from None
        metadata = table.schema.metadata or {}
        held = metadata.get(IDENTITY, b"").decode(errors="replace")
        if not held or not held.startswith(identity or path.stem.rpartition("_")[2]):
            raise self._damaged(path, "it holds another cell")
        schema = record_schema()
        if columns is not None:
            schema = pa.schema([schema.field(name) for name in columns])
        try:
            # Files of other programs may code names in other ways.
            table = table.replace_schema_metadata(None).cast(schema)
            table.validate(full=True)
        except (pa.ArrowException, ValueError):
            table = None
        if table is None or any(column.null_count for column in table.columns):
            raise self._damaged(path, "its columns are not those of a record")
        return table.replace_schema_metadata(metadata)

    def write(self, cell: Cell, record: pa.Table) -> None:
        """Keep a cell's record.

        Raises:
            StoreError: If it cannot be written; nothing is left of it then.
        """
        metadata = {IDENTITY: cell.identity.encode(), VERSIONS: json.dumps(versions()).encode()}
        path = self.path(cell)
        try:
            write_bytes(path, table_bytes(record, metadata))
        except OpenLockError as error:
            raise _unusable(path, in_short(error.__cause__ or error)) from None

    def record(
        self, columns: Sequence[str] | None = None, *, small: bool = False
    ) -> tuple[pa.Table, StoredExperiment]:
        """The records of all cells as one, in their order, and :meth:`experiment`.

        The latter has the versions of the packages that the cells were made with, the cells that
        are missing, and why those of them that failed did.

        Args:
            columns: Those to read, in the order of a record; by default all.
            small: Whether it is to be :func:`~causal_openlock.experiment.record.compact`.

        Raises:
            StoreError: If there is no cell, or one is damaged.
        """
        import pyarrow as pa

        from causal_openlock.experiment.record import compact

        experiment = self.experiment()
        listed = {
            "learner": {spec.name for spec in experiment.learners},
            "condition": {condition.name for condition in experiment.conditions},
        }
        there, absent = self._split(experiment)
        tables, made_with = [], []
        for path in there:
            table = self.read(path, columns=columns)
            for column in listed.keys() & set(table.column_names):
                names = {
                    name for part in table[column].chunks for name in part.dictionary.to_pylist()
                }
                if strange := sorted(names - listed[column]):
                    raise StoreError(
                        f"{self.folder} holds cells of the {column} {strange[0]!r}, which its "
                        "experiment.json does not list; give compare another --out"
                    )
            made_with.append(_versions_of(table, path))
            table = table.replace_schema_metadata(None)
            tables.append(compact(table) if small else table)
        failures = {}
        for path in absent:
            with suppress(OSError):
                text = (self.folder / "errors" / f"{path.stem}.txt").read_text("utf-8", "replace")
                failures[path.stem] = text.partition("\n")[0]
        return pa.concat_tables(tables), replace(
            experiment,
            versions=merged_versions(made_with),
            missing=tuple(path.stem for path in absent),
            failures=failures,
        )

    def files(self) -> tuple[list[Path], list[Path]]:
        """The files of the cells that are there, in order, and of those that are not.

        Raises:
            StoreError: If the folder holds no results, or no cell.
        """
        return self._split(self.experiment())

    def _split(self, experiment: StoredExperiment) -> tuple[list[Path], list[Path]]:
        parts: tuple[list[Path], list[Path]] = [], []
        for name in experiment.files:
            path = self.cells / name
            parts[not path.exists()].append(path)
        if not parts[0]:
            raise StoreError(f"{self.folder} holds no cell yet; run compare to the end first")
        return parts

    def _damaged(self, path: Path, what: str) -> StoreError:
        if (self.folder / LOG).exists():
            remedy = "start play with this folder and stop it: it is made anew from what is logged"
        else:
            remedy = "run compare again, with the same command, to make it anew"
        return StoreError(f"{path} is damaged ({what}); {remedy}")


def check_inside(folder: Path, cells: Sequence[Any] = ()) -> None:
    """Make sure that nothing in a results folder leads out of it.

    Folders are passed on: what ``experiment.json`` says was written by whoever made it, and an
    unpacked archive may hold links. (The folder itself may be a link; its owner has made that.)

    Args:
        folder: The folder; it need not be there.
        cells: What its ``experiment.json`` lists as the files of its cells.

    Raises:
        StoreError: If a cell's name is no name of a file, or a link leads elsewhere.
    """
    for name in cells:
        if not (isinstance(name, str) and _CELL.fullmatch(name)):
            raise StoreError(
                f"{folder / 'experiment.json'} lists {str(name)[:80]!r} among the cells, which is "
                f"no file in {folder / 'cells'}; do not use this folder, somebody has changed it"
            )
    home = folder.resolve()
    for place, folders, files in os.walk(folder):  # which does not follow links to folders
        for path in (Path(place, name) for name in (*folders, *files)):
            if path.is_symlink():
                if not path.resolve().is_relative_to(home):
                    raise StoreError(
                        f"{path} is a link that leads out of {folder}; put what it points to in "
                        "its place, if you know where it comes from"
                    )
            elif not (path.is_file() or path.is_dir()):
                raise StoreError(f"{path} is neither a file nor a folder; remove it")


def _versions_of(record: pa.Table, path: Path) -> dict[str, Any]:
    """What a cell was made with, as its file says: of each package its version, or several."""
    from pydantic import TypeAdapter, ValidationError

    held = (record.schema.metadata or {}).get(VERSIONS, b"{}")
    try:
        return TypeAdapter(dict[str, str | list[str]]).validate_json(held)
    except ValidationError:
        message = f"{path} does not say what it was made with; do not use it"
        raise StoreError(message) from None


@cache
def versions() -> Mapping[str, str]:
    """What a cell is made with: versions by the name of the package."""
    found = {"Python": platform.python_version()}
    for package in ("causal-openlock", "numpy", "torch", "networkx"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def merged_versions(all_of_them: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Of each package its version, or a list where there are several."""
    found: dict[str, dict[str, None]] = {}
    for versions in all_of_them:
        for package, held in versions.items():
            several = [held] if isinstance(held, str) else held
            found.setdefault(package, {}).update(dict.fromkeys(several))
    return {name: next(iter(held)) if len(held) == 1 else [*held] for name, held in found.items()}


def _akin(held: Experiment, experiment: Experiment) -> bool:
    """Whether an experiment is another form of one that a folder holds.

    Code is left out: a learner that was mended is to take its place again.
    """

    def settings(parts: Iterable[LearnerSpec | Condition]) -> set[str]:
        code = ("class", "package", "material", "subjects")
        data = ({k: v for k, v in part.as_dict().items() if k not in code} for part in parts)
        return {json.dumps(one, sort_keys=True) for one in data}

    return (
        (held.name, held.seed, held.version) == (experiment.name, experiment.seed, __version__)
        and not settings(held.learners).isdisjoint(settings(experiment.learners))
        and not settings(held.conditions).isdisjoint(settings(experiment.conditions))
    )


def _unusable(path: Path, why: str | None) -> StoreError:
    return StoreError(
        f"{path} cannot be written ({why or 'the system does not say why'}); free some space or "
        "choose another folder, then run the same command again: it goes on where it was"
    )
