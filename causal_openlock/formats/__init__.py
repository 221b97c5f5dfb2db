"""Schemas as text.

=============== ===================================================================================
``schema_file`` YAML in and out, with the line of every fault; schemas by name.
``graphs``      Node-link JSON, GML, DOT, DAGitty; Bayesian networks of pgmpy.
``dot``         The text of DOT and DAGitty.
=============== ===================================================================================
"""
