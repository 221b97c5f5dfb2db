"""A results folder: what was run, one Parquet file for each cell, and the report.

::

    DIR/
      experiment.json       everything that determines the results, and the files they are in
      cells/                one file a cell; its name ends with the cell's identity. Beside it, as
                            long as the cell is played: its checkpoint, and how far it is
      report.html  summary.csv  figures/
      errors/               tracebacks of learners that failed

A cell's file is complete or not there, so a comparison killed at any moment goes on where it was.
A file that does not read back as what was written, for whatever reason, is told by its checksums,
and its cell is run again. One process at a time works in a folder: it holds a lock on it, which the
system takes back when the process ends, however it ends.
"""

from __future__ import annotations

import json
import platform
import re
import textwrap
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from causal_openlock import __version__
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment import Cell, Experiment
from causal_openlock.files import PARTIAL, replacing, sweep, write_text

if TYPE_CHECKING:
    import pyarrow as pa

IDENTITY = b"causal_openlock.cell"
VERSIONS = b"causal_openlock.versions"
LOCK = ".lock"
CHECKPOINT, ATTEMPTS, PROGRESS = ".checkpoint", ".attempts", ".progress"
"""What stands beside a cell's file while it is played; see :mod:`causal_openlock.checkpoint`."""
REMEDY = "; remove it and run compare again"


class Store:
    """A results folder.

    Args:
        folder: Where it is.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.cells = self.folder / "cells"
        self._lock: IO[bytes] | None = None

    # -- the folder -----------------------------------------------------------------------------

    def open(self, experiment: Experiment) -> None:
        """Make the folder ready for an experiment: a new one, or the same one half done.

        Raises:
            StoreError: If it holds something else, is in use, or cannot be written to.
        """
        try:
            self._prepare(experiment)
        except BaseException as error:
            self.close()
            if isinstance(error, OSError):
                raise _unusable(self.folder, error.strerror) from None
            if isinstance(error, OpenLockError) and not isinstance(error, StoreError):
                raise StoreError(str(error)) from None
            raise

    def _prepare(self, experiment: Experiment) -> None:
        declared = self.folder / "experiment.json"
        if self.folder.exists() and not self.folder.is_dir():
            raise StoreError(f"{self.folder} is a file; choose a folder for the results")
        if not declared.exists() and self._holds_something():
            raise StoreError(
                f"{self.folder} is not empty and holds no results; choose another folder"
            )
        self.folder.mkdir(parents=True, exist_ok=True)
        self._take_lock()
        # Where nothing is done yet, nothing is lost by another experiment.
        if declared.exists() and any(self.cells.glob("*.parquet")):
            self._check_same(experiment)
        else:
            held = {
                "identity": experiment.identity,
                **experiment.as_dict(),
                "cells": [cell.file_name for cell in experiment.cells()],
            }
            write_text(declared, json.dumps(held, indent=1) + "\n")
        self.cells.mkdir(exist_ok=True)
        sweep(self.folder)
        sweep(self.cells)
        known = {self.path(cell).with_suffix("") for cell in experiment.cells()}
        for path in self.cells.iterdir():
            foreign = path.suffix in (CHECKPOINT, ATTEMPTS) and path.with_suffix("") not in known
            if foreign or path.suffix == PROGRESS:
                path.unlink(missing_ok=True)

    def close(self) -> None:
        """Let others work in the folder."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _holds_something(self) -> bool:
        """Whether there is more in the folder than what a start cut short can have left."""
        if not self.folder.exists():
            return False
        return any(path.name != LOCK and not path.match(PARTIAL) for path in self.folder.iterdir())

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

    def _check_same(self, experiment: Experiment) -> None:
        held = self.description()
        if held["identity"] != experiment.identity:
            made = f", made with version {held['version']}" * (held["version"] != __version__)
            raise StoreError(
                f"{self.folder} holds another experiment ({held['name']}, seed {held['seed']}"
                f"{made}), or this one with other settings, schemas or learners; choose another "
                "folder or remove this one"
            )

    def description(self) -> dict[str, Any]:
        """The content of ``experiment.json``.

        Raises:
            StoreError: If the folder holds no results.
        """
        path = self.folder / "experiment.json"
        try:
            held = json.loads(path.read_text(encoding="utf-8"))
        except OSError:
            raise StoreError(
                f"{self.folder} holds no results (there is no experiment.json); give the folder "
                "that compare wrote to"
            ) from None
        except ValueError:
            held = None
        needed = {"identity", "version", "name", "seed", "learners", "conditions", "cells"}
        if not isinstance(held, dict) or not needed <= held.keys():
            raise StoreError(
                f"{path} is damaged; restore it, or remove {self.folder} and compare again"
            )
        return held

    # -- its cells ------------------------------------------------------------------------------

    def path(self, cell: Cell) -> Path:
        """Where a cell's record belongs."""
        return self.cells / cell.file_name

    def clear(self, cell: Cell) -> None:
        """Remove what stood beside a cell's record while it was played."""
        for suffix in (CHECKPOINT, ATTEMPTS, PROGRESS):
            self.path(cell).with_suffix(suffix).unlink(missing_ok=True)

    def progress(self) -> float:
        """How many cells' worth is done of the cells that are being played."""
        done = 0.0
        for path in self.cells.glob(f"*{PROGRESS}"):
            with suppress(OSError, ValueError):  # just written, or just removed
                done += float(path.read_text(encoding="utf-8"))
        return done

    def check(self, cell: Cell) -> str | None:
        """Whether a cell's record is there and whole.

        Returns:
            ``None`` if it is; otherwise why not: ``"missing"``, or what is damaged.
        """
        path = self.path(cell)
        if not path.exists():
            return "missing"
        try:
            self.read(path, cell.identity)
        except StoreError as error:
            return str(error).removesuffix(REMEDY)  # its cell is run again anyway
        return None

    @staticmethod
    def read(path: Path, identity: str | None = None) -> pa.Table:
        """A cell's record.

        Raises:
            StoreError: If the file is missing, damaged, or belongs to another cell.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        from causal_openlock.record import record_schema

        try:
            table = pq.read_table(path, page_checksum_verification=True, memory_map=False)
        except FileNotFoundError:
            raise StoreError(f"{path} is missing; run compare again to make it") from None
        except (OSError, pa.ArrowException, ValueError) as error:
            raise _damaged(path, _said(error)) from None
        held = (table.schema.metadata or {}).get(IDENTITY, b"").decode(errors="replace")
        if identity is not None and held != identity:
            raise _damaged(path, "it holds another cell")
        if table.schema.names != record_schema().names:
            raise _damaged(path, "its columns are not those of a record")
        return table

    def write(self, cell: Cell, record: pa.Table) -> None:
        """Keep a cell's record.

        Raises:
            StoreError: If it cannot be written; nothing is left of it then.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        metadata = {
            IDENTITY: cell.identity.encode(),
            VERSIONS: json.dumps(versions()).encode(),
        }
        path = self.path(cell)
        try:
            with replacing(path) as file:
                pq.write_table(
                    record.replace_schema_metadata(metadata),
                    file,
                    compression="zstd",
                    write_page_checksum=True,
                )
        except (OpenLockError, pa.ArrowException) as error:
            raise _unusable(path, " ".join(str(error.__cause__ or error).split())) from None

    def record(self) -> tuple[pa.Table, dict[str, Any]]:
        """The records of all cells as one, and what they are the record of.

        Returns:
            The record, in the order of the cells; and :meth:`description` without the list of
            files, but with ``versions`` of the packages that the cells were made with (a list
            where they differ) and, if some cells are not there yet, ``missing_cells``.

        Raises:
            StoreError: If there is no cell, or one is damaged.
        """
        import pyarrow as pa

        description = self.description()
        del description["identity"]
        paths = [self.cells / name for name in description.pop("cells")]
        there = [path for path in paths if path.exists()]
        if not there:
            raise StoreError(f"{self.folder} holds no cell yet; run compare to the end first")
        tables = [self.read(path) for path in there]
        missing = [path.stem for path in paths if path not in set(there)]
        if missing:
            description["missing_cells"] = missing
        description["versions"] = _merged([table.schema.metadata or {} for table in tables])
        record = pa.concat_tables([table.replace_schema_metadata(None) for table in tables])
        return record, description


