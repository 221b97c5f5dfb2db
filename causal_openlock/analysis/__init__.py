"""From the record to a report: measures, statistics, figures.

Everything here reads the record (:mod:`causal_openlock.record`) and nothing else, one step after
the other:

================ ================================================================================
``measures``     What happened: attempts to solve each trial, attempts in each category.
``statistics``   How certain a mean over subjects is.
``summary``      The tables of results, with people's published results beside them.
``style``        What the figures have in common: colours, panels, how they are saved.
``figures``      Attempts in the form of the paper's Figures 3 and 4, and by trial.
``categories``   What attempts came to, in the form of the paper's Figures 6 and 7.
``report``       All of it in one page, and as files.
================ ================================================================================
"""
