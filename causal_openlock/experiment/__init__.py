"""Experiments: conditions, sessions, records, and their cells on disk.

================= =================================================================================
``protocol``      Conditions and protocols: which rooms, which budgets.
``session``       B subjects play the trials of a condition.
``record``        The record: one row for each attempt.
``experiment``    Learners × conditions × subjects, cut into cells.
``file``          Experiment files: YAML in.
``stored``        ``experiment.json`` in a results folder, read into typed objects.
``store``         A results folder: the cells that are done, checked.
``runner``        Plays the cells that are missing.
``workers``       The processes that play cells.
``cluster``       The workers of a Dask cluster.
``carried_code``  A user's learners, copied to where the workers are.
``shard``         A fixed share of the cells, for a job array.
``worker``        Plays one cell, from its checkpoint if there is one.
``checkpoint``    The state of an unfinished cell, on disk.
``progress``      The share of a comparison that is done, and the time left.
``status``        The same, read from a results folder.
``expected_cost`` Estimates of what learners will cost.
``learner_check`` A few steps with a new learner, to check two parts of the contract.
``tensorboard``   Curves while cells are played.
``json_schemas``  The JSON Schemas that editors use.
================= =================================================================================
"""
