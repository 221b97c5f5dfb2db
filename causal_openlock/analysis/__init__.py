"""Analysis: from the record to a report, by measures, statistics and figures.

Everything here reads the record (:mod:`causal_openlock.experiment.record`) and the experiment that
it is of, one step after the other:

=============== =================================================================================
``statistics``  How certain a mean over subjects is: its interval.
``effects``     How large an effect is, and how many subjects it takes to see it.
``table``       A table in every form: HTML, text, Markdown, LaTeX, CSV.
``measures``    What happened: attempts to solve each trial, and attempts in each category.
``results``     What several topics are made of: results in memory, references, the ideal observer.
``plots``       The style of all figures, and those of the paper's form.
``topic``       What a topic is: one idea of a report, with its numbers, tests, figure, sentences.
``topics``      The topics, a file for each.
``report``      All of it in one page, and as files; two reports against each other.
=============== =================================================================================
"""
