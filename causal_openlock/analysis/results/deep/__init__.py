"""Learners with many attempts, and what of the paper's deep learners they reproduce.

===================== ===========================================================================
``visits``            Each subject's shares of success in the parts of a phase.
``chance``            What random actions come to, exactly.
``agreement``         Ours against the paper's DDQN, point by point.
``decay``             How fast attempts and exploration shrink: fits of the published means.
===================== ===========================================================================
"""
