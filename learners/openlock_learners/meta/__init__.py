"""Meta-training: how the network of ``rl2`` was made, from random schemas."""
