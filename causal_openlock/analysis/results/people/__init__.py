"""Beside people: what is published, the paper's tests, and how like people a learner is."""
