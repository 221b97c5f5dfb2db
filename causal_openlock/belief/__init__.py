"""Beliefs about causal structure: hypotheses, evidence, plans.

From a grammar to a decision, one module each:
:mod:`~causal_openlock.belief.structures` (gate-DAGs as arrays),
:mod:`~causal_openlock.belief.grammar` (schema classes of any size),
:mod:`~causal_openlock.belief.catalogue` (what n levers can do, alike behaviours merged),
:mod:`~causal_openlock.belief.strength` (how surely levers move),
:mod:`~causal_openlock.belief.space` (the hypotheses about a room),
:mod:`~causal_openlock.belief.evidence` (likelihoods),
:mod:`~causal_openlock.belief.knowledge` (what is carried from room to room),
:mod:`~causal_openlock.belief.beliefs` (many subjects' posteriors),
:mod:`~causal_openlock.belief.planning` (what an action is worth),
:mod:`~causal_openlock.belief.insight` (looking inside).
"""
