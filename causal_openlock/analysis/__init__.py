"""From the record to a report: measures, statistics, figures.

Everything here reads the record (:mod:`causal_openlock.record`), one step after the other, and the
description of the experiment for what its names stand for:

================ ================================================================================
``measures``     What happened: attempts to solve each trial, attempts in each category.
``statistics``   How certain a mean over subjects is.
``comparable``   What in an experiment is the paper's own, so that people can stand beside it.
``bounds``       The ideal observer's attempts, exactly, for the schemas that were played.
``published``    What people and a published model of them did, and whom it stands beside.
``summary``      The tables of results, with published results beside them.
``style``        What the figures have in common: colours, panels, how they are saved.
``figures``      Attempts in the form of the paper's Figures 3 and 4; all figures of a record.
``course``       Attempts by trial, over the course of every condition.
``categories``   What attempts came to, in the form of the paper's Figures 6 and 7.
``description``  What was run, in words.
``belief``       What one subject believed in one trial; ``belief_panels`` are its parts.
``report``       All of it in one page, and as files.
================ ================================================================================
"""
