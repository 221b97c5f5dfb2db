"""Printing of plain text: all text that a command prints goes through here or ``console``.

Labels, titles and messages of exceptions may come from anybody, so control characters in them are
spelled out. Messages have dashes and arrows in them, and labels and paths any characters. Where the
encoding lacks one of them (ASCII), a question mark is printed instead (:func:`write_anything`).
"""

from __future__ import annotations

import io
import sys
import warnings
from typing import Any

from causal_openlock.files.escaping import printable


def say(text: object = "", *, error: bool = False, end: str = "\n") -> None:
    """Print text on standard output, or on standard error."""
    print(printable(text), end=end, file=sys.stderr if error else sys.stdout)


def complain(message: str) -> None:
    """Print an error on standard error, line by line."""
    for line in printable(message).split("\n"):
        say(f"error: {line}", error=True)


def warn_in_a_line() -> None:
    """Make Python print warnings for users as a sentence, without the line of code."""
    python_prints = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *where: Any, **options: Any) -> None:
        if category is UserWarning:
            say(f"warning: {message}", error=True)
        else:
            python_prints(message, category, *where, **options)

    warnings.showwarning = show


def write_anything() -> None:
    """Have standard output and standard error print ``?`` for what they cannot encode."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
