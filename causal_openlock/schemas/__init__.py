"""Schemas: the graph, the machine that it compiles into, and schemas as text.

=============== ===================================================================================
``schema``      The directed graph of levers and a door, and the solutions that follow from it.
``fsm``         The finite state machine that a schema compiles into.
``schema_file`` Schema files: YAML, with the line of every fault.
``one_line``    A schema as one line: ``A -> B, C; B | C -> door``.
``bayes_net``   The Bayesian network of one push per lever, for pgmpy.
``graphs``      All formats (``FORMATS``): JSON, GML, GraphML, DOT, DAGitty, BIF.
``declared``    A schema from any of these, a graph or edges, in Python.
``finding``     Schemas by name or by a path of any of these formats; those of the package.
=============== ===================================================================================
"""
