"""A comparison from Python and on the command line: run it, look at it, keep it."""
