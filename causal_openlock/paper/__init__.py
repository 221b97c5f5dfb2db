"""The paper's own results, tests and figures: what is published, and how learners compare with it.

A guest of the toolkit: references, topics of the report and a figure are registered as entry points
(:mod:`causal_openlock.files.plugins`), and the core imports nothing from here.
"""
