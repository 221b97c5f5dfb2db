"""The networks of the deep learners, and how they are trained.

One cell trains many subjects at once, each with a network, a replay buffer and randomness of its
own; no agent's numbers depend on which others there are. ``rl2`` has one network for all, frozen.
"""
