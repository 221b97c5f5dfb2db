"""Learners with many attempts in a trial, and what agrees with the paper's deep learners."""
