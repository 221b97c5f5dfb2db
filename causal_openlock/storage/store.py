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
where it was. Cells and ``experiment.json`` have checksums (:mod:`causal_openlock.files.checksums`):
a damaged file is reported, and its cell is played again.

A folder keeps every cell that was ever played in it, by identity, and shows those of the last
experiment. So a learner can be corrected, removed, put back or added, and only missing cells are
played. One process at a time works in a folder (:mod:`causal_openlock.storage.folder_lock`).
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import OpenLockError, StoreError, in_short
from causal_openlock.experiment.experiment import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.protocol import Condition
from causal_openlock.files.atomic import PARTIAL, folder_at, sweep, write_bytes
from causal_openlock.files.checksums import ChecksumError, json_bytes, read_json
from causal_openlock.files.escaping import require_utf8
from causal_openlock.storage.cell_file import read_cell_file, versions_of, write_cell_file
from causal_openlock.storage.containment import check_inside
from causal_openlock.storage.failures import Failures
from causal_openlock.storage.folder_lock import LOCK, FolderLock
from causal_openlock.storage.running_files import remove_leftovers
from causal_openlock.storage.versions import merged_versions, other_versions, versions
from causal_openlock.version import RESULTS_VERSION

if TYPE_CHECKING:
    import pyarrow as pa

    from causal_openlock.storage.shard import Shard
    from causal_openlock.storage.stored import StoredExperiment, Versions

