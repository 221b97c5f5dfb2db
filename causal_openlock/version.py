"""The version of the toolkit, and that of its results."""

__version__ = "0.2.0"

RESULTS_VERSION = "0.3.0+8"
"""Part of every cell's identity. The number after the plus is raised when an experiment gives
other results than before within one version, so that old and new cells are never mixed."""
