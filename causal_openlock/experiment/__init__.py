"""Experiments: conditions, protocols, sessions, and the record of what was done.

================= =================================================================================
``declare``       What an experiment is: protocols, conditions, learners, cells.
``making``        Declaring one in Python, and changing what a file declares.
``file``          Experiment files: YAML in.
``origin``        The code of a learner, which distinguishes results.
``plan``          The trials of a subject, drawn from its condition and protocol.
``session``       B subjects play the trials of a condition.
``record``        The record: one row for each attempt.
``beside_record`` What people said and how long they took: tables next to the record.
================= =================================================================================
"""
