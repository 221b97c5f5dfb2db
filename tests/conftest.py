"""What all tests share: an environment, kernels compiled once, and the order of the long ones."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import os
import sys
from collections.abc import Iterator
from typing import Any

import pytest

# Before NumPy and torch are imported: workers side by side do not compete for cores, and the
# processes that tests start inherit it.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Those processes would otherwise compile every module of the package anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

LONGEST_FIRST = (
    "project/test_docs.py::test_the_site_builds_without_a_warning_and_is_whole",
    "project/test_notebooks.py",
    "project/test_docs.py::test_what_a_page_shows_is_what_happens",
    "learners/networks/test_double_q_compiled.py",
    "contract/test_learner_contract.py",
    "cli/test_cli.py",
    "learners/test_bayes.py",
    "play/test_play_browser.py",
    "play/test_play_server.py",
    "learners/test_recurrent.py",
    "running/test_checkpoint.py",
    "running/test_cluster.py",
    "belief/test_beliefs.py",
    "physics/test_physics_agreement.py",
    "analysis/report",
    "fitting/test_fit.py",
    "storage/test_store.py",
    "export/test_bundle.py",
    "belief/test_trace.py",
    "learners/test_ideal.py",
    "project/test_wheel.py",
    "contract/test_third_party.py",
    "world/test_own_rewards.py",
)
"""Tests and files that take long, so that none of them is begun last; they are begun in this order.

A test that is named is given to a worker by itself, any other with all of its file, whose tests
share what they set up.
"""


def _place(nodeid: str) -> int:
    """Where a test stands in the list; behind its end if it takes not long."""
    places = (index for index, name in enumerate(LONGEST_FIRST) if f"tests/{name}" in nodeid)
    return next(places, len(LONGEST_FIRST))


def _unit(nodeid: str) -> str:
    """What is given to a worker as one piece: a long test, or a file."""
    place = _place(nodeid)
    alone = place < len(LONGEST_FIRST) and "::" in LONGEST_FIRST[place]
    return nodeid if alone else nodeid.partition("::")[0]


def pytest_configure(config: pytest.Config) -> None:
    """Keep the order in which tests are collected; xdist begins with the largest files else."""
    config.option.loadscopereorder = False
    # A twentieth of the time of all tests went into looking for cycles every 700 objects.
    gc.set_threshold(50_000, 20, 50)


def pytest_collection_finish() -> None:
    """What is imported and collected stays, and need not be looked through again and again."""
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the long ones come first."""
    items.sort(key=lambda item: _place(item.nodeid))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Whole files to each worker as it becomes free, and long tests one by one."""
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return _unit(nodeid)

    return Scheduling(config, log)


@pytest.fixture(scope="session", autouse=True)
def _each_kernel_is_compiled_by_one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Numba keeps what it compiles in files; another worker waits for them and reads them."""
    from numba.core.dispatcher import Dispatcher

    compile_, inside = Dispatcher.compile, [0]
    base = tmp_path_factory.getbasetemp()
    lock = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiling.lock"

    @contextlib.contextmanager
    def alone() -> Iterator[None]:
        with lock.open("w") as file:
            if not inside[0]:  # a kernel has those that it calls compiled
                fcntl.flock(file, fcntl.LOCK_EX)
            inside[0] += 1
            try:
                yield
            finally:
                inside[0] -= 1

    def compiled(self: Any, sig: Any) -> Any:
        with alone():
            return compile_(self, sig)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", compiled)
        yield


@pytest.fixture(scope="session", autouse=True)
def _figures_are_drawn_where_a_test_looks_at_them() -> Iterator[None]:
    """See :mod:`support.figures`."""
    from causal_openlock.analysis.plots import style
    from support.figures import save_empty

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "save", save_empty)
        yield
