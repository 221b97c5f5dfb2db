"""Figures in the paper's form, and what all figures share: results in, matplotlib axes out.

A figure that is of one idea is with its numbers (:mod:`causal_openlock.analysis.topics`).

A plot function takes results (:class:`~causal_openlock.analysis.results.material.Material`) first
and ``ax`` last (:mod:`~causal_openlock.analysis.plots.panels`), and draws in the style that is in
use (:mod:`~causal_openlock.analysis.plots.style`). The report, the command line and notebooks call
the same functions.
"""
