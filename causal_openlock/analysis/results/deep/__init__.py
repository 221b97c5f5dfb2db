"""Learners with many attempts: which learn, and what of the paper's deep learners comes out again.

===================== ===========================================================================
``visits``            What came of each visit, and each subject's shares in the parts of a phase.
``chance``            What random actions come to, exactly.
``learning``          Which learners learn and which do not, by a stated rule.
``reward_study``      Which rewards a learner learns with, against what the paper says.
``agreement``         Ours against the paper's DDQN, point by point.
``agreement_section`` The same for the report.
``decay``             How fast attempts and exploration shrink: fits of the published means.
``exploration``       What is learned with exploration that shrinks as people's attempts do.
===================== ===========================================================================
"""
