"""Characters that the output cannot encode are replaced by plainer ones.

Messages have dashes and arrows in them, and labels and paths any characters. Where the system's
encoding is ASCII (``LANG=C``, a batch system's log), printing them must not fail.
"""

from __future__ import annotations

import codecs
import io
import sys

PLAINER = str.maketrans(
    {
        **dict.fromkeys("‐‑‒–—―−─━╸╺", "-"),
        **dict.fromkeys("‘’‚′", "'"),
        **dict.fromkeys("“”„″", '"'),
        **dict.fromkeys("•·", "*"),
        **dict.fromkeys("\u00a0\u2009\u202f", " "),
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


def _plainer(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    text = error.object[error.start : error.end].translate(PLAINER)
    return text.encode("ascii", "backslashreplace").decode("ascii"), error.end


def write_anything() -> None:
    """Make standard output and standard error replace what they cannot encode."""
    codecs.register_error("causal_openlock.plainer", _plainer)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="causal_openlock.plainer")
