"""The learners that come with causal_openlock, a file for each.

They are found through the entry-point group ``causal_openlock.learners``, exactly as learners of
other packages are. ``networks`` has the networks that deep learners train, ``meta`` the training of
the network of ``rl2``, and ``checkpoints`` its weights.
"""
