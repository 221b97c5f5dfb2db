"""``causal-openlock train``: train a network for ``rl2`` on rooms that a file declares."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def train(
    file: Annotated[
        Path | None,
        typer.Argument(help="Declares rooms and training; by default that of the bundled network."),
    ] = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="File of the network, .npz.")] = ...,  # type: ignore[assignment]
    seed: Annotated[int | None, typer.Option(min=0, help="In place of the file's.")] = None,
    threads: Annotated[int, typer.Option(min=1, help="Threads of matrix products.")] = 1,
) -> None:
    """Train a recurrent network for rl2 on rooms that a file declares.

    A training that was stopped is continued by the same command.
    """
    import torch

    from causal_openlock.cli.stopping import resumable
    from causal_openlock.cli.terminal import say
    from causal_openlock.errors import OpenLockError
    from causal_openlock.files.atomic import folder_at
    from causal_openlock.schemas.finding import bundled
    from openlock_learners.meta.training import MetaTraining, run_training
    from openlock_learners.meta.training_file import read_training
    from openlock_learners.networks.denormals import denormals_flushed

    if not out.name or out.is_dir():
        raise OpenLockError(f"{out} is a folder; give --out the name of a file, such as rl2.npz")
    folder_at(out.parent)
    torch.set_num_threads(threads)
    file = file or bundled("experiments") / "meta_training" / "rl2.yaml"
    declared = read_training(file)
    if seed is not None:
        declared = declared.model_copy(update={"seed": seed})

    def log(line: str) -> None:
        say(line)
        sys.stdout.flush()  # it may be a file, which people read while the network is trained

    with denormals_flushed(), resumable():
        run_training(MetaTraining(declared, file.parent), out, log)
