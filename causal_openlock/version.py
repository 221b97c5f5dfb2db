"""The version of the toolkit; a cell's identity depends on it."""

__version__ = "0.2.0"
