"""Figures, most of them in the form of the paper's: data in, a matplotlib figure out.

================= ===============================================================================
``style``         What the figures have in common: colours, panels, how they are saved.
``figures``       Attempts in the form of the paper's Figures 3 and 4; all figures of a record.
``course``        Attempts by trial, over the course of every condition.
``categories``    What attempts came to, in the form of the paper's Figures 6 and 7.
``points``        People's means at fourteen points, and a learner's beside them.
``comparisons``   Learners, or results, against one another.
``subjects``      How the subjects of one learner vary.
``belief``        What one subject believed in one trial.
``belief_panels`` Its parts.
================= ===============================================================================
"""
