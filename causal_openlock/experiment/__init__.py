"""Who plays what, and what is kept of it.

================= =================================================================================
``protocol``      Conditions and protocols: which rooms, which budgets.
``session``       B subjects walk through a condition with one learner.
``record``        The record: one row for each attempt.
``experiment``    Learners × conditions × subjects, cut into cells.
``file``          Experiment files: YAML in.
``stored``        ``experiment.json`` in a results folder, read into typed objects.
``store``         A results folder: the cells that are done, checked.
``runner``        Plays the cells that are missing.
``workers``       The processes that cells are played in.
``worker``        Plays one cell, from its checkpoint if there is one.
``checkpoint``    How far a cell has come, on disk.
``standing``      How far a comparison is, by work done.
``expected_cost`` What learners will cost, before they play.
``learner_check`` A few steps with a new learner, to see whether it keeps the contract.
``tensorboard``   Curves while cells are played.
``json_schemas``  The JSON Schemas that editors use.
================= =================================================================================
"""
