"""Schemas as text: the YAML that declares them, and the formats of other graph software."""
