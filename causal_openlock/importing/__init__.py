"""Data in: what was played elsewhere becomes a results folder, once it has been played again.

A file says who did what. Rows are read from one of three forms: this project's own CSV, a table
with a row for each action (both in :mod:`~causal_openlock.importing.csv_tables`), or what jsPsych
saves (:mod:`~causal_openlock.importing.jspsych`). Then every action is taken once more, in the room
that the file names (:mod:`~causal_openlock.importing.replaying`): the record is what the room
answers, and what the file says came of an action must be that. A row that could not have happened
is named with its line, and nothing is written (:mod:`~causal_openlock.importing.folder`).
"""
