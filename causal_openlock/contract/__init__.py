"""The interface of learners (``learner``, ``one_subject``), and how they are found by name."""
