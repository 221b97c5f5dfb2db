"""A small share of the spoiled files of `make fuzz`, and that faults are found there."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.errors import OpenLockError
from support.places import ROOT

pytestmark = pytest.mark.slow

with pytest.MonkeyPatch.context() as _patch:
    _patch.syspath_prepend(ROOT / "benchmarks")
    import fuzz
    import fuzz_readers

INPUTS = 200


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.fixture(scope="module")
def readers(work: Path) -> dict[str, fuzz_readers.Reader]:
    return {one.name: one for one in fuzz_readers.readers(work)}


def test_the_files_that_are_spoiled_are_read_as_they_are(
    readers: dict[str, fuzz_readers.Reader], work: Path
) -> None:
    for reader in readers.values():
        content = reader.corpus[0]
        outcome = fuzz.tried(reader, content, work)
        assert outcome.kind == "read", (reader.name, outcome)
    assert sum(one.share for one in readers.values()) == 100


def test_spoiled_files_are_read_or_refused_in_a_sentence(
    readers: dict[str, fuzz_readers.Reader], work: Path
) -> None:
    shares = {name: one.share for name, one in readers.items()}
    kinds = set()
    for number in range(INPUTS):
        reader = readers[fuzz.reader_of(number, shares)]
        outcome = fuzz.tried(reader, fuzz.spoiled(reader, number), work, number)
        assert outcome.kind != "faults", outcome
        kinds.add(outcome.kind)
    assert kinds == {"read", "refused"}


def _fails(work: Path) -> None:
    raise KeyError("door")


def _hangs(work: Path) -> None:
    try:
        while True:
            sum(range(1000))
    except Exception:  # as a reader does that takes any exception for a fault of the file
        raise OpenLockError("it cannot be read") from None


def _takes_memory(work: Path) -> None:
    np.ones(66 << 20)


@pytest.mark.parametrize(
    ("read", "text"),
    [(_fails, "KeyError"), (_hangs, "more than 0.1 seconds"), (_takes_memory, " MB")],
)
def test_a_fault_is_found(tmp_path: Path, read: Callable[[Path], None], text: str) -> None:
    reader = fuzz_readers.Reader("one", 100, [b"x"], fuzz_readers.spoil_bytes, "file", read)
    began = time.process_time()
    outcome = fuzz.tried(reader, b"x", tmp_path, seconds=0.1)
    assert outcome.kind == "faults"
    assert text in outcome.text
    assert time.process_time() - began < 3
