"""Output that cannot encode a character: a plainer one is written in its place.

What is printed has dashes and arrows in it, and labels and paths have whatever their authors like.
Where the system's encoding is ASCII (``LANG=C``, a batch system's log), that is no reason to end.
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
    """Have standard output and standard error write what they cannot encode in plainer signs."""
    codecs.register_error("causal_openlock.plainer", _plainer)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="causal_openlock.plainer")
