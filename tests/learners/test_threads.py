"""Learners leave torch as many threads as it had."""

import pytest
import torch

import causal_openlock as ol


@pytest.mark.parametrize("learner", ["ddqn", "semi_markov_ddqn", "recurrent", "rl2", "sb3"])
def test_torch_has_as_many_threads_as_before(learner):
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        ol.compare("CC3", learner, subjects=1, attempt_limit=3, workers=0)
        after_compare = torch.get_num_threads()
        ol.watch(learner, "CC3", attempts=1)
        assert (after_compare, torch.get_num_threads()) == (2, 2)
    finally:
        torch.set_num_threads(before)
