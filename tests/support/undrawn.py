"""Commands one after the other in a process of its own, where figures are saved empty.

``python -m support.undrawn compare … THEN report …``; the status of each is a line of standard
error, in brackets.
"""

from __future__ import annotations

import sys

from causal_openlock.analysis.plots import style
from causal_openlock.cli import main
from support.figures import save_empty

THEN = "THEN"

if __name__ == "__main__":
    style.save = save_empty
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
