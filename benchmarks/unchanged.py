"""Whether results are the same, byte for byte: ``python benchmarks/unchanged.py``.

Shipped experiments are played, and the SHA-256 of each ``summary.csv`` and of the contents of each
cell is compared with what ``benchmarks/measured/unchanged.json`` has. Contents are the columns of
the record but for wall times: names and identities of files, and what a cell says of versions, are
left out, so that code may be moved and renamed. Neural learners may differ on another kind of
processor; give ``--write`` on the old code first there. Ends with status 1 if something differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from pathlib import Path

EXPERIMENTS = ("deep_quick", "own_schemas", "bayes", "default")
STORED = Path(__file__).with_name("measured") / "unchanged.json"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("experiments", nargs="*", default=EXPERIMENTS, metavar="EXPERIMENT")
    parser.add_argument("--write", action="store_true", help="store the digests found")
    parser.add_argument("--folder", type=Path, help="play here, and keep what was played")
    chosen = parser.parse_args()
    stored = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    different = []
    with tempfile.TemporaryDirectory() as place:
        for name in chosen.experiments:
            found = digests(played(name, (chosen.folder or Path(place)) / name))
            if chosen.write:
                stored[name] = found
                STORED.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")
                continue
            expected = stored[name]
            others = [key for key in expected | found if expected.get(key) != found.get(key)]
            different += others
            print(f"{name}: {len(found)} digests, {len(others)} differ", *others[:10], flush=True)
    sys.exit(bool(different))


def played(experiment: str, folder: Path) -> Path:
    command = [sys.executable, "-m", "causal_openlock", "compare", experiment, "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return folder


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of the summary and of each cell, by the cell's name without its identity."""
    summary = (folder / "summary.csv").read_bytes()
    cells = json.loads((folder / "experiment.json").read_text(encoding="utf-8"))["cells"]
    return {"summary.csv": hashlib.sha256(summary).hexdigest()} | {
        name.rpartition("_")[0]: content(folder / "cells" / name) for name in cells
    }


def content(cell: Path) -> str:
    """SHA-256 of a cell's columns, whatever its file's metadata, compression and row groups."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(cell).drop_columns(["wall_time"]).combine_chunks()
    texts = {f.name: pa.string() for f in table.schema if pa.types.is_dictionary(f.type)}
    plain = pa.schema([pa.field(f.name, texts.get(f.name, f.type)) for f in table.schema])
    stream = pa.BufferOutputStream()
    with pa.ipc.new_stream(stream, plain) as writer:
        writer.write_table(table.replace_schema_metadata(None).cast(plain))
    return hashlib.sha256(stream.getvalue()).hexdigest()


if __name__ == "__main__":
    main()
