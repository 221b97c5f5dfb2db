"""Tests and test data for packages that build on the toolkit.

:class:`~causal_openlock.testing.learner_contract.LearnerContract` holds a learner to its contract.
:mod:`~causal_openlock.testing.strategies` draws any schema and layout, and needs Hypothesis, which
is loaded with the first of them (``pip install hypothesis``).
"""

from __future__ import annotations

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
