"""Workers on other machines: those of a Dask cluster.

Dask's scheduler gives jobs to workers, and its client is a :class:`concurrent.futures.Executor`, so
a comparison runs there by the same code as here. Workers read and write the results folder, which
all machines share; what goes over the network is small.

What is particular about it:

* A job is submitted when a worker is idle, not before: if a worker is lost, Dask blames all jobs
  that it had. Jobs are not ``pure``, or the answer to one that is given again would be the old one.
* A lost worker is a ``KilledWorker``. The cell is then played again (see the runner), from its
  checkpoint.
* A worker has one thread, since a process plays one cell at a time; it says so if it has more. Its
  packages have to be those of the comparison, or results would differ.
* Code that holds Python's lock for minutes keeps a worker from reporting to the scheduler, which
  gives it up after ``worker-ttl``: five minutes, unless that is set otherwise as it is here.
"""

from __future__ import annotations

import asyncio
import importlib.util
import logging
import re
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, TypeVar

from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.experiment.experiment import Cell
from causal_openlock.running.carried_code import CarriedCode, use
from causal_openlock.running.workers import ExternalExecutor, start_alone
from causal_openlock.storage.store import Store
from causal_openlock.storage.versions import versions

SETTINGS = {
    "distributed.scheduler.allowed-failures": 0,
    "distributed.scheduler.worker-ttl": None,
}
"""Settings of a scheduler that is started here, as in the scripts of ``examples/clusters``."""
PATIENCE = 10.0
"""Seconds to wait for a scheduler."""

Result = TypeVar("Result")


class Cluster(ExternalExecutor):
    """The workers of a Dask cluster.

    Args:
        client: Its client.
        address: Where the scheduler is, for messages.
        carried: Code that the workers need.
    """

    def __init__(self, client: Any, address: str, carried: CarriedCode) -> None:
        super().__init__(client.get_executor(pure=False, retries=0))
        self._client, self._address, self._carried = client, address, carried
        self._running: set[Future[Any]] = set()

    def number(self) -> int:
        """Number of workers."""
        if self._client.status != "running":
            raise self._lost()
        try:
            return len(self._client.nthreads())
        except OSError:
            raise self._lost() from None

    def free(self) -> bool:
        """Whether a worker is idle."""
        return len(self._running) < self.number()

    def submit(
        self, job: Callable[..., Result], *arguments: Any, alone: bool = False
    ) -> Future[Result]:
        """Start a job; ``alone`` is ignored."""
        future: Future[Result] = self._executor.submit(
            play_there, self._carried, dict(versions()), job, *arguments
        )
        self._running.add(future)
        return future

    def done(self, future: Future[Any]) -> str:
        """Take note of a finished job; returns how its worker was lost, if it was.

        Raises:
            OpenLockError: If the scheduler was lost, or the workers cannot play.
        """
        from distributed import KilledWorker

        self._running.discard(future)
        try:
            error = future.exception()
        except CancelledError:
            raise self._lost() from None
        if isinstance(error, ModuleNotFoundError) and error.name == "causal_openlock":
            raise OpenLockError(
                f"a worker of {self._address} does not have causal_openlock; install the same "
                "version for the workers"
            )
        if isinstance(error, KilledWorker):
            return f"the worker {error.last_worker.address} was lost, perhaps for lack of memory"
        return ""

    def _lost(self) -> OpenLockError:
        return OpenLockError(
            f"the scheduler {self._address} was lost; start it, and give the same command again: "
            "it continues where it stopped"
        )


