"""Spoiled files for every reader of the toolkit: does one end in anything but a sentence?

Real files of each kind are changed at random (``fuzz_mutations.py``) and read
(``fuzz_readers.py``). A reader may read the file, or refuse it with an
:class:`~causal_openlock.errors.OpenLockError`. A *fault* is any other exception, more than 5
seconds of the processor, more than 500 MB, or the end of the process.

Input N is the same whenever and wherever it is made, so a run is resumed, or shared among
machines, by the range of numbers, and a fault is looked at again by its number::

    python benchmarks/fuzz.py --inputs 100000
    python benchmarks/fuzz.py --first 100000 --inputs 100000
    python benchmarks/fuzz.py --first 4711 --inputs 1 --keep faults

Readers run in a process of their own. Where it hangs or ends, another one goes on behind the input
that was the reason.
"""

from __future__ import annotations

import argparse
import multiprocessing
import random
import resource
import signal
import sys
import time
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from fuzz_readers import Reader

MOST_SECONDS = 5.0
"""Of the processor, since others may be at work on the machine."""
MOST_WAIT = 60.0
"""Seconds after which the process is ended from outside."""
MOST_BYTES = 500 << 20
READ, REFUSED, FAULT = "read", "refused", "faults"


class Hang(BaseException):
    """An input took too long; no reader takes it for an error of the file."""


class Outcome(NamedTuple):
    """What came of an input."""

    number: int
    reader: str
    kind: str
    seconds: float = 0.0
    memory: int = 0  #: bytes
    text: str = ""  #: of a fault: what it is, and the traceback


@dataclass
class Tally:
    """What came of the inputs of one reader."""

    share: int
    read: int = 0
    refused: int = 0
    faults: int = 0
    slowest: float = 0.0
    memory: int = 0

    def add(self, one: Outcome) -> None:
        """Count an input."""
        setattr(self, one.kind, getattr(self, one.kind) + 1)
        self.slowest = max(self.slowest, one.seconds)
        self.memory = max(self.memory, one.memory)


def main() -> int:
    """Read spoiled files and count; returns 1 if there was a fault."""
    asked = argparse.ArgumentParser(description="Spoiled files for every reader.")
    asked.add_argument("--inputs", type=int, default=100_000, help="how many")
    asked.add_argument("--first", type=int, default=0, help="number of the first")
    asked.add_argument("--seed", type=int, default=0, help="another seed makes other inputs")
    asked.add_argument("--only", default="", help="readers whose names hold this, in equal shares")
    asked.add_argument("--keep", type=Path, help="a folder for the files of faults")
    given = asked.parse_args()
    tallies: dict[str, Tally] = {}
    began, next_ = time.monotonic(), given.first
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        last = given.first + given.inputs
        for one in supervised(given.first, last, given.seed, given.keep, given.only):
            if isinstance(one, dict):
                if not one:
                    asked.error(f"no reader's name holds {given.only!r}")
                tallies = tallies or {name: Tally(share) for name, share in one.items()}
                continue
            next_ = one.number + 1
            tallies[one.reader].add(one)
            if one.kind == FAULT:
                print(f"input {one.number}, {one.reader}: {one.text}", flush=True)
            if next_ % 5000 == 0:
                print(f"{next_:,} after {time.monotonic() - began:,.0f} s", file=sys.stderr)
    except KeyboardInterrupt:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        print(f"stopped; go on with --first {next_}")
    print(f"{next_ - given.first:,} inputs from {given.first:,} on, seed {given.seed}, "
          f"{time.monotonic() - began:,.0f} s\n{table(tallies)}")  # fmt: skip
    return int(any(tally.faults for tally in tallies.values()))


def table(tallies: dict[str, Tally]) -> str:
    """What came of all inputs, by reader."""
    heads = ("inputs", READ, REFUSED, FAULT, "slowest", "memory")
    rows = [f"{'reader':18} {'share':>6}" + "".join(f"{head:>9}" for head in heads)]
    for name, one in tallies.items():
        counts = (one.read + one.refused + one.faults, one.read, one.refused, one.faults)
        numbers = "".join(f"{count:9,}" for count in counts)
        rows.append(
            f"{name:18} {one.share:5}%{numbers} {one.slowest:6.2f} s {one.memory >> 20:5} MB"
        )
    return "\n".join(rows)


