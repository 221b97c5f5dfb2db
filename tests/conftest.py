"""What all tests share: an environment, stored texts, kernels compiled once, slow files first."""

import difflib
import fcntl
import gc
import os
import platform
import sys
from pathlib import Path

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
def pytest_xdist_auto_num_workers():
    """One worker more than there are cores: browsers, servers and processes are waited for."""
    from causal_openlock.running.workers import available_cores

    return available_cores() + 1


def pytest_configure():
    """Look for cycles less often."""
    # A twentieth of the time of all tests went into looking for cycles every 700 objects.
    gc.set_threshold(50_000, 20, 50)


def pytest_collection_finish():
    """What is imported and collected stays, and need not be looked through again and again."""
    gc.freeze()


def pytest_addoption(parser):
    """Take ``--golden``, which writes what the fixture `golden` compares with."""
    parser.addoption("--golden", action="store_true", help="write the files of tests/golden anew")


GOLDEN = Path(__file__).parent / "golden"
WRITE_THEM = """\
no digests are stored for processors like this one ({kind}); to write them by the code that wrote
those that are stored:
  git worktree add ../last $(git log -1 --format=%h -- tests/golden/cells)
  PYTHONPATH=../last:../last/learners .venv/bin/pytest --golden tests/golden -k networks"""


@pytest.fixture
def golden(request):
    """Compare a text with a stored one: ``golden("report.txt", text)``.

    The file is ``tests/golden/report.txt``; ``pytest --golden`` writes it anew, and the commit that
    does so says why. A text in which digits depend on the processor is stored for each kind:
    ``golden("cells/networks.txt", text, processor=True)``; on another kind the test is skipped.
    What differs at each run (times, paths, versions) has to be masked before;
    :func:`support.masks.masked` does most of it.
    """

    def compare(name, text, processor=False):
        path = GOLDEN / name
        if processor:
            path = path.with_name(f"{path.stem}.{processor_kind()}{path.suffix}")
        text = "".join(f"{line.rstrip()}\n" for line in text.strip().splitlines())
        if request.config.getoption("golden"):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
            return
        if processor and not path.exists():
            pytest.skip(WRITE_THEM.format(kind=processor_kind()))
        stored = path.read_text(encoding="utf-8") if path.exists() else ""
        if stored != text:
            lines = [*difflib.unified_diff(stored.splitlines(), text.splitlines(), n=1)][2:]
            more = f"\n... and {len(lines) - 60} lines more" if len(lines) > 60 else ""
            pytest.fail(
                f"{path.relative_to(GOLDEN.parent)} differs (- stored, + now); if it is meant to, "
                "write it anew with pytest --golden, and say why in the commit:\n"
                + "\n".join(lines[:60])
                + more,
                pytrace=False,
            )

    return compare


def processor_kind():
    """What last digits of networks depend on: the machine, the width of its vectors, its maker.

    Numba adds up in as many parts as a vector holds, whatever the model of the processor; torch
    multiplies matrices by MKL, which takes other ways on processors that are not Intel's.
    """
    import torch
    from llvmlite.binding import get_host_cpu_name

    maker = "amd" if get_host_cpu_name().startswith("znver") else "other"
    capability = torch.backends.cpu.get_cpu_capability().lower()
    return f"{platform.machine()}-{capability}-{maker}".lower()


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Begin with slow files, so that no worker is left with one at the end."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(scope="session", autouse=True)
def _each_kernel_is_compiled_by_one(tmp_path_factory):
    """Numba keeps what it compiles in files; another worker waits for them and reads them."""
    from numba.core.dispatcher import Dispatcher

    compile_ = Dispatcher.compile
    base = tmp_path_factory.getbasetemp()
    locks = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "compiling"
    locks.mkdir(exist_ok=True)

    def compiled(self, sig):
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
