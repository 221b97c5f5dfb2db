"""Errors that users can cause: each text names the remedy, and is printed as it is."""

from __future__ import annotations

import signal
import threading
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

MOST_LISTED = 20


def first_lines(lines: Sequence[str], before: str = "") -> str:
    """The first of many lines, and how many more there are, with ``before`` in front."""
    left = len(lines) - MOST_LISTED
    return "\n".join([*lines[:MOST_LISTED], *([f"{before}and {left:,} more"] if left > 0 else [])])


class OpenLockError(ValueError):
    """Base of all errors that a user of the toolkit can cause and fix.

    As a ``ValueError``, it is collected by pydantic with the faults that pydantic finds itself.
    ``at`` is its place, a path of keys into what was declared, such as ``("edges", "L0", "L3")``;
    ``status`` is what the command line exits with.
    """

    status = 2
    _parts: tuple[OpenLockError, ...] = ()

    def __init__(self, message: str = "", at: tuple[str | int, ...] = ()) -> None:
        super().__init__(message)
        self.at = at

    @property
    def parts(self) -> tuple[OpenLockError, ...]:
        """The errors that this one reports together; itself if it reports one."""
        return self._parts or (self,)

    def _render_traceback_(self) -> list[str]:
        """Traceback in a notebook: the line of the cell, and the sentence."""
        frames = traceback.extract_tb(self.__traceback__)
        own = [frame for frame in frames if not Path(frame.filename).is_file()]
        where = [f"line {frame.lineno}: {frame.line}" for frame in own[:1]]
        return [*where, f"{type(self).__name__}: {self}"]


class Interrupted(OpenLockError):  # noqa: N818 - it is none
    """The user has stopped the work."""

    status = 130

    def _render_traceback_(self) -> list[str]:
        """Traceback in a notebook: only the sentence, since nothing went wrong."""
        return [str(self)]


class Stopped(KeyboardInterrupt):
    """A signal has asked the process to end: Ctrl-C, or SIGTERM of a batch system."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class EvidenceError(OpenLockError):
    """A study that does not exist, has not been run, or no longer fits what was run."""


class SchemaError(OpenLockError):
    """A schema that has no meaning."""


class LearnerError(OpenLockError):
    """An unknown learner, a wrong hyper-parameter, or an action outside the action space."""


class NotAvailableError(LearnerError):
    """An external resource of a learner is missing now: a server, a key, tokens of a budget.

    Its cell ends, and is tried again by the next command, however often that happens.
    """


class CellsFailed(LearnerError):  # noqa: N818 - the others did not
    """Cells could not be played; all others are done.

    ``reasons`` has a sentence for each of them, ``summary`` says how many they are and what to do,
    and ``every`` is whether no cell of the experiment was played.
    """

    status = 1

    def __init__(self, reasons: Iterable[str], cells: int) -> None:
        self.reasons = tuple(reasons)
        self.every = len(self.reasons) == cells
        some = f"{len(self.reasons):,} of {cells:,} cells failed, and all others are done"
        self.summary = (
            f"{'every cell failed' if self.every else some}; fix or remove the failing learners "
            "and run the same command again; only missing cells are played"
        )
        super().__init__(f"{first_lines(self.reasons)}\n{self.summary}")


class ExperimentError(OpenLockError):
    """An experiment that cannot be played, for one of its protocols, layouts or rewards."""


class StoreError(OpenLockError):
    """A results folder that cannot be used."""


class NothingToDrawError(OpenLockError):
    """A figure that the results hold nothing for."""


@dataclass(frozen=True)
class Fault:
    """One fault in a file; line and column count from 1."""

    line: int
    column: int
    message: str


class FileError(OpenLockError):
    """One or more faults in a file: a line for each of the first twenty, with its place."""

    def __init__(self, path: Path | str, faults: Iterable[Fault]) -> None:
        self.path = str(path)
        self.faults = tuple(sorted(faults, key=lambda fault: (fault.line, fault.column)))
        lines = [
            f"{self.path}:{fault.line}:{fault.column}: {' '.join(fault.message.splitlines())}"
            for fault in self.faults
        ]
        super().__init__(first_lines(lines, f"{self.path}: "))

    def __reduce__(self) -> tuple[type[FileError], tuple[str, tuple[Fault, ...]]]:
        return FileError, (self.path, self.faults)


def together(errors: Sequence[OpenLockError]) -> OpenLockError:
    """One error for several, with a line for each.

    >>> both = together([SchemaError("no door"), SchemaError("no lever")])
    >>> type(both).__name__, str(both).splitlines()
    ('SchemaError', ['no door', 'no lever'])
    """
    by_text = {str(error): error for error in errors}
    first = errors[0]
    if len(by_text) == 1:
        return first
    kinds = {type(error) for error in errors}
    kind = type(first) if len(kinds) == 1 and kinds != {FileError} else OpenLockError
    made = kind(first_lines([*by_text]), first.at)
    made._parts = tuple(part for error in errors for part in error.parts)
    return made


def in_short(error: BaseException) -> str:
    """An error's text on a line: 200 characters of a stranger's; empty if it fails to give one."""
    try:
        text = " ".join(str(error).encode(errors="backslashreplace").decode().split())
    except Exception:  # a user's class can fail in any way
        return ""
    if isinstance(error, OpenLockError):
        return text[:2000]
    return text if len(text) <= 200 else f"{text[:200].rpartition(' ')[0] or text[:199]} …"


def with_kind(error: BaseException) -> str:
    """An error's type and, if it has one, its text on a line.

    >>> with_kind(ValueError("no lever")), with_kind(KeyboardInterrupt())
    ('ValueError: no lever', 'KeyboardInterrupt')
    """
    what = f"{type(error).__name__}: {in_short(error)}".removesuffix(": ")
    if isinstance(error, ValueError) and "is read-only" in what:
        what += "; what is given to your code cannot be changed: work on a copy, array.copy()"
    return what


def is_stop(error: BaseException) -> bool:
    """Whether an error is Ctrl-C or SIGTERM, rather than one that a user's code raises itself.

    The command line's Ctrl-C is :class:`Stopped`. Python's own cannot be told from a
    ``KeyboardInterrupt`` of the code, and is taken for Ctrl-C where that can arrive.
    """
    can_arrive = threading.current_thread() is threading.main_thread()
    is_pythons = can_arrive and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    return isinstance(error, KeyboardInterrupt if is_pythons else Stopped)


@contextmanager
def failures_as(kind: type[OpenLockError], what: str, remedy: str = "") -> Iterator[None]:
    """A block that runs a user's code: whatever it raises becomes an error of a kind.

    Its message is what fails with the verb, the reason in parentheses, and the remedy. An
    OpenLockError of the code stays as it is.
    """
    try:
        yield
    except OpenLockError:
        raise
    except BaseException as error:  # SystemExit is one of them
        if is_stop(error):
            raise
        raise kind(f"{what} ({with_kind(error)}){remedy}") from error
