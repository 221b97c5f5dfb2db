"""Schemas as text.

:mod:`~causal_openlock.formats.schema_file` (the project's YAML),
:mod:`~causal_openlock.formats.graphs` (JSON, GML, DOT, DAGitty, BIF, and pgmpy networks) and
:mod:`~causal_openlock.formats.dot` (the parser of DOT and DAGitty).
"""
