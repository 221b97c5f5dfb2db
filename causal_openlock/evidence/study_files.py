"""Stored files of a study's run, in its folder, each whole or not there at all.

``run.json`` holds the hash of ``units.parquet`` (and of ``costs.parquet``), so that neither can be
of another run.
"""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.study import Study
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import (
    ChecksumError,
    json_bytes,
    read_json,
    read_table,
    table_bytes,
)
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import joined

if TYPE_CHECKING:
    import pandas as pd

UNITS, COSTS, RUN = "units.parquet", "costs.parquet", "run.json"


def older_results(run: dict[str, Any]) -> str:
    """Return the release whose results a study has, if results are others now; else nothing.

    >>> older_results({"versions": {"causal-openlock": "0.1.0+4"}})
    '0.1'
    """
    stamps, version = run.get("stamps"), run["versions"]["causal-openlock"]
    played_with = {version} if isinstance(version, str) else {*version}
    if played_with == {RESULTS_VERSION} or (stamps and stamps[-1]["results"] == RESULTS_VERSION):
        return ""
    releases = {".".join(one.split(".")[:2]) for one in played_with - {RESULTS_VERSION}}
    return joined(sorted(releases))


def write_run(study: Study, tables: dict[str, pd.DataFrame], run: dict[str, Any]) -> None:
    """Write the measurements, and then the facts about the run."""
    import pyarrow as pa

    hashes = {}
    for name, table in tables.items():
        content = table_bytes(pa.Table.from_pandas(table, preserve_index=False))
        hashes[name] = hashlib.sha256(content).hexdigest()
        write_bytes(study.folder / name, content)
    write_bytes(study.folder / RUN, json_bytes({**run, "files": hashes}))


def read_run(study: Study) -> dict[str, Any]:
    """Facts about the run: the content of ``run.json``.

    Raises:
        EvidenceError: If it has not been run, or the file is damaged.
    """
    run = _read(study, RUN, read_json)
    if not all(isinstance(run.get(name), dict) for name in ("files", "versions", "parts")):
        raise EvidenceError(f"{study.folder / RUN} is of an earlier version; run the study again")
    return run


def read_units(study: Study, name: str = UNITS) -> pd.DataFrame:
    """Measured units.

    Args:
        study: The study.
        name: :data:`UNITS` or :data:`COSTS`.

    Raises:
        EvidenceError: If it has not been run, or the file is damaged or of another run.
    """
    known = read_run(study)["files"].get(name)
    found: pd.DataFrame = _read(study, name, read_table, known).to_pandas()
    return found


def _read(study: Study, name: str, how: Any, known: str | None = None) -> Any:
    path: Path = study.folder / name
    try:
        content = path.read_bytes()
        if known and hashlib.sha256(content).hexdigest() != known:
            raise ChecksumError(f"{RUN} is of another run")
        return how(content)
    except FileNotFoundError:
        raise EvidenceError(
            f"{study.name} has not been run; run it with: causal-openlock evidence {study.name}"
        ) from None
    except ChecksumError as error:
        raise EvidenceError(f"{path} is damaged: {error}; run the study again") from None
