"""The networks of the deep learners, and how they are trained.

One cell trains many subjects at once, each with a network, a replay buffer and randomness of its
own; no agent's numbers depend on which others there are. ``rl2`` has one network for all, frozen.

====================  ==============================================================================
``double_q``          Double Q-learning of many perceptrons at once, for ``ddqn``.
``double_q_loops``    The compiled loops that evaluate and train them.
``replay_buffer``     Transitions for ``ddqn``.
``recurrent_q``       Double Q-learning on sequences (R2D2), for ``recurrent``.
``sequence_buffer``   The sequences it learns from.
``recurrent_policy``  Recurrent networks with a policy and a value, for ``rl2``.
``network_file``      A trained policy as a file.
``perception``        What learners with a memory perceive, as numbers.
``denormals``         Denormal numbers are flushed to zero during training.
====================  ==============================================================================
"""
