"""Tests and test data for packages that build on the toolkit.

:class:`~causal_openlock.testing.learner_contract.LearnerContract` holds a learner to its contract;
a package that adds one subclasses it, in three lines::

    from causal_openlock.testing import LearnerContract

    class TestMine(LearnerContract):
        learner = "my_package:MyLearner"  # or its registered name

:mod:`~causal_openlock.testing.strategies` has Hypothesis strategies, for tests of what should hold
for any schema and layout. Hypothesis is loaded with the first of them (``pip install hypothesis``).
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