def play_there(
    carried: CarriedCode,
    expected: dict[str, str],
    job: Callable[..., Any],
    cell: Cell,
    folder: str,
    *arguments: Any,
) -> Any:
    """Play a cell on a worker of a cluster.

    Args:
        carried: Code that it needs.
        expected: The versions of packages of the comparison.
        job: What plays the cell.
        cell: The cell.
        folder: Its results folder.
        *arguments: The other arguments of ``job``.

    Raises:
        OpenLockError: If this worker must not play, or cannot.
    """
    from distributed import get_worker

    worker = get_worker()
    if worker.state.nthreads != 1:
        raise OpenLockError(
            f"the worker {worker.address} has {worker.state.nthreads} threads, and a process plays "
            "one cell at a time; start the workers with --nthreads 1"
        )
    for package, version in expected.items():
        if versions()[package] != version:
            raise OpenLockError(
                f"the worker {worker.address} has {package} {versions()[package]}, and here it is "
                f"{version}; install the same version for both"
            )
    store = Store(folder)
    if not (Path(folder) / "experiment.json").is_file():
        raise OpenLockError(
            f"the worker {worker.address} does not see {folder}; give --out a folder that all "
            "machines share under the same path"
        )
    use(carried)
    if store.check(cell) is None:  # a worker was lost after it had written the record
        return []
    return job(cell, folder, *arguments)


@contextmanager
def joined(address: str, carried: CarriedCode) -> Iterator[Cluster]:
    """The workers of the cluster of a scheduler, or of one that is started here (``local:8``).

    Raises:
        OpenLockError: If Dask is not installed, or there is no scheduler.
    """
    if importlib.util.find_spec("distributed") is None:
        raise OpenLockError(
            "a cluster needs the package distributed; install it with: "
            "pip install 'causal-openlock[cluster]'"
        )
    from distributed import Client

    with ExitStack() as stack:
        here = re.fullmatch(r"local:([1-9]\d{0,3})", address, re.ASCII)
        if here:
            where: Any = stack.enter_context(_started(int(here[1])))
        elif re.match(r"local(:|$)", address):
            raise OpenLockError(
                f"--cluster {address} has no number of workers from 1 to 9999; write it like "
                "local:8, for eight workers here"
            )
        else:
            where = address
            _require_scheduler(address)
        client = stack.enter_context(Client(where, timeout=PATIENCE, set_as_default=False))
        # It would say that the scheduler is lost, which is said anyway.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        yield Cluster(client, address, carried)


def _require_scheduler(address: str) -> None:
    """Raise OpenLockError unless a scheduler answers at an address in time.

    A client would ask for minutes where something else answers, such as the dashboard, and would
    end with a traceback of its own.
    """
    from distributed.core import rpc
    from distributed.security import Security

    async def identity() -> dict[str, Any]:
        how = Security().get_connection_args("client")
        async with rpc(address, connection_args=how) as asked:
            return await asked.identity()

    async def in_time() -> str:
        return (await asyncio.wait_for(identity(), PATIENCE))["type"]

    logging.getLogger("distributed.comm").setLevel(logging.CRITICAL)
    try:
        kind, why = asyncio.run(in_time()), ""
    except TimeoutError:
        kind, why = "", f"; nothing answered as one within {PATIENCE:g} seconds"
    except Exception as error:  # an address of another form fails in any way
        kind, why = "", f" ({in_short(error)})" if in_short(error) else ""
    if kind != "Scheduler":
        raise OpenLockError(
            f"there is no Dask scheduler at {address!r}{why}; give --cluster its address, such as "
            "tcp://host:8786 (not that of its dashboard, http://host:8787), or local:8 for eight "
            "workers here"
        )


@contextmanager
def _started(workers: int) -> Iterator[Any]:
    """A cluster of processes of this machine."""
    import dask
    from distributed import LocalCluster

    with (
        dask.config.set(SETTINGS),
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            memory_limit=0,  # as with processes of this machine, the system decides
            dashboard_address=":0",  # the usual port may be that of another comparison
            scheduler_kwargs={"dashboard": False},
            silence_logs=logging.CRITICAL,
            preload=[__name__],
        ) as cluster,
    ):
        yield cluster


def dask_setup(worker: object) -> None:
    """Let a worker that was started here ignore signals that its parent handles; Dask calls it."""
    start_alone()
