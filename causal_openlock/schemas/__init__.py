"""Schemas: the graph, the machine that it compiles into, and schemas in files and as text."""
