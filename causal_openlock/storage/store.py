"""A results folder: the experiment, one Parquet file for each cell, and the report.

::

    DIR/
      experiment.json       everything that determines the results, and the names of cells' files
      cells/                one file a cell; its name ends with the cell's identity. While the cell
                            is played, also its checkpoint and its progress
      transcripts/          what was said in a cell, of learners that speak: a line of JSON each
      code/                 source of learners that a notebook or a script defined
      report.html  summary.csv
      errors/               a file for each failed cell: a sentence and the traceback

A cell's file is written completely or not at all, so a comparison killed at any moment continues
where it was. A folder keeps every cell that was ever played in it, by identity, and shows those of
the last experiment: a learner can be corrected, removed, put back or added.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.declare import Cell, Experiment
from causal_openlock.files.atomic import folder_at, is_empty, unwritable, write_bytes
from causal_openlock.files.checksums import ChecksumError, json_bytes, read_json
from causal_openlock.files.json_text import present
from causal_openlock.storage.cell_file import read_cell_file, warnings_in, write_cell_file
from causal_openlock.storage.failures import Failures
from causal_openlock.storage.folder_lock import FolderLock
from causal_openlock.storage.running_files import tidy
from causal_openlock.storage.versions import Versions, merged_versions, other_versions, versions
from causal_openlock.version import RESULTS_VERSION

if TYPE_CHECKING:
    import pyarrow as pa

    from causal_openlock.storage.shard import Shard
    from causal_openlock.storage.stored import StoredExperiment

TRANSCRIPTS = "transcripts"
LOG = "log.jsonl"
"""The actions of people, in a folder of ``play``; see :mod:`causal_openlock.play.log`."""


class Store:
    """A results folder, as :func:`~causal_openlock.running.runner.run` writes it.

    Args:
        folder: Its path.

    Example:
        >>> store = Store("results/first_look")
        >>> store.name is None  # nothing was played there
        True
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.cells = self.folder / "cells"
        self._declared = self.folder / "experiment.json"
        self.failures = Failures(self.folder / "errors")
        self._lock = FolderLock(self.folder)

    # -- the folder -----------------------------------------------------------------------------

    def open(
        self, experiment: Experiment, *, changed: bool = True, shard: Shard | None = None
    ) -> None:
        """Prepare the folder for an experiment that is new or partly done.

        Args:
            experiment: The experiment.
            changed: Whether it may be a changed form of the one in the folder, with the same name,
                seed and version.
            shard: What is to be played, if it is not the whole experiment; other shards may be
                played in the folder at the same time.

        Raises:
            StoreError: If the folder holds something else, is in use, or cannot be written to.
        """
        self.close()
        folder_at(self.folder)
        self._check_inside([])
        try:
            files = [cell.file_name for cell in experiment.cells()]
            to_declare = self._is_to_declare(experiment, files, changed)
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock.take(shard)
            if to_declare:
                self.declare(experiment, files)
            self.cells.mkdir(exist_ok=True)
            if shard is None:  # others may be at work beside a shard
                tidy(self.folder, {Path(name).stem for name in files})
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise unwritable(self.folder, error) from None
            raise

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
            begun = {f"{path.stem}.parquet" for path in self.cells.glob("*")}  # and not done
            # The names of cells end with their identities.
            if not begun.isdisjoint(files) or (not done and self._declared.exists()):
                return True
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

    def _check_inside(self, cells: Sequence[str]) -> None:
        """Refuse links and paths that lead out of the folder, which others may have made."""
        links = [path for path in self.folder.rglob("*") if path.is_symlink()]
        paths = [self.cells / name for name in cells if Path(name).name != name]
        for path in [*links, *paths]:
            try:
                inside = path.resolve().is_relative_to(self.folder.resolve())
            except (OSError, RuntimeError, ValueError):  # links in a circle, a zero in a name
                inside = False
            if not inside:
                raise StoreError(
                    f"{str(path)[:200]!r} leads out of {self.folder}; do not use this folder, or "
                    "put what a link points to in its place, if you know where it comes from"
                )

    @property
    def name(self) -> str | None:
        """The name of the folder's experiment, if it has one."""
        with suppress(OpenLockError):
            return self.experiment().name
        return None

    def declare(
        self, experiment: Experiment, files: Iterable[str], identity: str | None = None
    ) -> None:
        """Write the experiment and the names of its cells' files to ``experiment.json``.

        Args:
            experiment: The experiment.
            files: The names.
            identity: By default the experiment's own.

        Raises:
            OpenLockError: If it cannot be written.
        """
        data = {
            "identity": identity or experiment.identity,
            **experiment.as_dict(),
            "cells": [*files],
            "versions": versions(),
            "not_applicable": experiment.not_applicable or None,
        }
        write_bytes(self._declared, json_bytes(present(data)))

    def require_versions(self) -> None:
        """Make sure that the folder's cells were made with the versions of packages here.

        Raises:
            StoreError: If all of them were made with others.
        """
        made_with = []
        for path in self.cells.glob("*.parquet"):
            with suppress(OSError, ChecksumError):
                made_with.append(read_cell_file(path, columns=[])[1])
        if other := other_versions(merged_versions(made_with), versions()):
            raise StoreError(
                f"{self.folder} was made with {other}; install these versions, or give "
                "--allow-version to play missing cells with those here: numbers may differ"
            )

    def close(self) -> None:
        """Release the locks on the folder."""
        self._lock.release()

    def experiment(self) -> StoredExperiment:
        """The folder's experiment, from ``experiment.json``.

        Raises:
            StoreError: If the folder holds no results, or the file is damaged or malformed.
        """
        from causal_openlock.storage.stored import parse_experiment

        try:
            experiment = parse_experiment(read_json(self._declared.read_bytes()))
        except OSError:
            remedy = "give the folder that compare wrote to, or a new one to compare"
            if any(self.cells.glob("*.parquet")):
                remedy = "its cells are there: the command that made them writes it again"
            raise StoreError(
                f"{self.folder} holds no results (there is no experiment.json); {remedy}"
            ) from None
        except (ChecksumError, StoreError) as error:
            raise self._damaged(self._declared, error) from None
        self._check_inside(experiment.files)
        return experiment

    # -- its cells ------------------------------------------------------------------------------

    def path(self, cell: Cell) -> Path:
        """The path of a cell's record."""
        return self.cells / cell.file_name

    def source(self, package: str) -> Path:
        """Path of the source of a learner that has no file, stored for people: nothing runs it.

        Args:
            package: Its origin, such as ``Mine.py 0123456789abcdef``.
        """
        name = re.sub(r"\W", "_", package.replace(".py ", "_"))
        return self.folder / "code" / f"{name[-200:]}.py"

    def check(self, cell: Cell) -> str | None:
        """Fault of a cell's record: ``"missing"``, or what is damaged; else ``None``."""
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
        """The record in a cell's file, whole and of that cell.

        The arguments are those of :func:`~causal_openlock.storage.cell_file.read_cell_file`.

        Raises:
            StoreError: If the file is missing, damaged, or belongs to another cell.
        """
        return self._read(path, identity, columns)[0]

    def _read(self, path: Path, *which: Any) -> tuple[pa.Table, Versions]:
        try:
            return read_cell_file(path, *which)
        except FileNotFoundError:
            raise StoreError(f"{path} is missing; run compare again to make it") from None
        except (OSError, ChecksumError) as error:
            raise self._damaged(path, error) from None

    def write(self, cell: Cell, record: pa.Table, warnings: Sequence[str] = ()) -> None:
        """Save a cell's record, with warnings of how it came about.

        Raises:
            StoreError: If it cannot be written; no part of it is left then.
        """
        try:
            write_cell_file(self.path(cell), cell, record, warnings)
        except OpenLockError as error:
            raise StoreError(
                f"{error}, then run the same command again: it continues where it stopped"
            ) from None

    def write_transcripts(
        self, cell: Cell, transcripts: Sequence[Sequence[Mapping[str, Any]]]
    ) -> None:
        """Save what was said in a cell, by subject, each line with its number; nothing for none.

        Raises:
            OpenLockError: If it cannot be written.
        """
        lines = [
            json.dumps({"subject": subject, **line}) + "\n"
            for subject, said in enumerate(transcripts, start=cell.first_subject)
            for line in said
        ]
        if lines:
            write_bytes(self.transcript(self.path(cell)), "".join(lines).encode())

    def transcript(self, record: Path) -> Path:
        """Path of the transcripts of a cell, by the path of its record."""
        return self.folder / TRANSCRIPTS / f"{record.stem}.jsonl"

    def record(
        self, columns: Sequence[str] | None = None, *, small: bool = False
    ) -> tuple[pa.Table, StoredExperiment]:
        """The records of all cells in order, as one, and :meth:`experiment`.

        The latter includes the versions of the packages that the cells were made with, the missing
        cells, and why some of them failed.

        Args:
            columns: The columns to read, in the order of a record; by default all.
            small: Whether to make it :func:`~causal_openlock.experiment.record.compact`.

        Raises:
            StoreError: If there is no cell, or one is damaged.
        """
        import pyarrow as pa

        from causal_openlock.experiment.record import compact

        experiment = self.experiment()
        done, missing = self.files(experiment)
        listed = {
            "learner": {spec.name for spec in experiment.learners},
            "condition": {condition.name for condition in experiment.conditions},
            "protocol": {spec.protocol.name for spec in experiment.learners},
        }
        tables, made_with = [], []
        for path in done:
            table, versions = self._read(path, None, columns)
            for column in listed.keys() & set(table.column_names):
                names = {*table[column].unique().to_pylist()}
                if strange := sorted(names - listed[column]):
                    raise StoreError(
                        f"{self.folder} holds cells of the {column} {strange[0]!r}, which its "
                        "experiment.json does not list; give compare another --out"
                    )
            made_with.append(versions)
            tables.append(compact(table) if small else table)
        reasons = {path.stem: self.failures.of(path.name)[1] or None for path in missing}
        return pa.concat_tables(tables), replace(
            experiment,
            versions=merged_versions(made_with),
            missing=(*reasons,),
            failures=present(reasons),
            warned=tuple(dict.fromkeys(one for path in done for one in warnings_in(path))),
        )

    def files(self, experiment: StoredExperiment | None = None) -> tuple[list[Path], list[Path]]:
        """The existing files of cells, in order, and the missing ones.

        Args:
            experiment: The folder's experiment, if it has been read.

        Raises:
            StoreError: If the folder holds no results, or no cell.
        """
        paths = [self.cells / name for name in (experiment or self.experiment()).files]
        exists = {path: path.exists() for path in paths}
        done = [path for path in paths if exists[path]]
        if not done:
            raise StoreError(f"{self.folder} holds no cell yet; run compare to the end first")
        return done, [path for path in paths if not exists[path]]

    def _damaged(self, path: Path, error: Exception) -> StoreError:
        if (self.folder / LOG).exists():
            remedy = "start play with this folder and stop it: it is made again from the log"
        else:
            remedy = "run compare again, with the same command, to make it again"
        return StoreError(f"{path} is damaged ({error}); {remedy}")
