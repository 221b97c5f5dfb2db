"""The steps of a fit, each stored in a file that is named after what decides its result.

A fit that was stopped, or is made anew, asks for the same steps again, and those that are stored
are not repeated. With other settings, subjects or code, a step has another name.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.files.atomic import sweep, unwritable, write_bytes
from causal_openlock.files.checksums import ChecksumError, digest, json_bytes, read_json
from causal_openlock.files.validation import adapter
from causal_openlock.running.workers import worker_pool
from causal_openlock.storage.folder_lock import locked
from causal_openlock.version import RESULTS_VERSION

T = TypeVar("T")
STEPS = "steps"  #: folder of the steps of a fit
SEEDS = 3
"""Seeds of a fit to means: of the search, of the best candidates, and of what is reported."""


@contextmanager
def fitting_in(folder: Path, workers: int) -> Iterator[Executor | None]:
    """A block in which no other fit works in a folder; files of killed fits are removed.

    Yields:
        Processes to work in; with one worker none, as this process works.

    Raises:
        StoreError: If another fit works there, or the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    pools = worker_pool(workers) if workers > 1 else nullcontext()
    with locked(folder, "fit"), pools as pool:
        sweep(folder / STEPS)
        sweep(folder)
        yield pool


def begin(pool: Executor | None, work: Callable[..., T], *args: Any) -> Callable[[], T]:
    """Begin a job in a pool, or do it in this process once its result is asked for."""
    return pool.submit(work, *args).result if pool else partial(work, *args)


def steps(
    folder: Path, jobs: Sequence[tuple[Any, Callable[[], Callable[[], T]]]], kind: Any
) -> Iterator[T]:
    """Results of steps, in order: as they are stored, or else done now and then stored.

    Args:
        folder: The folder of the fit.
        jobs: Of each step all that decides its result, as plain data, and what begins it and
            returns what waits for its result, as :func:`begin` does. All that are not stored begin
            before the first is waited for.
        kind: Type of the results, which Pydantic reads and writes.

    Raises:
        StoreError: If a file is not a step.
    """
    begun = []
    for about, start in jobs:
        text = json.dumps([RESULTS_VERSION, about], sort_keys=True, default=str)
        path = folder / STEPS / f"{digest(text)}.json"
        begun.append((path, None if path.exists() else start()))
    for path, wait in begun:
        if wait:
            result = adapter(kind).dump_python(wait(), mode="json")
            write_bytes(path, json_bytes({"result": result}))
        yield read_fit_file(
            path,
            lambda stored: adapter(kind).validate_python(stored["result"]),
            "delete it and give the command again",
        )


def read_fit_file(path: Path, read: Callable[[dict[str, Any]], T], remedy: str) -> T:
    """Read a file of a fit with ``read``.

    Raises:
        StoreError: If the file is not of a fit: it cannot be read, is not what was written, or
            ``read`` raises what is raised of data of another form.
    """
    try:
        return read(read_json(path.read_bytes()))
    except ChecksumError as error:
        raise StoreError(f"{path}: this is not a fit ({error}); {remedy}") from None
    except OpenLockError:
        raise
    except (ValueError, OSError, TypeError, LookupError, ArithmeticError, RecursionError):
        raise StoreError(f"{path}: this is not a fit; {remedy}") from None


def seeds_of(path: Path) -> range:
    """Return the seeds that a stored fit to means played with.

    Raises:
        StoreError: If the file is not a fit.
    """
    first = read_fit_file(path, lambda fit: int(fit["plan"]["seed"]), "make the fit again")
    return range(first, first + SEEDS)
