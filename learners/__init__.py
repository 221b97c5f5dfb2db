"""The learners that come with causal_openlock.

Each module holds one learner and its idea. They are found through the entry-point group
``causal_openlock.learners``, exactly as learners of other packages are.
"""
