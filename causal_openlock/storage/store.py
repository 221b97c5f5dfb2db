"""A results folder: the experiment, one Parquet file for each cell, and the report.

::

    DIR/
      experiment.json       everything that determines the results, and the names of cells' files
      cells/                one file a cell; its name ends with the cell's identity. While the cell
                            is played, also its checkpoint and its progress
      transcripts/          what was said in a cell, of learners that speak: a line of JSON each
      code/  files/         the user's own code and files that it was played with
      report.html  summary.csv
      errors/               a file for each failed cell: a sentence and the traceback

A cell's file is written completely or not at all. A folder keeps every cell that was ever played in
it, by identity, and shows those of the last experiment: a learner can be corrected, removed, put
back or added.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import field, replace
from pathlib import Path
from typing import Annotated, Any

import pyarrow as pa
from pydantic import AliasChoices, Field, ValidationError

from causal_openlock.errors import OpenLockError, StoreError, in_short
from causal_openlock.experiment.beside_record import unwritten_actions
from causal_openlock.experiment.declare import Cell, Experiment
from causal_openlock.experiment.plan import phases_of
from causal_openlock.experiment.record import record_schema
from causal_openlock.files import checksums
from causal_openlock.files.atomic import folder_at, is_empty, unwritable, write_bytes
from causal_openlock.files.checksums import digest
from causal_openlock.files.validation import adapter, errors_of, part, present
from causal_openlock.storage.beside_cell import ERRORS, failures_of, tidy
from causal_openlock.storage.folder_lock import Shard, locked
from causal_openlock.storage.versions import Versions, merged_versions, other_versions, versions
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import counted

IDENTITY = b"causal_openlock.cell"
VERSIONS = b"causal_openlock.versions"
WARNINGS = b"causal_openlock.warnings"
"""Metadata in the file of a cell."""

LOG = "log.jsonl"
"""The actions of people, in a folder of ``play``; see :mod:`causal_openlock.play.log`."""


@part(kw_only=True)
class StoredExperiment(Experiment):
    """An experiment read from a results folder, with the state of its cells.

    Stored parameters stay as they are.
    """

    identity: str = ""  #: its identity when it was run
    files: Annotated[tuple[str, ...], Field(validation_alias=AliasChoices("cells", "files"))] = ()
    """Names of the files of its cells."""
    versions: Versions = field(default_factory=dict)  #: that it, or its record, was made with
    missing: tuple[str, ...] = ()  #: names of the missing cells
    failures: Mapping[str, str] = field(default_factory=dict)  #: why, by the name of the cell
    not_applicable: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """By learner and condition, why the learner could not play it."""
    excluded: Mapping[str, int] = field(default_factory=dict)
    """By the label of people, how many of them an analysis leaves out."""
    warned: tuple[str, ...] = ()  #: warnings while its cells were played


class Store:
    """A results folder, as :func:`~causal_openlock.running.runner.run` writes it.

    Example:
        >>> store = Store("results/first_look")
        >>> store.name is None  # nothing was played there
        True
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.cells = self.folder / "cells"
        self._declared = self.folder / "experiment.json"
        self._lock = ExitStack()

    def open(
        self, experiment: Experiment, *, changed: bool = True, shard: Shard | None = None
    ) -> None:
        """Lock the folder and prepare it for an experiment that is new or partly done.

        It may be a ``changed`` form of the one in the folder, with the same name, seed and version.
        With a shard, other processes may be at work in the folder.

        Raises:
            StoreError: If the folder holds something else, is in use, or cannot be written to.
        """
        self.close()
        folder_at(self.folder)
        self._check_inside([])
        files = [cell.file_name for cell in experiment.cells()]
        with ExitStack() as lock:
            try:
                to_declare = self._is_to_declare(experiment, files, changed)
                self.folder.mkdir(parents=True, exist_ok=True)
                lock.enter_context(locked(self.folder, shard=shard))
                if to_declare:
                    self.declare(experiment, files)
                self.cells.mkdir(exist_ok=True)
                if (errors := self.folder / ERRORS).exists():
                    errors.mkdir(exist_ok=True)  # which refuses a file
                if shard is None:  # others may be at work beside a shard
                    tidy(self.folder, {Path(name).stem for name in files})
            except OSError as error:
                raise unwritable(self.folder, error) from None
            self._lock = lock.pop_all()

    def close(self) -> None:
        """Release the lock on the folder."""
        self._lock.close()

    def _is_to_declare(self, experiment: Experiment, files: list[str], changed: bool) -> bool:
        """Whether ``experiment.json`` has to be written; refuses a folder of another experiment."""
        if is_empty(self.folder):
            return True
        done = {path.name for path in self.cells.glob("*.parquet")}
        try:
            stored = self.experiment()
        except StoreError:
            if not changed and (self.folder / LOG).exists():
                return False  # the log has the experiment
            # The names of cells end with their identities.
            if done.intersection(files) or (not done and self._declared.exists()):
                return True
            if not self.cells.exists():
                raise StoreError(
                    f"{self.folder} holds other files, and no results; choose another folder"
                ) from None
            raise
        if stored.identity == experiment.identity:
            return stored.not_applicable != experiment.not_applicable
        before = (stored.name, stored.seed, stored.version)
        # While no cell is done, another experiment overwrites no results.
        if not done or (changed and before == (experiment.name, experiment.seed, RESULTS_VERSION)):
            return True
        raise StoreError(
            f"{self.folder} holds another experiment ({stored.name}, seed {stored.seed}, made with "
            f"version {stored.version}); choose another folder"
        )

    def _check_inside(self, cells: Iterable[str]) -> None:
        """Refuse links and names of cells that lead out of a folder that others may have made."""
        links = [path for path in self.folder.rglob("*") if path.is_symlink()]
        paths = [self.cells / name for name in cells if Path(name).name != name]
        for path in [*links, *paths]:
            inside = False
            with suppress(OSError, RuntimeError, ValueError):  # links in a circle, a zero in a name
                inside = path.resolve().is_relative_to(self.folder.resolve())
            if not inside:
                raise StoreError(
                    f"{str(path)[:200]!r} leads out of {self.folder}; do not use this folder, or "
                    "put what a link points to in its place, if you know where it comes from"
                )

    def declare(
        self, experiment: Experiment, files: Iterable[str], identity: str | None = None
    ) -> None:
        """Write an experiment and the names of its cells' files to ``experiment.json``.

        The identity is the experiment's own by default.
        """
        data = {
            "identity": identity or experiment.identity,
            **experiment.as_dict(),
            "cells": [*files],
            "versions": versions(),
            "not_applicable": experiment.not_applicable or None,
        }
        write_bytes(self._declared, checksums.json_bytes(present(data)))

    @property
    def name(self) -> str | None:
        """The name of the folder's experiment, if it has one."""
        with suppress(OpenLockError):
            return self.experiment().name
        return None

    def experiment(self) -> StoredExperiment:
        """The folder's experiment, from ``experiment.json``.

        Raises:
            StoreError: If the folder holds no results, or the file is damaged or malformed.
        """
        try:
            experiment = parse_experiment(checksums.read_json(self._declared.read_bytes()))
        except OSError:
            raise StoreError(
                f"{self.folder} holds no results (there is no experiment.json); give the folder "
                "that compare wrote to; if it has cells, the same command writes it again"
            ) from None
        except (checksums.ChecksumError, StoreError) as error:
            raise _damaged(self._declared, error) from None
        self._check_inside(experiment.files)
        return experiment

    def require_versions(self) -> None:
        """Raise StoreError if all whole cells were made with other versions than those here."""
        made_with = []
        for path in self.cells.glob("*.parquet"):
            with suppress(StoreError):
                made_with.append(self._read(path, [])[1])
        if other := other_versions(merged_versions(made_with), versions()):
            raise StoreError(
                f"{self.folder} was made with {other}; install these versions, or give "
                "--allow-version to play missing cells with those here: numbers may differ"
            )

    def path(self, cell: Cell) -> Path:
        """The path of a cell's record."""
        return self.cells / cell.file_name

    def transcript(self, record: Path) -> Path:
        """The path of what was said in a cell, by that of its record."""
        return self.folder / "transcripts" / f"{record.stem}.jsonl"

    def digest(self) -> str:
        """A hash of the experiment and its cells; what is made of them carries it."""
        files = [self._declared, *self.files()[0]]
        return digest("".join(digest(path.read_bytes()) for path in files))

    def check(self, cell: Cell) -> str | None:
        """Fault of a cell's record: ``"missing"``, or what is damaged; else ``None``."""
        path = self.path(cell)
        if not path.exists():
            return "missing"
        try:
            begun = self.read(path)["attempt"].to_numpy() == 1
            if begun.sum() != cell.subjects * len(phases_of(cell.condition, cell.spec.protocol)):
                raise _damaged(path, "trials are missing")
        except StoreError as error:
            return str(error).rpartition("; ")[0]  # the remedy: its cell is run again anyway
        return None

    def read(self, path: Path, columns: Sequence[str] | None = None) -> pa.Table:
        """The record in a cell's file; of these columns, in its order, by default all.

        Raises:
            StoreError: If the file is missing, damaged, or belongs to another cell.
        """
        return self._read(path, columns)[0]

    def _read(
        self, path: Path, columns: Sequence[str] | None
    ) -> tuple[pa.Table, Versions, list[str]]:
        """A cell's record, the versions that made it, and warnings of how it came about."""
        try:
            table = checksums.read_table(path.read_bytes(), columns)
            metadata = table.schema.metadata or {}
            identity = metadata.get(IDENTITY, b"").decode(errors="replace")
            if not identity or not identity.startswith(path.stem.rpartition("_")[2]):
                raise checksums.ChecksumError("it holds another cell")
            fields = [
                field for field in record_schema() if columns is None or field.name in columns
            ]
            table = table.replace_schema_metadata(None).select([field.name for field in fields])
            table = table.cast(pa.schema(fields))  # other programs may encode names differently
            table.validate(full=True)
            if any(column.null_count for column in table.columns):
                raise checksums.ChecksumError("values are missing")
            made_with = adapter(Versions).validate_json(metadata.get(VERSIONS, b"{}"))
            warnings = adapter(list[str]).validate_json(metadata.get(WARNINGS, b"[]"))
        except FileNotFoundError:
            raise StoreError(f"{path} is missing; run compare again to make it") from None
        except (OSError, checksums.ChecksumError) as error:
            raise _damaged(path, error) from None
        except (pa.ArrowException, ValueError, KeyError):
            raise _damaged(path, "its columns or metadata are not those of a record") from None
        return table, made_with, warnings

    def write(self, cell: Cell, record: pa.Table, warnings: Sequence[str] = ()) -> None:
        """Save a cell's record, with warnings of how it came about, whole or not at all."""
        metadata = {IDENTITY: cell.identity.encode(), VERSIONS: json.dumps(versions()).encode()}
        if warnings:
            metadata[WARNINGS] = json.dumps(warnings).encode()
        write_bytes(self.path(cell), checksums.table_bytes(record, metadata))

    def write_transcripts(
        self, cell: Cell, transcripts: Sequence[Sequence[Mapping[str, Any]]]
    ) -> None:
        """Save what was said in a cell, by subject, each line with its number; nothing for none."""
        lines = [
            json.dumps({"subject": subject, **line}) + "\n"
            for subject, said in enumerate(transcripts, start=cell.first_subject)
            for line in said
        ]
        if lines:
            write_bytes(self.transcript(self.path(cell)), "".join(lines).encode())

    def record(self, columns: Sequence[str] | None = None) -> tuple[pa.Table, StoredExperiment]:
        """The records of all cells in order, as one, and :meth:`experiment` with their state.

        It has these columns, by default all.

        Raises:
            StoreError: If there is no cell, or one is damaged.
        """
        experiment = self.experiment()
        listed = {
            "learner": {spec.name for spec in experiment.learners},
            "condition": {condition.name for condition in experiment.conditions},
            "protocol": {spec.protocol.name for spec in experiment.learners},
        }
        done, missing = self.files()
        tables, made_with, warnings = [], [], {}
        for path in done:
            table, made_with_here, warnings_here = self._read(path, columns)
            made_with.append(made_with_here)
            warnings.update(dict.fromkeys(warnings_here))
            for column in listed.keys() & set(table.column_names):
                if strange := {*table[column].unique().to_pylist()} - listed[column]:
                    raise StoreError(
                        f"{self.folder} holds cells of the {column} {min(strange)!r}, which its "
                        "experiment.json does not list; give compare another --out"
                    )
            tables.append(table)
        reasons = {path.stem: failures_of(path)[1] or None for path in missing}
        return pa.concat_tables(tables), replace(
            experiment,
            versions=merged_versions(made_with),
            missing=(*reasons,),
            failures=present(reasons),
            warned=(*warnings, *filter(None, [self.unwritten()])),
        )

    def unwritten(self) -> str:
        """Say that people did more than the tables hold, and how to write it; else empty."""
        if not (count := unwritten_actions(self.folder / LOG)):
            return ""
        command = self.experiment().command or f"play --out {self.folder}"
        return (
            f"the log of {self.folder} has {counted(count, 'action')} of people that no table has "
            "yet: a server that runs writes them within seconds; where none runs any more, start "
            f"it and stop it: {command}"
        )

    def files(self) -> tuple[list[Path], list[Path]]:
        """The existing files of cells, in order, and the missing ones; StoreError for no cell."""
        paths = [self.cells / name for name in self.experiment().files]
        exists = {path: path.exists() for path in paths}
        if not any(exists.values()):
            of_people = (self.folder / LOG).exists()
            what = "nobody finished a trial, so play one" if of_people else "run compare to the end"
            why = self.unwritten() or f"{what} first"
            raise StoreError(f"{self.folder} holds no cell yet; {why}")
        return [p for p in paths if exists[p]], [p for p in paths if not exists[p]]


def _damaged(path: Path, why: object) -> StoreError:
    return StoreError(f"{path} is damaged ({why}); the command that made it makes it again")


def parse_experiment(data: Mapping[str, Any]) -> StoredExperiment:
    """The experiment in the content of ``experiment.json``; no code that it names is loaded."""
    try:
        stored: StoredExperiment = adapter(StoredExperiment).validate_json(
            json.dumps(data), context={"recorded": True}
        )
        return stored
    except ValidationError as error:
        fault = errors_of(error, StoredExperiment)[0]
        if not fault.at:
            raise StoreError("it is nested too deeply, or holds text that is not Unicode") from None
        raise StoreError(f"{'.'.join(map(str, fault.at))}: {fault}") from None
    except (LookupError, TypeError, AttributeError) as error:
        raise StoreError(f"it holds something else ({in_short(error)})") from None