TRANSCRIPTS = "transcripts"
LOG = "log.jsonl"
"""The actions of people, in a folder of ``play``; see :mod:`causal_openlock.play.log`."""
_SOURCE = re.compile(r"[\w.]{1,200}\.py [0-9a-f]{16}")


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
            changed: Whether it may be a changed form of the one in the folder: they share a cell,
                or name, seed, version, and a learner with the same parameters in the same
                condition.
            shard: What is to be played, if it is not the whole experiment; other shards may be
                played in the folder at the same time.

        Raises:
            StoreError: If the folder holds something else, is in use, or cannot be written to.
        """
        try:
            self._prepare(experiment, changed, shard)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise _unusable(self.folder, error.strerror) from None
            if isinstance(error, OpenLockError) and not isinstance(error, StoreError):
                raise StoreError(str(error)) from None
            raise

    def _prepare(self, experiment: Experiment, changed: bool, shard: Shard | None) -> None:
        require_utf8(str(self.folder))
        check_inside(folder_at(self.folder))
        there = self.folder.iterdir() if self.folder.exists() else ()
        # An interrupted start leaves a lock and temporary files.
        foreign = any(not path.match(f"{LOCK}*") and not path.match(PARTIAL) for path in there)
        if foreign and not self._declared.exists():
            raise StoreError(
                f"{self.folder} is not empty and holds no results; choose another folder"
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        self.close()
        alone = self._lock.take(shard)
        if not alone and self._declared.exists():  # another shard has prepared it
            if self.experiment().identity != experiment.identity:
                raise StoreError(
                    f"{self.folder} is in use by shards of another form of this comparison; wait "
                    "for them, or choose another folder"
                )
            return
        files = {cell.file_name for cell in experiment.cells()}
        if self._is_of(experiment, files, changed):
            self.declare(experiment, experiment.cells())
        self.cells.mkdir(exist_ok=True)
        if alone:
            self._tidy({Path(name).stem for name in files})
            self._lock.share(shard)

    def _tidy(self, known: set[str]) -> None:
        """Remove what killed runs and earlier forms of the experiment have left."""
        sweep(self.folder)
        sweep(self.cells)
        remove_leftovers(self.folder, self.cells, known)
        self.failures.tidy(known)

    def _is_of(self, experiment: Experiment, files: set[str], changed: bool) -> bool:
        """Whether ``experiment.json`` has to be written; refuses a folder of another experiment."""
        done = {path.name for path in self.cells.glob("*.parquet")}
        if not self._declared.exists():
            return True
        try:
            held = self.experiment()
        except StoreError:
            if not changed and (self.folder / LOG).exists():
                return False  # the log has the experiment
            # The names of cells end with their identities.
            if not done or done & files:
                return True
            raise
        if held.identity == experiment.identity:
            return held.not_applicable != experiment.not_applicable
        # While no cell is done, another experiment overwrites no results.
        if not done or (changed and (done & files or _is_variant(held, experiment))):
            return True
        other = held.version != RESULTS_VERSION
        made = f", made with version {held.version}" if other else ""
        raise StoreError(
            f"{self.folder} holds another experiment ({held.name}, seed {held.seed}{made}), "
            "or this one with other settings, schemas or learners, and no cell of the new one; "
            "choose another folder"
        )

    @property
    def name(self) -> str | None:
        """The name of the folder's experiment, if it has one."""
        try:
            return self.experiment().name
        except OpenLockError:
            return None

    def declare(
        self,
        experiment: Experiment,
        cells: Iterable[Cell],
        identity: str | None = None,
        made_with: Versions | None = None,
    ) -> None:
        """Write the experiment and these cells to ``experiment.json`` unless they are in it.

        Args:
            experiment: The experiment.
            cells: The cells.
            identity: By default the experiment's own.
            made_with: Versions of packages; by default those that the folder was made with so far,
                or those here.

        Raises:
            OpenLockError: If it cannot be written.
        """
        self.list_files(experiment, [cell.file_name for cell in cells], identity, made_with)

    def list_files(
        self,
        experiment: Experiment,
        files: Sequence[str],
        identity: str | None = None,
        made_with: Versions | None = None,
    ) -> None:
        """Write the experiment and the names of its cells' files; as :meth:`declare`."""
        held = {
            "identity": identity or experiment.identity,
            **experiment.as_dict(),
            "cells": [*files],
            "versions": dict(made_with or self.made_with()),
        }
        if experiment.not_applicable:
            held["not_applicable"] = experiment.not_applicable
        content = json_bytes(held)
        with suppress(OSError):
            if self._declared.read_bytes() == content:
                return
        write_bytes(self._declared, content)

    def begin(self, experiment: Experiment, *, allow_version: bool) -> None:
        """Note that cells are about to be played with the versions of packages here.

        Raises:
            StoreError: If the folder was made with others and that is not allowed.
        """
        made_with = self.made_with()
        if not (other := other_versions(made_with, versions())):
            return
        if not allow_version:
            raise StoreError(
                f"{self.folder} was made with {other}; install these versions, or give "
                "--allow-version to play missing cells with those here: numbers may differ"
            )
        both = merged_versions([made_with, versions()])
        self.declare(experiment, experiment.cells(), made_with=both)

    def made_with(self) -> Versions:
        """The versions that the folder was made with: its description says so, or its cells do.

        By default those here.
        """
        with suppress(StoreError):
            if said := self.experiment().versions:
                return said
        found = []
        for path in self.cells.glob("*.parquet"):
            with suppress(StoreError):
                found.append(versions_of(self.read(path, columns=["subject"]), path))
        return merged_versions(found) or versions()

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
        """The path of a cell's record."""
        return self.cells / cell.file_name

    def source(self, package: str) -> Path:
        """Path of the source of a learner that has no file, stored for people: nothing runs it.

        Args:
            package: Its origin, such as ``Mine.py 0123456789abcdef``.

        Raises:
            StoreError: If it is something else.
        """
        if not _SOURCE.fullmatch(package):
            raise StoreError(f"{package[:80]!r} is not the origin of a learner's source")
        name, _, digest = package.partition(".py ")
        return self.folder / "code" / f"{name.replace('.', '_')}_{digest}.py"

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
        try:
            return read_cell_file(path, identity, columns)
        except FileNotFoundError:
            raise StoreError(f"{path} is missing; run compare again to make it") from None
        except (OSError, ChecksumError) as error:
            raise self._damaged(path, str(error)) from None

    def write(self, cell: Cell, record: pa.Table) -> None:
        """Save a cell's record.

        Raises:
            StoreError: If it cannot be written; no part of it is left then.
        """
        path = self.path(cell)
        try:
            write_cell_file(path, cell, record)
        except OpenLockError as error:
            raise _unusable(path, in_short(error.__cause__ or error)) from None

    def write_transcripts(
        self, cell: Cell, transcripts: Sequence[Sequence[Mapping[str, Any]]]
    ) -> None:
        """Save what was said in a cell, by subject, each line with its number; nothing for none.

        Raises:
            OpenLockError: If it cannot be written.
        """
        lines = [
            json.dumps({"subject": subject, **line})
            for subject, said in enumerate(transcripts, start=cell.first_subject)
            for line in said
        ]
        if lines:
            write_bytes(self.transcript(self.path(cell)), "\n".join([*lines, ""]).encode())

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
        listed = {
            "learner": {spec.name for spec in experiment.learners},
            "condition": {condition.name for condition in experiment.conditions},
            "protocol": {spec.protocol.name for spec in experiment.learners},
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
            made_with.append(versions_of(table, path))
            table = table.replace_schema_metadata(None)
            tables.append(compact(table) if small else table)
        reasons = {path.stem: self.failures.of(path.name)[1] for path in absent}
        return pa.concat_tables(tables), replace(
            experiment,
            versions=merged_versions(made_with),
            missing=tuple(path.stem for path in absent),
            failures={stem: reason for stem, reason in reasons.items() if reason},
        )

    def files(self) -> tuple[list[Path], list[Path]]:
        """The existing files of cells, in order, and the missing ones.

        Raises:
            StoreError: If the folder holds no results, or no cell.
        """
        return self._split(self.experiment())

    def _split(self, experiment: StoredExperiment) -> tuple[list[Path], list[Path]]:
        paths = [self.cells / name for name in experiment.files]
        there = [path for path in paths if path.exists()]
        if not there:
            raise StoreError(f"{self.folder} holds no cell yet; run compare to the end first")
        return there, [path for path in paths if path not in there]

    def _damaged(self, path: Path, what: str) -> StoreError:
        if (self.folder / LOG).exists():
            remedy = "start play with this folder and stop it: it is made again from the log"
        else:
            remedy = "run compare again, with the same command, to make it again"
        return StoreError(f"{path} is damaged ({what}); {remedy}")


def _is_variant(held: Experiment, experiment: Experiment) -> bool:
    """Whether an experiment is a changed form of a folder's experiment.

    Code is left out, so that a corrected learner or reward replaces the old one.
    """

    def settings(parts: Iterable[LearnerSpec | Condition]) -> set[str]:
        code = {"class", "package", "material", "subjects", "prior_attempts", "informed", "about"}
        data = [{k: v for k, v in part.as_dict().items() if k not in code} for part in parts]
        for one in data:
            one.get("reward", {}).pop("source", None)
        return {json.dumps(one, sort_keys=True) for one in data}

    return (
        (held.name, held.seed, held.version) == (experiment.name, experiment.seed, RESULTS_VERSION)
        and not settings(held.learners).isdisjoint(settings(experiment.learners))
        and not settings(held.conditions).isdisjoint(settings(experiment.conditions))
    )


def _unusable(path: Path, why: str | None) -> StoreError:
    return StoreError(
        f"{path} cannot be written ({why or 'the system does not say why'}); free some space or "
        "choose another folder, then run the same command again: it continues where it stopped"
    )
