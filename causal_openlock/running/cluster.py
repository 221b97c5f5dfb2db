"""Workers on other machines: those of a Dask cluster.

Its client has an executor, so a comparison runs there as with any other. All machines share the
results folder, which also holds the user's files that learners and rewards are in.
"""

from __future__ import annotations

import asyncio
import logging
import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.experiment.declare import Cell
from causal_openlock.running.workers import Doing, LostError, done_jobs
from causal_openlock.storage.versions import other_versions, versions

PATIENCE = 10.0  # seconds to wait for a scheduler


def in_cluster(
    address: str,
    do: Callable[[Cell], Any],
    jobs: deque[Cell],
    code: list[str],
    folder: Path,
    warn: Callable[[str], None],
) -> Doing:
    """Let the workers of a Dask cluster do jobs, with the modules in folders of ``code``."""
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise OpenLockError("--cluster needs: pip install 'causal-openlock[cluster]'") from None

    def workers() -> int:
        if client.status != "running":
            raise CancelledError
        if not (number := len(client.nthreads())):
            warn("there is no worker at the moment; the cells wait for one")
        return number

    there = partial(_play_there, do, code, folder, versions())
    _require_scheduler(address)
    # It would say that the scheduler is lost, which is said anyway.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    with Client(address, set_as_default=False) as client:
        # Not pure, as a job may be given again; one a worker, as Dask blames all of a lost worker.
        executor = client.get_executor(pure=False, retries=0)
        try:
            for done in done_jobs(executor, there, jobs, workers):
                if done and isinstance(done.error, CancelledError):
                    raise done.error
                if done and isinstance(done.error, KilledWorker):
                    worker = done.error.last_worker.address
                    how = f"the worker {worker} was lost, perhaps for lack of memory"
                    done = done._replace(error=LostError(f"ended its process ({how})"))
                yield done
        except (CancelledError, OSError):
            raise OpenLockError(
                f"the scheduler {address} was lost; start it, and give the same command again: it "
                "continues where it stopped"
            ) from None


def _play_there(
    do: Callable[[Cell], Any], code: list[str], folder: Path, expected: dict[str, str], cell: Cell
) -> Any:
    """Play a cell on a worker, with the user's files in folders and these versions of packages."""
    from distributed import get_worker

    worker, fault = get_worker(), ""
    if worker.state.nthreads != 1:  # a process plays one cell at a time
        fault = f"has {worker.state.nthreads} threads; start the workers with --nthreads 1"
    elif others := other_versions(expected, versions()):
        fault = f"lacks {others}, as the comparison has it; install the same versions for both"
    elif not (folder / "experiment.json").is_file():
        fault = f"does not see {folder}; give --out a folder that all see under this path"
    if fault:
        raise OpenLockError(f"the worker {worker.address} {fault}")
    if sys.path[: len(code)] != code:
        own = {path.stem for place in code for path in Path(place).iterdir()}
        for name in [name for name in sys.modules if name.partition(".")[0] in own]:
            del sys.modules[name]  # of another comparison
        sys.path[:0] = code
    return do(cell)


def _require_scheduler(address: str) -> None:
    """Raise OpenLockError if no scheduler answers, for which a client would wait for ever."""
    import distributed

    async def kind() -> str:
        secure = distributed.Security().get_connection_args("client")
        async with distributed.rpc(address, connection_args=secure) as scheduler:
            return (await scheduler.identity())["type"]

    logging.getLogger("distributed.comm").setLevel(logging.CRITICAL)
    with ThreadPoolExecutor(1) as thread:  # a notebook's own runs an event loop already
        answer = thread.submit(asyncio.run, asyncio.wait_for(kind(), PATIENCE))
    error = answer.exception()  # an address of another form fails in any way
    if error or answer.result() != "Scheduler":
        why = in_short(error) if error else "it is something else"
        raise OpenLockError(
            f"there is no Dask scheduler at {address!r} ({why or 'nothing answers'}); give "
            "--cluster its address, such as tcp://host:8786 (not that of its dashboard, "
            "http://host:8787); on this machine alone, --workers 8 needs none"
        )