# -- a process of its own -------------------------------------------------------------------------


def supervised(
    first: int, last: int, seed: int, keep: Path | None, only: str
) -> Iterator[dict[str, int] | Outcome]:
    """The shares of the readers, and then what came of each input; shares again after a restart."""
    spawn = multiprocessing.get_context("spawn")
    while first < last:
        here, there = spawn.Pipe(duplex=False)
        process = spawn.Process(
            target=_work, args=(there, first, last, seed, keep, only), daemon=True
        )
        process.start()
        there.close()
        shares = here.recv()
        yield shares
        while first < last:
            why = f"nothing for {MOST_WAIT:g} seconds"
            try:
                if here.poll(MOST_WAIT):
                    yield here.recv()
                    first += 1
                    continue
            except EOFError:
                process.join()
                why = f"the process ended with status {process.exitcode}"
            process.kill()
            yield Outcome(first, reader_of(first, shares), FAULT, text=why)
            first += 1
            break
        process.join()


def _work(tell: Connection, first: int, last: int, seed: int, keep: Path | None, only: str) -> None:
    from fuzz_readers import readers

    with TemporaryDirectory() as folder:
        work = Path(folder)
        known = {one.name: one for one in readers(work)}
        shares = {name: 1 if only else one.share for name, one in known.items() if only in name}
        tell.send(shares)
        for number in range(first, last):
            reader = known[reader_of(number, shares)]
            content = spoiled(reader, number, seed)
            if keep and last - first == 1:
                _keep(keep, number, reader, content)
            outcome = tried(reader, content, work, number)
            if keep and outcome.kind == FAULT:
                _keep(keep, number, reader, content)
            tell.send(outcome)


def _keep(folder: Path, number: int, reader: Reader, content: bytes) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{number}_{Path(reader.place).name}").write_bytes(content)


# -- one input ------------------------------------------------------------------------------------


def reader_of(number: int, shares: dict[str, int]) -> str:
    """The reader of an input: any hundred in succession have all of them by their shares."""
    dealt = [name for name, share in shares.items() for _ in range(share)]
    return dealt[number * 37 % len(dealt)]  # 37 and 100 have no common factor


def spoiled(reader: Reader, number: int, seed: int = 0) -> bytes:
    """The input of that number."""
    rng = random.Random(f"{seed} {number}")
    return reader.spoil(rng.choice(reader.corpus), rng)


def tried(
    reader: Reader, content: bytes, work: Path, number: int = 0, seconds: float = MOST_SECONDS
) -> Outcome:
    """Put a file in its place and read it."""
    from causal_openlock.errors import OpenLockError

    path = work / reader.place
    path.write_bytes(content)
    before, began = _resident(), time.process_time()
    kind, text = READ, ""
    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        reader.read(work)
    except OpenLockError as error:
        kind = REFUSED
        if not str(error).strip():
            kind, text = FAULT, "an error without a sentence"
    except Hang:
        kind, text = FAULT, f"more than {seconds:g} seconds\n{traceback.format_exc()}"
    except Exception as error:
        kind, text = FAULT, f"{type(error).__name__}\n{traceback.format_exc()}"
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    took, memory = time.process_time() - began, max(0, _peak() - before)
    if memory > MOST_BYTES:
        kind, text = FAULT, f"{memory >> 20} MB"
    return Outcome(number, reader.name, kind, took, memory, text)


def _stop(*_: Any) -> None:
    raise Hang


def _resident() -> int:
    """Bytes of memory in use; from now on :func:`_peak` is the most since."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:  # then the peak is that of the whole process, which is no less
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
    return _status("VmRSS")


def _peak() -> int:
    try:
        return _status("VmHWM")
    except OSError:
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10


def _status(name: str) -> int:
    text = Path("/proc/self/status").read_text()
    return int(text.partition(f"{name}:")[2].split()[0]) << 10


if __name__ == "__main__":
    sys.exit(main())
