"""What is compiled is stored, and what is stored is not trusted."""

import importlib.util
import sys

import pytest

from causal_openlock.files import compiling
from causal_openlock.files.compiling import compiled, without_cache

CODE = "def twice(number):\n    return 2 * number\n"


@pytest.fixture
def twice(tmp_path, monkeypatch):
    """A function in a file of its own, imported anew each time and not compiled yet."""
    path = tmp_path / "loops_of_a_test.py"
    path.write_text(CODE)

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
@pytest.mark.parametrize("damage", ["cut", "empty", "flipped"])
def test_what_is_damaged_is_compiled_anew(twice, tmp_path, suffix, damage):
    assert twice()(4) == 8
    whole = twice()
    assert (whole(4), hits(whole)) == (8, 1)
    (path,) = (tmp_path / "__pycache__").glob(f"*{suffix}")
    content = path.read_bytes()
    middle = len(content) // 2
    flipped = content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]
    path.write_bytes({"cut": content[:middle], "empty": b"", "flipped": flipped}[damage])
    again = twice()
    assert again(4) == 8
    assert hits(again) == 0 or suffix == ".nbi"
    last = twice()
    assert (last(4), hits(last)) == (8, 1)  # it is whole again


def test_where_nothing_can_be_stored_it_is_said_once(monkeypatch):
    monkeypatch.setattr(compiling, "_said", [])
    nowhere = {}
    exec(compile(CODE, "<nowhere>", "exec"), nowhere)
    with pytest.warns(UserWarning, match="NUMBA_CACHE_DIR") as told:
        functions = [compiled(nowhere["twice"]) for _ in range(2)]
    assert len(told) == 1
    assert [one(4) for one in functions] == [8, 8]
    assert len(without_cache()) == 1
