"""Experiments: their declaration, the trials of a subject, sessions, and the record of them."""
