"""From the record to a report: measures, statistics, figures.

Everything here reads the record (:mod:`causal_openlock.record`), one step after the other, and the
description of the experiment for what its names stand for:

================ ================================================================================
``measures``     What happened: attempts to solve each trial, attempts in each category.
``scores``       What a condition comes to for each subject, and what training was worth.
``information``  How much each action told a learner that believes, from traces.
``statistics``   How certain a mean over subjects is, or whatever is computed from them.
``effects``      How large an effect is, and how many subjects it takes to see it.
``hypotheses``   Tests of hypotheses, from values or from published means alone.
``paper_tests``  The paper's tests in the paper's order; ``paper_findings`` says what they found.
``transfer``     What training was worth, in words and drawings.
``pairwise``     Learners against learners.
``wording``      Lists in sentences.
``comparable``   What in an experiment is the paper's own, so that people can stand beside it.
``bounds``       The ideal observer's attempts, exactly, for the schemas that were played.
``published``    What people and a published model of them did, and whom it stands beside.
``summary``      The tables of results, with published results beside them.
``style``        What the figures have in common: colours, panels, how they are saved.
``figures``      Attempts in the form of the paper's Figures 3 and 4; all figures of a record.
``course``       Attempts by trial, over the course of every condition.
``categories``   What attempts came to, in the form of the paper's Figures 6 and 7.
``visits``       What came of each visit, and each subject's shares in the parts of a phase.
``chance``       What random actions come to, exactly.
``learning``     Which learners learn and which do not, by a stated rule.
``reward_study`` Which rewards a learner learns with, against what the paper says.
``agreement``    Ours against the paper's DDQN, point by point; ``agreement_section`` says it.
``decay``        How fast attempts and exploration shrink: fits of the published means.
``exploration``  What is learned with exploration that shrinks as people's attempts do.
``description``  What was run, in words.
``belief``       What one subject believed in one trial; ``belief_panels`` are its parts.
``report``       All of it in one page, and as files.
================ ================================================================================
"""
