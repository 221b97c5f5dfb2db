"""Commands one after the other in one process, which plays all cells and draws figures empty.

``python -m support.undrawn compare … THEN report …``; the status of each is a line of standard
error, in brackets.
"""

from __future__ import annotations

import sys

import pytest

from causal_openlock.analysis.plots import style
from causal_openlock.cli import main
from support.command import play_here
from support.figures import empty

THEN = "THEN"

if __name__ == "__main__":
    style.images = empty
    play_here(pytest.MonkeyPatch())
    words = sys.argv[1:]
    while words:
        end = words.index(THEN) if THEN in words else len(words)
        sys.argv[1:], words = words[:end], words[end + 1 :]
        try:
            main()
            status: object = 0
        except SystemExit as ended:
            status = ended.code or 0
        print(f"[{status}]", file=sys.stderr)
