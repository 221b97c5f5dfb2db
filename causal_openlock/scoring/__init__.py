"""Scoring: how well learners predict what a subject does next, action by action.

Means over trials cannot tell many theories apart; single actions can. A learner that gives the
probabilities of its actions
(:meth:`~causal_openlock.contract.learner.Learner.probabilities`) is put in a subject's place: it
sees what the subject saw, says how likely each action is, and is then shown what the subject did
and the result (:mod:`~causal_openlock.scoring.teacher_forcing`). The logarithms of the
probabilities of what was done are its score (:mod:`~causal_openlock.scoring.scores`).
"""

LAPSE = 0.01  #: default share of actions that are taken to be random
