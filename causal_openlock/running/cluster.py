"""Workers on other machines: those of a Dask cluster.

Its client is a :class:`concurrent.futures.Executor`, so a comparison runs there as with any other.
Workers read and write the results folder, which all machines share; the user's files that learners
and rewards are in are copied into it. A job is submitted when a worker is idle, not before: if a
worker is lost, Dask blames all jobs that it had. Jobs are not ``pure``, or the answer to one that
is given again would be the old one.
"""

from __future__ import annotations

import asyncio
import logging
import re
import sys
from collections import deque
from collections.abc import Callable
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.experiment.declare import Cell, Experiment
from causal_openlock.files.atomic import write_bytes
from causal_openlock.running.workers import Doing, Done, LostError, begin_worker, done_jobs
from causal_openlock.storage.versions import versions
from causal_openlock.usercode.own_files import digest_of, own_files

# As in the scripts of examples/clusters. Code that holds Python's lock for minutes keeps a worker
# from reporting to the scheduler, which would give it up.
SETTINGS = {"distributed.scheduler.allowed-failures": 0, "distributed.scheduler.worker-ttl": None}
PATIENCE = 10.0
"""Seconds to wait for a scheduler."""


def in_cluster(
    address: str,
    do: Callable[[Cell], Any],
    jobs: deque[Cell],
    experiment: Experiment,
    folder: Path,
    warn: Callable[[str], None],
) -> Doing:
    """Let the workers of a Dask cluster do jobs; ``local:8`` starts eight of them here."""
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise OpenLockError(
            "a cluster needs the package distributed; install it with: "
            "pip install 'causal-openlock[cluster]'"
        ) from None

    def workers() -> int:
        if client.status != "running":
            raise CancelledError
        if not (number := len(client.nthreads())):
            warn("there is no worker at the moment; the cells wait for one")
        return number

    there = partial(_play_there, do, _carried(experiment, folder), str(folder), dict(versions()))
    with ExitStack() as stack:
        scheduler = _scheduler(address, stack)
        client = stack.enter_context(Client(scheduler, timeout=PATIENCE, set_as_default=False))
        # It would say that the scheduler is lost, which is said anyway.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        executor = client.get_executor(pure=False, retries=0)
        try:
            for done in done_jobs(executor, there, jobs, workers):
                if done and isinstance(done.error, CancelledError):
                    raise done.error
                if done and isinstance(done.error, KilledWorker):
                    worker = done.error.last_worker.address
                    how = f"the worker {worker} was lost, perhaps for lack of memory"
                    done = Done(done.job, error=LostError(f"ended its process ({how})"))
                yield done
        except (CancelledError, OSError):
            raise OpenLockError(
                f"the scheduler {address} was lost; start it, and give the same command again: it "
                "continues where it stopped"
            ) from None


def _play_there(
    do: Callable[[Cell], Any], code: str, folder: str, expected: dict[str, str], cell: Cell
) -> Any:
    """Play a cell on a worker, with the user's files in a folder and these versions of packages."""
    from distributed import get_worker

    worker, here = get_worker(), versions()
    others = [package for package, version in expected.items() if here[package] != version]
    if worker.state.nthreads != 1:  # a process plays one cell at a time
        fault = f"has {worker.state.nthreads} threads; start the workers with --nthreads 1"
    elif others:
        fault = f"has {others[0]} {here[others[0]]}, and the comparison {expected[others[0]]}; "
        fault += "install the same version for both"
    elif not (Path(folder) / "experiment.json").is_file():
        fault = f"does not see {folder}; give --out a folder that all machines share under the "
        fault += "same path"
    else:
        if code and sys.path[0] != code:
            own = {path.stem for path in Path(code).iterdir()}
            for name in [name for name in sys.modules if name.partition(".")[0] in own]:
                del sys.modules[name]  # of another comparison
            sys.path.insert(0, code)
        return do(cell)
    raise OpenLockError(f"the worker {worker.address} {fault}")


def _carried(experiment: Experiment, folder: Path) -> str:
    """Copy the user's files that an experiment plays; returns their folder, empty if none."""
    names = {name for spec in experiment.learners for name in (spec.learner, spec.reward.name)}
    files = own_files(name.partition(":")[0] for name in names if ":" in name).files
    code = folder / "code" / digest_of(files)
    for inside, path in files.items():
        write_bytes(code / inside, path.read_bytes())
    return str(code) if files else ""


def _scheduler(address: str, stack: ExitStack) -> Any:
    """The address of a scheduler that answers, or a cluster that is started here."""
    import dask
    import distributed

    if here := re.fullmatch(r"local:([1-9]\d{0,3})", address, re.ASCII):
        stack.enter_context(dask.config.set(SETTINGS))
        quiet = {"dashboard_address": ":0", "silence_logs": logging.CRITICAL}
        options = {"threads_per_worker": 1, "memory_limit": 0, "preload": [__name__], **quiet}
        return stack.enter_context(distributed.LocalCluster(n_workers=int(here[1]), **options))

    async def asked() -> str:
        secure = distributed.Security().get_connection_args("client")
        async with distributed.rpc(address, connection_args=secure) as scheduler:
            return (await scheduler.identity())["type"]

    # A client would wait for ever where something else answers. And a thread of a notebook has a
    # loop that runs already.
    logging.getLogger("distributed.comm").setLevel(logging.CRITICAL)
    with ThreadPoolExecutor(1) as thread:
        answer = thread.submit(asyncio.run, asyncio.wait_for(asked(), PATIENCE))
    error = answer.exception()  # an address of another form fails in any way
    if error or answer.result() != "Scheduler":
        why = in_short(error) if error else "it is something else"
        raise OpenLockError(
            f"there is no Dask scheduler at {address!r} ({why or 'nothing answers'}); give "
            "--cluster its address, such as tcp://host:8786 (not that of its dashboard, "
            "http://host:8787), or local:8 for eight workers here, from 1 to 9999"
        )
    return address


def dask_setup(worker: object) -> None:
    """Let a worker that was started here ignore signals that its parent handles; Dask calls it."""
    begin_worker()
