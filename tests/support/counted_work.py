"""How much work something is, counted: the same on every machine, however busy it is."""

import sys


def calls(work):
    """How many functions are called while it is done, those written in C included."""
    count = 0

    def called(frame, event, argument):
        nonlocal count
        count += event in ("call", "c_call")

    before = sys.getprofile()
    sys.setprofile(called)
    try:
        work()
    finally:
        sys.setprofile(before)
    return count
