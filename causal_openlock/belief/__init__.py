"""Bayesian beliefs about causal structure, module after module.

What may be: ``structures`` (gate-DAGs as arrays), ``grammar`` (schema classes of any size),
``catalogue`` (behaviours of n levers), ``hypotheses`` (about one room), ``sampling`` (where there
are too many to list). What is believed: ``likelihoods`` (of events), ``knowledge`` (carried from
room to room), ``beliefs`` (of many subjects). What is done: ``planning``, ``intentions`` (Thompson
sampling). What is shown: ``belief_learner`` (base class of learners that hold beliefs),
``marginals`` (edges, interventions), ``structure_schemas`` (in words), ``trace`` (one trial). What
is best: ``optimal`` (least expected attempts) on ``placements``, ``observer`` (regret), ``worth``
(of knowing the schema).
"""
