"""Printing of plain text: all text that a command prints goes through here or ``console``.

Labels, titles and messages of exceptions may come from anybody, so control characters in them are
spelled out. Messages have dashes and arrows in them, and labels and paths any characters. Where the
system's encoding is ASCII (``LANG=C``, a batch system's log), printing them must not fail:
characters that it does not have are replaced by plainer ones (:func:`write_anything`).
"""

from __future__ import annotations

import codecs
import io
import sys
import warnings
from typing import Any

from causal_openlock.files.escaping import printable

PLAINER = str.maketrans(
    {
        **dict.fromkeys("‐‑‒–—―−─━╸╺", "-"),
        **dict.fromkeys("‘’‚′", "'"),
        **dict.fromkeys("“”„″", '"'),
        **dict.fromkeys("•·", "*"),
        **dict.fromkeys("\u00a0\u2009\u202f", " "),
        **dict.fromkeys("►▶", ">"),
        **{"²": "^2", "³": "^3", "≈": "~", "∞": "inf", "✓": "yes", "✗": "no"},
        **{"α": "alpha", "β": "beta", "ε": "epsilon", "η": "eta", "σ": "sigma"},
        "→": "->",
        "←": "<-",
        "↔": "<->",
        "…": "...",
        "×": "x",
        "√": "sqrt",
        "±": "+-",
        "≤": "<=",
        "≥": ">=",
        "≠": "!=",
        "│": "|",
    }
)


def say(text: object = "", *, error: bool = False, end: str = "\n") -> None:
    """Print text on standard output, or on standard error."""
    print(printable(text), end=end, file=sys.stderr if error else sys.stdout)


def complain(message: str) -> None:
    """Print an error on standard error, line by line."""
    for line in printable(message).split("\n"):
        say(f"error: {line}", error=True)


def _plainer(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(PLAINER)
    return text.encode("ascii", "backslashreplace").decode("ascii"), error.end


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
    """Make standard output and standard error replace what they cannot encode."""
    codecs.register_error("causal_openlock.plainer", _plainer)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="causal_openlock.plainer")
