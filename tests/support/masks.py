"""What a printed text has that differs at each run, taken out of it."""

from __future__ import annotations

import re
from pathlib import Path

from causal_openlock.version import __version__

PATTERNS = {
    r"\d+:\d\d:\d\d": "<time>",
    r"\d{4}-\d\d-\d\d(?:T<time>\S*)?": "<date>",
    r"\b\d+(?:\.\d+)? (?:s|min|h|seconds?|minutes?|hours?)\b": "<time>",
    r"\b[0-9a-f]{8,64}\b": "<digest>",
}


def masked(text: str, *folders: Path, more: dict[str, str] | None = None) -> str:
    """Put words for folders, times, dates, digests and this version; `more` are other patterns."""
    for folder in folders:
        text = text.replace(str(folder), "<folder>")
    text = text.replace(__version__, "<version>")
    for pattern, word in (PATTERNS | (more or {})).items():
        text = re.sub(pattern, word, text)
    return text
