"""What a learner is shown and answers, and how it is found by name.

=============== ===================================================================================
``learner``     The contract: ``Learner``, and the types of what it is shown.
``one_subject`` Learners written for one subject, and the adapter that plays many of them.
``registry``    Finds learners, declared in ``pyproject.toml``, by name; checks their parameters.
``parameters``  Types of hyper-parameters with ranges.
``probes``      What the contract tests and ``learner_check`` hand to a learner.
=============== ===================================================================================
"""
