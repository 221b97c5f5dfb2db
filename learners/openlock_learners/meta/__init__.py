"""Meta-training: how the network of ``rl2`` was made, from random schemas.

================== ================================================================================
``training``       The training.
``command``        ``causal-openlock train``.
``training_file``  What is declared of it in YAML (``experiments/meta_training/``).
``rooms``          The rooms that it draws, thousands at once.
``ppo``            The policy gradient that improves its network.
``random_schemas`` The schemas that it draws.
================== ================================================================================
"""
