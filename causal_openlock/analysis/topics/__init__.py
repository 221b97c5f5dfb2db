"""The topics of the report, a file for each; see :mod:`causal_openlock.analysis.topic`.

To add one, write ``NAME.py`` here, and name it in :data:`MODULES`.
"""

MODULES = (
    "learning_cost",
    "survival",
    "solution_costs",
    "regret",
    "structure_recovery",
    "language_models",
    "transfer",
    "pairwise",
    "learning",
    "reward_study",
    "belief_traces",
)  #: modules of this package, each with a ``TOPIC``
