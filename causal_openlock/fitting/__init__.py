"""Fitting a learner to people: which of its declared parameters make it do what people did?

* :mod:`~causal_openlock.fitting.search`: which parameters are searched, and between what.
* :mod:`~causal_openlock.fitting.objective`: what a candidate plays, which of people's points it is
  fitted to and which are held out.
* :mod:`~causal_openlock.fitting.candidates`: the search itself, which continues where it stopped.
* :mod:`~causal_openlock.fitting.outcome`: the fitted learner on fresh seeds, as files.
"""
