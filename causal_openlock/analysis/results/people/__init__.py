"""Beside people: what is published of them, and how like them a learner is.

========================== ======================================================================
``published``              What people and a published model of them did, and whom it stands beside.
``comparable``             What in an experiment is the paper's own, so that people can be compared.
``beside``                 Several folders of results as one, such as people beside learners.
``hypotheses``             Tests of hypotheses, from values or from published means alone.
``paper_tests``            The paper's tests, in the paper's order.
``paper_findings``         What they found, for the report.
``human_likeness``         How far a learner's means are from people's, and the effects it shares.
``human_likeness_section`` The same for the report.
========================== ======================================================================
"""
