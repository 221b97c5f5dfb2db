"""A results folder: what was run, one Parquet file for each cell, and the report.

::

    DIR/
      experiment.json       everything that determines the results
      cells/                one file a cell; its name ends with the cell's identity
      report.html  summary.csv  figures/

A cell's file is complete or not there: it is written under another name, then renamed. So a
comparison killed at any moment goes on where it was. A file that does not read back as what was
written, for whatever reason, is told apart by its checksums and its cell is run again.
"""

from __future__ import annotations

import json
import os
import platform
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import StoreError
from causal_openlock.experiment import Cell, Experiment
from causal_openlock.yaml_file import write_text

if TYPE_CHECKING:
    import pyarrow as pa

IDENTITY = b"causal_openlock.cell"
OURS = ("experiment.json", "cells", "report.html", "summary.csv", "figures", "errors")


class Store:
    """A results folder.

    Args:
        folder: Where it is.
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self.cells = self.folder / "cells"

    def open(self, experiment: Experiment) -> None:
        """Make the folder ready for an experiment: a new one, or the same one half done.

        Raises:
            StoreError: If it holds something else, or cannot be written to.
        """
        declared = self.folder / "experiment.json"
        try:
            if self.folder.exists() and not self.folder.is_dir():
                raise StoreError(f"{self.folder} is a file; choose a folder for the results")
            if declared.exists():
                held = self.description()
                if held.get("identity") != experiment.identity:
                    raise StoreError(
                        f"{self.folder} holds another experiment ({held.get('name')}, seed "
                        f"{held.get('seed')}), or this one with other settings; choose another "
                        "folder or remove this one"
                    )
            elif self.folder.exists() and any(self.folder.iterdir()):
                raise StoreError(
                    f"{self.folder} is not empty and holds no results; choose another folder"
                )
            else:
                self.cells.mkdir(parents=True, exist_ok=True)
                held = {
                    "identity": experiment.identity,
                    **experiment.as_dict(),
                    "versions": _versions(),
                }
                text = json.dumps(held, indent=1)
                write_text(declared, text + "\n")
            self.cells.mkdir(exist_ok=True)
        except OSError as error:
            raise _unusable(self.folder, error) from None

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
        if not isinstance(held, dict):
            raise StoreError(
                f"{path} is damaged; restore it, or remove {self.folder} and compare again"
            )
        return held

    def path(self, cell: Cell) -> Path:
        """Where a cell's record belongs."""
        return self.cells / cell.file_name

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
            return str(error)
        return None

    @staticmethod
    def read(path: Path, identity: str | None = None) -> pa.Table:
        """A cell's record.

        Raises:
            StoreError: If the file is damaged or belongs to another cell.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        from causal_openlock.record import record_schema

        try:
            table = pq.read_table(path, page_checksum_verification=True, memory_map=False)
        except (OSError, pa.ArrowException, ValueError) as error:
            said = " ".join(str(error).split())[:120]
            raise StoreError(f"{path} is damaged ({said})") from None
        metadata = table.schema.metadata or {}
        held = metadata.get(IDENTITY, b"").decode(errors="replace")
        if identity is not None and held != identity:
            raise StoreError(f"{path} is damaged (it holds another cell)")
        if table.schema.names != record_schema().names:
            raise StoreError(f"{path} is damaged (its columns are not those of a record)")
        return table

    def write(self, cell: Cell, record: pa.Table) -> None:
        """Keep a cell's record.

        Raises:
            StoreError: If it cannot be written; nothing is left of it then.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        metadata = {**(record.schema.metadata or {}), IDENTITY: cell.identity.encode()}
        path, temporary = self.path(cell), ""
        try:
            self.cells.mkdir(parents=True, exist_ok=True)
            handle, temporary = tempfile.mkstemp(dir=self.cells, prefix=".", suffix=".partial")
            with os.fdopen(handle, "wb") as file:
                pq.write_table(
                    record.replace_schema_metadata(metadata),
                    file,
                    compression="zstd",
                    write_page_checksum=True,
                )
                file.flush()
                os.fsync(file.fileno())
            Path(temporary).replace(path)
        except (OSError, pa.ArrowException) as error:
            if temporary:
                Path(temporary).unlink(missing_ok=True)
            raise _unusable(path, error) from None

    def sweep(self) -> None:
        """Remove what killed runs have left half written."""
        for partial in self.cells.glob(".*.partial"):
            partial.unlink(missing_ok=True)

    def record(self, experiment: Experiment | None = None) -> pa.Table:
        """The records of all cells as one, in the order of the cells.

        Args:
            experiment: Whose cells; by default every cell that the folder holds.

        Raises:
            StoreError: If there is none, or one is missing or damaged.
        """
        import pyarrow as pa

        if experiment is not None:
            paths = [self.path(cell) for cell in experiment.cells()]
        else:
            paths = sorted(self.cells.glob("*.parquet"))
        if not paths:
            raise StoreError(f"{self.folder} holds no cell yet; run compare to the end first")
        tables = [self.read(path) for path in paths]
        return pa.concat_tables([table.replace_schema_metadata(None) for table in tables])


def _versions() -> dict[str, str]:
    """What the results are made with."""
    versions = {"Python": platform.python_version()}
    for package in ("causal-openlock", "numpy", "torch", "networkx", "gymnasium"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return versions


def _unusable(path: Path, error: Exception) -> StoreError:
    said = getattr(error, "strerror", None) or " ".join(str(error).split())[:120]
    return StoreError(
        f"{path} cannot be written ({said}); free some space or choose another folder, then run "
        "the same command again: it goes on where it was"
    )
