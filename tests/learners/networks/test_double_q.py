"""Double Q-learning in compiled loops: by hand, by autograd, and each agent as it is alone."""

import pickle

import numpy as np
import pytest
import torch

from openlock_learners.networks.double_q import DoubleQ
from openlock_learners.networks.double_q_loops import layer_of
from openlock_learners.networks.replay_buffer import Batch

pytestmark = pytest.mark.slow

SIZES = [16, 24, 40, 24, 15]
AGENTS = 4


def made(agents=range(AGENTS), period=7, **settings):
    generators = [np.random.default_rng(agent) for agent in agents]
    return DoubleQ(SIZES, generators, 1e-3, 0.8, period, **settings)


def table(rng, rows):
    return rng.integers(0, 2, (rows, 16)).astype(float)


def minibatch(rng, known, many=32):
    """Transitions between the first ``known[agent]`` observations of a table for each agent."""
    shape = (len(known), many)
    before, after = ((rng.random(shape) * np.array(known)[:, None]).astype(int) for _ in range(2))
    action, reward = rng.integers(0, 15, shape), rng.normal(0, 3, shape)
    return Batch(before, action, after, reward, (rng.random(shape) < 0.6).astype(float))


def layers_of(q):
    """Weights and biases of each layer in turn, of all agents."""
    layers = range(len(SIZES) - 1)
    by_agent = [[part for i in layers for part in layer_of(own, q.sizes, i)] for own in q.online]
    return [*map(np.array, zip(*by_agent, strict=True))]


class PlainDoubleQ:
    """The same for N agents as users of torch write it, with autograd and torch's Adam."""

    def __init__(self, q):
        self.agents, self.gamma, self.double = len(q.online), q.gamma, q.double
        self.online = [*map(torch.tensor, layers_of(q))]
        self.target_period, self.updates = q.target_period, 0
        for part in self.online:
            part.requires_grad_()
        self.optimizer = torch.optim.Adam(self.online, lr=q.learning_rate)
        self.copy()

    def copy(self):
        self.target = [part.detach().clone() for part in self.online]

    def values(self, parameters):
        layers = self.table.expand(self.agents, -1, -1)
        for number, (weights, biases) in enumerate(zip(*[iter(parameters)] * 2, strict=True)):
            layers = torch.baddbmm(biases, layers.relu() if number else layers, weights)
        return layers

    def state(self):
        """The parameters, and the means of their gradients and of the squares."""
        moments = self.optimizer.state
        return [one for p in self.online for one in (p.data, *[*moments[p].values()][1:])]

    def update(self, batch, trains):
        before, action, after, reward, not_done = map(torch.as_tensor, batch)
        agent = torch.arange(self.agents)[:, None]
        values = self.values(self.online)
        with torch.no_grad():
            judged = self.values(self.target)
            choice = (values if self.double else judged).argmax(dim=2)[agent, after]
            target = reward + not_done * self.gamma * judged[agent, after, choice]
        chosen = values[agent, before, action]
        loss = torch.nn.functional.smooth_l1_loss(chosen, target, reduction="none").mean(dim=1)
        self.optimizer.zero_grad()
        loss.sum().backward()
        before_step = [part.clone() for part in self.state()]
        self.optimizer.step()
        if not trains.all():
            for now, was in zip(self.state(), before_step, strict=True):
                now[~trains] = was[~trains]
        self.updates += 1
        if self.target_period and self.updates % self.target_period == 0:
            self.copy()
        return (chosen - target).detach().numpy()


@pytest.mark.parametrize(("double", "period"), [(True, 7), (False, None)])
def test_autograd_follows_compiled_code_through_all_that_can_happen(double, period):
    """Tables that grow, agents that pause, minibatches of few and of many, and a checkpoint."""
    rng = np.random.default_rng(0)
    ours = made(period=period, double=double, precision=np.float64)
    plain, start = PlainDoubleQ(ours), ours.online.copy()
    observations = table(rng, 90)
    for step in range(150):
        if step % 30 == 0:
            rows = 10 + step // 2
            plain.table = torch.tensor(observations[:rows])
            ours.observe(observations[:rows])
        if step == 75:
            ours = pickle.loads(pickle.dumps(ours))
        batch = minibatch(rng, [1, 5, rows, rows])
        trains = rng.random(AGENTS) < (0.7 if 45 < step < 125 else 1)
        np.testing.assert_allclose(ours.update(batch, trains), plain.update(batch, trains), 1e-7)
        seen = rng.integers(0, rows, AGENTS)
        best = plain.values(plain.online)[range(AGENTS), seen].argmax(dim=1)
        assert ours.greedy(observations[seen], np.ones(AGENTS, bool)).tolist() == best.tolist()
    for part, its in zip(layers_of(ours), plain.online, strict=True):
        np.testing.assert_allclose(part, its.detach().numpy(), atol=1e-9)
    values = plain.values(plain.online).detach().numpy()
    np.testing.assert_allclose(ours.values(), values, atol=1e-9)
    assert np.abs(start - ours.online).max() > 0.01


def test_agents_trained_together_are_exactly_the_agents_trained_alone():
    rng = np.random.default_rng(2)
    together, alone = made(), [made([agent]) for agent in range(AGENTS)]
    observations, all_train = table(rng, 30), np.ones(AGENTS, dtype=bool)
    for q in (together, *alone):
        q.observe(observations)
    for _ in range(100):
        batch = minibatch(rng, [30, 12, 3, 1])
        errors = together.update(batch, all_train)
        for agent, q in enumerate(alone):
            mine = q.update(Batch(*(part[agent : agent + 1] for part in batch)), all_train[:1])
            assert np.array_equal(mine[0], errors[agent])
    for agent, q in enumerate(alone):
        assert np.array_equal(together.online[agent], q.online[0])
    # What does not train stays as it is, whatever stands in its place, and momentum is at rest.
    batch.reward[1] = np.nan
    together.update(batch, np.array([True, False, True, True]))
    assert np.array_equal(together.online[1], alone[1].online[0])
    assert not np.isnan(together.online).any()
    assert not np.array_equal(together.online[0], alone[0].online[0])
    batch.reward[1], batch.reward[2, 3] = 0.0, np.nan
    assert np.argwhere(np.isnan(together.update(batch, all_train))).tolist() == [[2, 3]]
