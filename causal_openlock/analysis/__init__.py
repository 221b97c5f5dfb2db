"""From the record to a report: measures, statistics, figures.

Everything here reads the record (:mod:`causal_openlock.experiment.record`) and the experiment that
it is of, one step after the other:

=============== =================================================================================
``statistics``  How certain a result over subjects is: bootstrap intervals.
``effects``     How large an effect is, and how many subjects it takes to see it.
``measures``    What happened: attempts to solve each trial, and attempts in each category.
``results``     Tables of results, with people, a published model and chance beside them.
``plots``       Every figure, as a function of results, and the style that all share.
``report``      All of it in one page, and as files; two reports against each other.
=============== =================================================================================
"""
