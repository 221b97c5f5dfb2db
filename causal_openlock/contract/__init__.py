"""The interface of learners, and how they are found by name.

================ ==================================================================================
``learner``        The contract: ``Learner``, and the types of its input.
``one_subject``    Learners written for one subject, and the adapter that plays many of them.
``registry``       Finds learners, declared in ``pyproject.toml``, by name; checks their parameters.
``parameters``     Types of hyper-parameters with ranges.
``checks``         Failures, probabilities and global random numbers of learners.
================ ==================================================================================
"""
