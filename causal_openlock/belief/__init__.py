"""Beliefs about causal structure: hypotheses, evidence, plans.

From a grammar to a decision, one idea a module:
:mod:`~causal_openlock.belief.lever_sets` (sets of levers, a bit for each),
:mod:`~causal_openlock.belief.structures` (gate-DAGs as arrays),
:mod:`~causal_openlock.belief.grammar` (schema classes of any size),
:mod:`~causal_openlock.belief.catalogue` (what n levers can do, alike behaviours merged),
:mod:`~causal_openlock.belief.strength` (how surely levers move),
:mod:`~causal_openlock.belief.space` (the hypotheses about a room),
:mod:`~causal_openlock.belief.sampling` (hypotheses where there are too many to list),
:mod:`~causal_openlock.belief.steering` (and where hardly any draw keeps the console's promise),
:mod:`~causal_openlock.belief.evidence` (likelihoods),
:mod:`~causal_openlock.belief.knowledge` (what is carried from room to room),
:mod:`~causal_openlock.belief.beliefs` (many subjects' posteriors),
:mod:`~causal_openlock.belief.planning` (what an action is worth),
:mod:`~causal_openlock.belief.intention` (acting on a single hypothesis).

Looking inside: :mod:`~causal_openlock.belief.believer` (learners that let others look),
:mod:`~causal_openlock.belief.insight` (levers and arrows),
:mod:`~causal_openlock.belief.networks` (pgmpy),
:mod:`~causal_openlock.belief.trace`, :mod:`~causal_openlock.belief.story` and
:mod:`~causal_openlock.belief.likeness` (a trial as a table, in words, and beside the truth; the
words are in :mod:`~causal_openlock.belief.words`).

The best that can be done: :mod:`~causal_openlock.belief.placements` (a known schema anywhere),
:mod:`~causal_openlock.belief.symmetry` (levers that are alike) and
:mod:`~causal_openlock.belief.optimal` (the least expected attempts).
"""
