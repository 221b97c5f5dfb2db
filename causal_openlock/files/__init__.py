"""Reading and writing files safely.

:mod:`~causal_openlock.files.atomic` (files that are complete or absent),
:mod:`~causal_openlock.files.checksums` (Parquet and JSON that carry their SHA-256),
:mod:`~causal_openlock.files.seal` (signatures of pickles that this user has written),
:mod:`~causal_openlock.files.yaml_file` and :mod:`~causal_openlock.files.validation` (YAML written
by hand, with the line of each fault),
:mod:`~causal_openlock.files.decoding` and :mod:`~causal_openlock.files.json_text` (text and JSON of
other programs),
:mod:`~causal_openlock.files.escaping` (untrusted text in terminals and CSV),
:mod:`~causal_openlock.files.notebooks` (lessons without their outputs),
:mod:`~causal_openlock.files.plugins` (what packages register) and
:mod:`~causal_openlock.files.compiling` (the folder for what numba compiles).
"""
