"""What a printed text has that differs at each run, taken out of it."""

import re

PATTERNS = {
    r"\d+:\d\d:\d\d": "<time>",
    r"\d{4}-\d\d-\d\d(?:T<time>\S*)?": "<date>",
    r"\b\d+(?:\.\d+)? (?:s|min|h|seconds?|minutes?|hours?)\b": "<time>",
    r"\b[0-9a-f]{8,64}\b": "<digest>",
    r"\b\d+\.\d+\.\d+(?:\+\w+)?": "<version>",
    r"\b\d+\.\d MB": "<size>",
    r"[\d,]+ actions/s": "<speed>",
}


def masked(text, *folders, more=None):
    """Put words for folders, times, dates, digests and versions; `more` are other patterns."""
    for folder in folders:
        text = text.replace(str(folder), "<folder>")
    for pattern, word in (PATTERNS | (more or {})).items():
        text = re.sub(pattern, word, text)
    return text
