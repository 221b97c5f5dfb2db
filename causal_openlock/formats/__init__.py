"""Schemas as text.

=============== ===================================================================================
``schema_file`` YAML in and out, with the line of every fault; schemas by name.
``graphs``      All formats (``FORMATS``): JSON, GML, DOT, DAGitty, BIF; networks of pgmpy.
``dot``         The text of DOT and DAGitty.
=============== ===================================================================================
"""
