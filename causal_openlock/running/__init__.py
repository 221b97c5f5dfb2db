"""Running an experiment: its missing cells are played, by any number of processes, after any kill.

=============== ===========================================================================
``runner``      Plays the cells that are missing.
``workers``     The processes that play cells, this process, or an executor.
``worker``      Plays one cell, from its checkpoint if there is one.
``cluster``     The workers of a Dask cluster.
``checkpoint``  The state of an unfinished cell, on disk.
``progress``    The share of a comparison that is done, and the time left.
``tensorboard`` Curves while cells are played.
=============== ===========================================================================
"""
