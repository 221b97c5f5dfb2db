"""Beside people: what is published about them, and how like them a learner is.

===================== ===========================================================================
``comparable``        Which learners and conditions can be compared with people.
``published``         What people and a published model of them did.
``hypotheses``        Significance tests, from values or from published means alone.
``paper_tests``       The paper's tests, in the paper's order.
``human_likeness``    How far a learner's means are from people's, and which effects it shows.
===================== ===========================================================================
"""
