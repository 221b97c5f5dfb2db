"""Reading and writing files safely.

:mod:`~causal_openlock.files.atomic` (files that are complete or absent),
:mod:`~causal_openlock.files.checksums` (Parquet and JSON in which damage is found),
:mod:`~causal_openlock.files.seal` (signatures for what needs pickle),
:mod:`~causal_openlock.files.yaml_file` and :mod:`~causal_openlock.files.validation` (YAML written
by hand, with the line of each fault),
:mod:`~causal_openlock.files.escaping` (untrusted text in terminals and CSV),
:mod:`~causal_openlock.files.plugins` (what packages register) and
:mod:`~causal_openlock.files.compiling` (loops compiled by numba).
"""
