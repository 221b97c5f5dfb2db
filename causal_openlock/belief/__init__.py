"""Bayesian beliefs about causal structure: hypotheses, posteriors, policies.

Hypotheses and their prior
    :mod:`~causal_openlock.belief.structures` (gate-DAGs as arrays, on
    :mod:`~causal_openlock.belief.lever_sets`), :mod:`~causal_openlock.belief.grammar` (schema
    classes of any size), :mod:`~causal_openlock.belief.catalogue` (the behaviours of n levers),
    :mod:`~causal_openlock.belief.strength` (how reliably levers move),
    :mod:`~causal_openlock.belief.hypotheses` (about one room),
    :mod:`~causal_openlock.belief.sampling` and :mod:`~causal_openlock.belief.metropolis` (where
    there are too many to list), :mod:`~causal_openlock.belief.prior` (settings).

Inference
    :mod:`~causal_openlock.belief.evidence` (events and their likelihood),
    :mod:`~causal_openlock.belief.posterior` (one subject in one room),
    :mod:`~causal_openlock.belief.knowledge` (what is carried from room to room),
    :mod:`~causal_openlock.belief.beliefs` (many subjects at once).

Policies
    :mod:`~causal_openlock.belief.planning` (expected information gain and chance to solve),
    :mod:`~causal_openlock.belief.thompson` (Thompson sampling).

Inspection
    :mod:`~causal_openlock.belief.belief_learner` (base class of learners that hold beliefs),
    :mod:`~causal_openlock.belief.marginals` (edges, most probable structure),
    :mod:`~causal_openlock.belief.networks` (pgmpy, interventions),
    :mod:`~causal_openlock.belief.structure_schemas` (beside the truth, in words),
    :mod:`~causal_openlock.belief.trace` and :mod:`~causal_openlock.belief.trace_text` (one trial).

Bounds
    :mod:`~causal_openlock.belief.optimal` (least expected attempts of an ideal observer, with
    :mod:`~causal_openlock.belief.placements` and :mod:`~causal_openlock.belief.symmetry`).
"""
