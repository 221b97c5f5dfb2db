"""Waiting for something to happen in another process, and telling a hang from a slow machine."""

import time

HANGS = 600
"""Seconds after which a wait is taken for a hang; nothing is said of speed by that."""


def until(happens, going=None):
    """Wait until something is true, and a process that has to go on until then is going."""
    waited = 0.0
    while not happens():
        assert going is None or going.poll() is None, "the process ended before it happened"
        assert waited < HANGS, "it does not happen"
        time.sleep(0.01)
        waited += 0.01
