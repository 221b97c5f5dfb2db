"""Tables that are computed from a record.

===================== ===========================================================================
``reading``           The columns that analysis needs; ``experiment.store`` opens the folders.
``counting``          The trials of a record and the categories of its attempts.
``summary``           Every trial, and the headline, with published results beside them.
``scores``            Scores of subjects in each condition, and what training was worth.
``differences``       Whether two groups of subjects differ by more than noise.
``bounds``            The ideal observer's attempts, exactly, for the schemas that were played.
``information``       How much information each action gave a learner that has beliefs.
``people``            Beside people: the paper's tests, and how like them a learner is.
``deep``              Learners with many attempts, and what agrees with the paper's deep learners.
===================== ===========================================================================
"""
