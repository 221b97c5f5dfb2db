"""Data in: what was played elsewhere becomes a results folder, once it has been played again.

A file says who did what: a table with a row for each action, this project's own export, or what
jsPsych saves (:mod:`~causal_openlock.importing.reading`). Every action is taken once more, in the
room that the file names (:mod:`~causal_openlock.importing.replaying`): the record is what the room
answers, and what the file says came of an action must be that. A row that could not have happened
is named with its line, and nothing is written (:mod:`~causal_openlock.importing.folder`).
"""
