"""Processes that begin with everything imported, which is what takes the time of a fresh one.

They are forked from a process that has done nothing but import, so they are as fresh as those that
comparisons start, whose imports take a second and more.
"""

import multiprocessing

IMPORTED = [
    "pytest",
    "torch",
    "causal_openlock.running.runner",
    "causal_openlock.running.worker",
    "openlock_learners.bayes",
    "openlock_learners.ideal",
    "openlock_learners.networks.double_q",
    "openlock_learners.recurrent",
]
_get_context = multiprocessing.get_context


def prepared():
    """How such processes are started, as :func:`multiprocessing.get_context` says it."""
    context = _get_context("forkserver")
    context.set_forkserver_preload(IMPORTED)
    return context


def start_prepared(patches):
    """Have such processes started wherever fresh ones are asked for."""

    def get_context(method=None):
        return prepared() if method == "spawn" else _get_context(method)

    patches.setattr(multiprocessing, "get_context", get_context)
