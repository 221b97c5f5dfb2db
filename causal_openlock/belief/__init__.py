"""Bayesian beliefs about causal structure: hypotheses, posteriors, policies.

Hypotheses and their prior
    :mod:`~causal_openlock.belief.structures` (gate-DAGs as arrays),
    :mod:`~causal_openlock.belief.grammar` (schema classes of any size),
    :mod:`~causal_openlock.belief.catalogue` (the behaviours of n levers),
    :mod:`~causal_openlock.belief.hypotheses` (about one room, strengths included),
    :mod:`~causal_openlock.belief.sampling` (where there are too many to list).

Inference
    :mod:`~causal_openlock.belief.likelihoods` (events and their likelihood),
    :mod:`~causal_openlock.belief.knowledge` (parameters of the prior, and what is carried from room
    to room), :mod:`~causal_openlock.belief.beliefs` (the posteriors of many subjects).

Policies
    :mod:`~causal_openlock.belief.planning` (plans by expected information gain and chance to solve;
    Thompson sampling).

Inspection
    :mod:`~causal_openlock.belief.belief_learner` (base class of learners that hold beliefs),
    :mod:`~causal_openlock.belief.marginals` (edges, most probable structure, interventions),
    :mod:`~causal_openlock.belief.structure_schemas` (structures as schemas, in words),
    :mod:`~causal_openlock.belief.trace` (one trial).

Bounds
    :mod:`~causal_openlock.belief.optimal` (least expected attempts of an ideal observer, on
    :mod:`~causal_openlock.belief.placements`),
    :mod:`~causal_openlock.belief.worth` (what knowing the schema saves, among
    :mod:`~causal_openlock.belief.possible_schemas`).
"""
