"""Running an experiment: its missing cells are played, by any number of processes, after any kill.

================= =================================================================================
``runner``        Plays the cells that are missing.
``workers``       The processes that play cells.
``worker``        Plays one cell, from its checkpoint if there is one.
``cluster``       The workers of a Dask cluster.
``carried_code``  A user's learners, copied to where the workers are.
``checkpoint``    The state of an unfinished cell, on disk.
``progress``      The share of a comparison that is done, and the time left.
``status``        The same, read from a results folder.
``tensorboard``   Curves while cells are played.
================= =================================================================================
"""
