"""The report: a record with its experiment in; a page, ``summary.csv``, tables and figures out.

``writing`` has every topic describe the results (:mod:`causal_openlock.analysis.topic`) and writes
the page. What is here stands around the topics: learners, warnings, what was run; and the page on
two results (``difference_page``).
"""
