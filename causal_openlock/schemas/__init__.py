"""Schemas: the graph, the machine that it compiles into, and schemas as text.

=============== ===================================================================================
``schema``      The directed graph of levers and a door, its form, and its solutions.
``fsm``         The finite state machine that a schema compiles into.
``one_line``    A schema as one line: ``A -> B, C; B | C -> door``.
``bayes_net``   The Bayesian network of one push per lever, for pgmpy.
``graphs``      All formats (``FORMATS``): YAML, JSON, GML, GraphML, DOT, DAGitty, BIF.
``finding``     Schemas by name, in a file, as text, graph or edges; those of the package.
=============== ===================================================================================
"""
