"""The networks of the deep learners, and how they are trained.

One cell trains many subjects at once, each with a network, a replay buffer and randomness of its
own. N networks of one shape are a single stack of ``[N, in, out]`` weights, and no agent's numbers
depend on which others are in the stack. ``rl2`` has a single network, which is frozen.

=========================  =========================================================================
``double_q``               Stacked perceptrons, double Q-learning in torch, for ``ddqn`` on a GPU.
``double_q_compiled``      The same on a CPU, by the loops of ``double_q_kernels``.
``double_q_kernels``       These loops.
``replay_buffer``          Transitions for ``ddqn``, drawn uniformly or by priority.
``recurrent_cells``        Stacked linear layers, GRUs and LSTMs.
``recurrent_q``            Double Q-learning on sequences (R2D2), for ``recurrent``.
``sequence_buffer``        The sequences it learns from.
``recurrent_policy``       Recurrent networks with a policy and a value, for ``rl2``.
``network_file``           A trained policy as a file.
``perception``             What learners with a memory perceive, as numbers.
``denormals``              Denormal numbers are flushed to zero during training.
=========================  =========================================================================
"""
