"""``causal-openlock bundle``: results in one file, for other people."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.options import ResultsFolder


def bundle(
    folder: ResultsFolder,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="ZIP file to write; default: FOLDER.zip."),
    ] = None,
) -> None:
    """Put an experiment, its record and its report into one file that anyone can run again."""
    from causal_openlock.cli.terminal import Console, say
    from causal_openlock.experiment.store import Store
    from causal_openlock.export.bundle import write_bundle

    whole = folder.resolve()
    path = out or whole.with_name(f"{whole.name}.zip")  # a dot in the name begins no suffix
    for caution in write_bundle(Store(folder), path):
        Console(stderr=True).warn(caution)
    size = path.stat().st_size / 1e6
    say(f"{path} written, {size:.1f} MB; its README.md says how to run it again")
