"""Fitting a learner to people: which of its declared parameters make it do what people did?

* :mod:`~causal_openlock.fitting.plan`: which parameters are searched, between what, and how.
* :mod:`~causal_openlock.fitting.search`: the search for the least loss.
* :mod:`~causal_openlock.fitting.to_actions`, :mod:`~causal_openlock.fitting.to_means`: two losses.
* :mod:`~causal_openlock.fitting.hierarchical`: subjects fitted with their group.
* :mod:`~causal_openlock.fitting.predicting`: fitted learners that predict.
"""
