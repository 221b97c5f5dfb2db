"""A comparison from Python: run it, look at it, keep it.

- :mod:`~causal_openlock.comparison.comparing`: :func:`compare`, which runs what it is given.
- :mod:`~causal_openlock.comparison.results`: :class:`Results`, with tables, plots and the report.
- :mod:`~causal_openlock.comparison.console`: tables as text, above all the leaderboard.
- :mod:`~causal_openlock.comparison.progress_bar`: the progress of a run.

The command line is made of the same parts.
"""
