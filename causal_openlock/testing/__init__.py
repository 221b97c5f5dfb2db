"""Tests and test data for packages that build on the toolkit.

:class:`~causal_openlock.testing.learner_contract.LearnerContract` holds a learner to its contract;
a package that adds one subclasses it, in three lines::

    from causal_openlock.testing import LearnerContract

    class TestMine(LearnerContract):
        learner = "my_package:MyLearner"  # or its registered name

:mod:`~causal_openlock.testing.strategies` has Hypothesis strategies: any schema and layout, for
tests of what should hold for all of them::

    from hypothesis import given
    from causal_openlock.testing import schemas

    @given(schemas(max_levers=5))
    def test_every_schema_can_be_solved(schema):
        assert schema.solutions

Hypothesis is needed only for these (``pip install hypothesis``), and loaded with the first of them.
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
