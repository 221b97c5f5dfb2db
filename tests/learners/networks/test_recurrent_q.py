"""Double Q-learning on sequences, against torch's own cells, one agent at a time."""

import copy

import numpy as np
import pytest
import torch
from torch import nn

from openlock_learners.networks.recurrent_q import RecurrentDoubleQ, StackedRecurrentNetwork
from openlock_learners.networks.sequence_buffer import Sequences

pytestmark = pytest.mark.slow

AGENTS, BURN_IN, UNROLL, MANY, INPUTS, HIDDEN, ACTIONS = 3, 2, 4, 5, 9, 6, 7
GAMMA, RATE, PERIOD = 0.8, 0.01, 7


class Plain(nn.Module):
    """An agent's network as users of torch write it, and how it learns."""

    def __init__(self, stack, agent):
        super().__init__()
        self.cell, self.reads = nn.GRUCell(INPUTS, HIDDEN), nn.Linear(HIDDEN, HIDDEN)
        self.values = nn.Linear(HIDDEN, ACTIONS)
        weights = [part[agent].T.squeeze(1) for part in stack.parameters()]
        self.double().load_state_dict(dict(zip(self.state_dict(), weights, strict=True)))
        self.target, self.optimizer = copy.deepcopy(self), torch.optim.Adam(self.parameters(), RATE)

    def forward(self, inputs, state, mask):
        """Values before each step and the state after the last, of ``[T, M, in]``."""
        values = []
        for now, real in zip(inputs, mask, strict=True):
            state = torch.where(real[:, None], self.cell(now, state), state)
            values.append(self.values(torch.relu(self.reads(state))))
        return torch.stack(values), state

    def loss(self, batch):
        """The Huber loss over all steps that are there."""
        inputs, state, burn_in, action, reward, not_done, mask = batch
        every = torch.ones(UNROLL + 1, MANY, dtype=torch.bool)
        with torch.no_grad():
            _, warm = self(inputs[:BURN_IN], state, burn_in)
            _, theirs = self.target(inputs[:BURN_IN], state, burn_in)
            judged, _ = self.target(inputs[BURN_IN:], theirs, every)
        values, _ = self(inputs[BURN_IN:], warm, every)
        best = values[1:].argmax(dim=2, keepdim=True)
        goal = reward + not_done * GAMMA * judged[1:].gather(2, best).squeeze(2)
        chosen = values[:-1].gather(2, action[..., None]).squeeze(2)
        there = mask > 0
        return nn.functional.smooth_l1_loss(chosen[there], goal[there])


def minibatch(rng):
    shape = (AGENTS, UNROLL, MANY)
    return Sequences(
        inputs=rng.normal(size=(AGENTS, BURN_IN + UNROLL + 1, MANY, INPUTS)),
        state=rng.normal(size=(AGENTS, MANY, HIDDEN)),
        burn_in_mask=rng.random((AGENTS, BURN_IN, MANY)) < 0.7,
        action=rng.integers(0, ACTIONS, shape),
        reward=rng.normal(0, 2, shape),
        not_done=(rng.random(shape) < 0.8).astype(float),
        mask=(rng.random(shape) < 0.8).astype(float),
    )


def test_each_agent_follows_torchs_own_cells_and_pauses_where_it_is_to():
    rng = np.random.default_rng(0)
    generators = [np.random.default_rng(agent) for agent in range(AGENTS)]
    stack = StackedRecurrentNetwork(INPUTS, HIDDEN, ACTIONS, generators).double()
    q = RecurrentDoubleQ(stack, RATE, GAMMA, PERIOD)
    plain = [Plain(stack, agent) for agent in range(AGENTS)]
    for update in range(1, 60):
        batch = minibatch(rng)
        trains = torch.tensor([True, True, update < 50])
        losses = q.update(batch, trains)
        for agent, one in enumerate(plain):
            loss = one.loss([torch.as_tensor(part[agent]) for part in batch])
            assert float(losses[agent]) == pytest.approx(loss.item(), rel=1e-7)
            if trains[agent]:
                one.optimizer.zero_grad()
                loss.backward()
                one.optimizer.step()
            if update % PERIOD == 0:
                weights = one.state_dict()
                one.target.load_state_dict(
                    {name: weights[name] for name in one.target.state_dict()}
                )
    for agent, one in enumerate(plain):
        for part, its in zip(stack.parameters(), one.parameters(), strict=False):
            assert torch.allclose(part[agent].T.squeeze(1), its, atol=1e-7)
