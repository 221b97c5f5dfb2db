"""Experiments: conditions, protocols, sessions, and the record of what was done.

==================== ==============================================================================
``protocol``         Conditions and protocols: which rooms, which budgets.
``experiment``       Learners × conditions × subjects, cut into cells.
``building``         Names, classes and objects become conditions and learners.
``sweeps``           A learner once for each value of a parameter.
``file_format``      What an experiment file may hold.
``file``             Experiment files: YAML in.
``json_schemas``     The JSON Schemas that editors use.
``session``          B subjects play the trials of a condition.
``record``           The record: one row for each attempt.
``answers``          What people said of a room: a table next to the record.
``reactions``        How long people took over each action: a table next to the record.
``paper_conditions`` Which conditions are the paper's, by their rooms.
==================== ==============================================================================
"""
