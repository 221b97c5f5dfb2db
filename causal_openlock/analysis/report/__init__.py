"""The report: a record with its experiment in; a page, ``summary.csv``, tables and figures out.

``writing`` has every topic compute (:mod:`causal_openlock.analysis.topic`), decides what is found,
and renders the page. What is here is what stands around the topics: the first screen, the learners'
pages, warnings, what was run; and the page on two results (``difference_page``).
"""
