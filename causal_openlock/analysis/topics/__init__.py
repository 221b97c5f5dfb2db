"""The topics of the report: modules with a ``TOPIC``; see :mod:`causal_openlock.analysis.topic`."""
