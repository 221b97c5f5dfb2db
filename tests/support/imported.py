"""People of CE3 in a results folder, from a table of what they did."""

import itertools

from causal_openlock.importing.folder import import_files

SOLVED = [("LOWERLEFT", "UPPERRIGHT"), ("UPPERLEFT", "UPPERRIGHT")]
"""Levers of the two solutions of CE3 in its first published room."""


def rows(subject, solves, step, start=100.0):
    """A trial of CE3, solved in two attempts or failed in thirty; a row for each action."""
    attempts = SOLVED if solves else [("LOWERLEFT", "LOWERLEFT")] * 30
    acts = [(number, name) for number, two in enumerate(attempts, 1) for name in (*two, "door")]
    return [
        f"{subject},CE3,1,{attempt},push_{name},trial1,{start + step * n}"
        for n, (attempt, name) in enumerate(acts)
    ]


def imported(folder, *people):
    head = "subject,condition,trial,attempt,action,layout,time"
    (folder / "data.csv").write_text("\n".join([head, *itertools.chain(*people)]) + "\n")
    import_files([folder / "data.csv"], folder / "people")
    return folder / "people"
