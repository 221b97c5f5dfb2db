"""From the record to a report: measures, statistics, figures.

Everything here reads the record (:mod:`causal_openlock.experiment.record`), one step after the
other, and the description of the experiment for what its names stand for:

=============== =================================================================================
``measures``    What happened: attempts to solve each trial, attempts in each category.
``scores``      What a condition comes to for each subject, and what training was worth.
``information`` How much each action told a learner that believes, from traces.
``statistics``  How certain a mean over subjects is, or whatever is computed from them.
``effects``     How large an effect is, and how many subjects it takes to see it.
``bounds``      The ideal observer's attempts, exactly, for the schemas that were played.
``summary``     The tables of results, with published results beside them.
``transfer``    What training was worth, in words and drawings.
``pairwise``    Learners against learners.
``wording``     Lists in sentences.
``people``      What people did and a published model of them, the paper's tests, likeness.
``deep``        Deep learners under many attempts: which learn, and what agrees with the paper.
``drawings``    Figures in the form of the paper's, and the colours and panels that all share.
``report``      All of it in one page, and as files; two reports against each other.
=============== =================================================================================
"""
