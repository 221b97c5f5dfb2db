"""What is compiled is stored, compiled anew where it cannot be read, and plain Python on demand."""

import importlib.util
import os
import subprocess
import sys
import warnings

import pytest

from causal_openlock.files.compiling import compiled

CODE = "def twice(number):\n    return 2 * number\n"


@pytest.fixture
def twice(tmp_path, monkeypatch):
    """A function in a file of its own, imported anew each time and not compiled yet."""
    path = tmp_path / "loops_of_a_test.py"
    path.write_text(CODE)
    monkeypatch.setattr("numba.core.config.CACHE_DIR", "")  # whatever the environment asks for

    def fresh():
        spec = importlib.util.spec_from_file_location(path.stem, path)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, path.stem, module)
        spec.loader.exec_module(module)
        return compiled(module.twice)

    return fresh


def hits(function):
    return sum(function.stats.cache_hits.values())


@pytest.mark.parametrize("suffix", [".nbi", ".nbc"])
@pytest.mark.parametrize("size", [0, 100])
def test_what_is_cut_off_is_compiled_anew(twice, tmp_path, suffix, size):
    assert twice()(4) == 8
    whole = twice()
    assert (whole(4), hits(whole)) == (8, 1)
    (path,) = (tmp_path / "__pycache__").glob(f"*{suffix}")
    path.write_bytes(path.read_bytes()[:size])
    again = twice()
    assert again(4) == 8
    assert hits(again) == 0
    last = twice()
    assert (last(4), hits(last)) == (8, 1)  # it is whole again


def test_where_nothing_can_be_stored_it_is_said_once():
    nowhere = {}
    exec(compile(CODE, "<nowhere>", "exec"), nowhere)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("default")
        functions = [compiled(nowhere["twice"]) for _ in range(2)]
    assert [str(one.message).count("NUMBA_CACHE_DIR") for one in told] == [1]
    assert [one(4) for one in functions] == [8, 8]


def test_learners_can_be_debugged_as_plain_python():
    code = (
        "import causal_openlock as ol\n"
        "print(len(ol.compare('CC3', ['random', 'tabular_q'], subjects=1, workers=0).attempts))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
    )
    assert int(done.stdout) > 10, done.stderr
