"""What all tests share: an environment, kernels compiled once, and slow files first."""

from __future__ import annotations

import fcntl
import gc
import os
import sys
from collections.abc import Iterator
from functools import cache
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


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than there are cores: browsers, servers and processes are waited for."""
    from causal_openlock.running.workers import available_cores

    return available_cores() + 1


def pytest_configure() -> None:
    """Look for cycles less often."""
    # A twentieth of the time of all tests went into looking for cycles every 700 objects.
    gc.set_threshold(50_000, 20, 50)


def pytest_collection_finish() -> None:
    """What is imported and collected stays, and need not be looked through again and again."""
    gc.freeze()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with slow files, so that no worker is left with one at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(scope="session", autouse=True)
def _each_kernel_is_compiled_by_one(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Numba keeps what it compiles in files; another worker waits for them and reads them."""
    from numba.core.dispatcher import Dispatcher

    compile_ = Dispatcher.compile
    base = tmp_path_factory.getbasetemp()
    locks = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiling"
    locks.mkdir(exist_ok=True)

    def compiled(self: Any, sig: Any) -> Any:
        name = f"{self.py_func.__module__}.{self.py_func.__qualname__}"
        if not name.startswith(("causal_openlock.", "openlock_learners.")):
            return compile_(self, sig)
        # A lock for each kernel: others are compiled meanwhile. A kernel has those that it calls
        # compiled, and none calls itself, so nobody waits in a circle.
        with (locks / name).open("w") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            return compile_(self, sig)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Dispatcher, "compile", compiled)
        yield


@pytest.fixture(scope="session", autouse=True)
def _commands_are_made_once() -> Iterator[None]:
    """Typer makes click's commands of all functions anew for each call in one process."""
    import typer.main
    import typer.testing

    made = cache(typer.main.get_command)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.main, "get_command", made)
        patch.setattr(typer.testing, "_get_command", made)
        yield


@pytest.fixture(scope="session", autouse=True)
def _figures_are_drawn_where_a_test_looks_at_them() -> Iterator[None]:
    """See :mod:`support.figures`."""
    from causal_openlock.analysis.plots import style
    from support.figures import empty

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "images", empty)
        yield