def versions() -> dict[str, str]:
    """What a cell is made with: versions by the name of the package."""
    found = {"Python": platform.python_version()}
    for package in ("causal-openlock", "numpy", "torch", "networkx"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def _merged(metadata: list[dict[bytes, bytes]]) -> dict[str, str | list[str]]:
    """The versions of all cells: a text where they agree, a list where they do not."""
    found: dict[str, dict[str, None]] = {}
    for one in metadata:
        for package, number in json.loads(one.get(VERSIONS, b"{}")).items():
            found.setdefault(package, {})[number] = None
    return {
        package: next(iter(numbers)) if len(numbers) == 1 else list(numbers)
        for package, numbers in found.items()
    }


def _damaged(path: Path, what: str) -> StoreError:
    return StoreError(f"{path} is damaged ({what}){REMEDY}")


def _said(error: Exception) -> str:
    """What is wrong with a file, in a line, without what was called and with whole words."""
    line = re.sub(
        r"^Could not open Parquet input source '[^']*': ", "", " ".join(str(error).split())
    )
    return textwrap.shorten(line, 200, placeholder=" …").rstrip(".") or type(error).__name__


def _unusable(path: Path, said: str | None) -> StoreError:
    return StoreError(
        f"{path} cannot be written ({said or 'the system does not say why'}); free some space or "
        "choose another folder, then run the same command again: it goes on where it was"
    )
