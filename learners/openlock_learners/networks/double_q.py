"""Double Q-learning for N agents at once, each with a network of its own.

The networks are multi-layer perceptrons with ReLU between the layers and a linear output. They are
evaluated and trained by compiled loops (:mod:`openlock_learners.networks.double_q_loops`). The
first call compiles for some seconds; the machine code is stored for all later processes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import BoolArray, IntArray
from openlock_learners.networks import double_q_loops as loops
from openlock_learners.networks.double_q_loops import Floats
from openlock_learners.networks.replay_buffer import Batch

KEPT, KEPT_SQUARE, EPSILON = 0.9, 0.999, 1e-8
"""Adam's settings, as in torch: shares of both old means, and what is added to the root."""


class DoubleQ:
    """Double Q-learning for N agents over a table of observations.

    The room shows few distinct observations, and most of a minibatch repeats them. So transitions
    hold indices into a table (see :meth:`observe`), and each agent's network evaluates each of its
    minibatch once. The target network changes seldom, so its values are kept until it does.

    Args:
        sizes: Width of the input, of each hidden layer and of the output.
        generators: One source of initial weights for each agent.
        learning_rate: Of Adam.
        gamma: Discount factor.
        target_period: Updates between copies of the network to the target network; ``None`` never
            copies it again.
        double: Whether the network itself chooses the next action that the target network
            evaluates, as in DDQN; otherwise the target network does both, as in DQN.
        precision: Of all numbers.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        generators: Sequence[np.random.Generator],
        learning_rate: float,
        gamma: float,
        target_period: int | None,
        double: bool = True,
        precision: type[np.floating[Any]] = np.float32,
    ) -> None:
        self.sizes = np.array(sizes)
        drawn = []
        for width_in, width_out in pairwise(sizes):
            # Uniform within 1/sqrt(fan in), as torch initialises a single linear layer.
            bound = width_in**-0.5
            drawn += [
                np.array([rng.uniform(-bound, bound, rows * width_out) for rng in generators])
                for rows in (width_in, 1)
            ]
        #: ``[N, P]`` parameters: of each agent weights and biases, layer by layer
        self.online: Floats = np.concatenate(drawn, axis=1).astype(precision)
        self.target = self.online.copy()  #: those of the target networks
        self.learning_rate, self.gamma, self.double = learning_rate, gamma, double
        self.target_period = target_period
        self.updates = 0  #: gradient steps so far
        self._means, self._squares = np.zeros((2, *self.online.shape), precision)
        self.observe(np.zeros((0, sizes[0])))

    def observe(self, rows: NDArray[Any]) -> None:
        """Replace the table of ``[D, in]`` distinct observations, which all indices refer to."""
        agents, values = len(self.online), (len(self.online), len(rows), self.sizes[-1])
        self._table = loops.Table(
            rows.astype(self.online.dtype),
            np.zeros(values, self.online.dtype),
            np.zeros((agents, len(rows)), dtype=bool),
        )

    def values(self) -> Floats:
        """``[N, D, out]`` the values of the actions in each observation of the table."""
        rows, last = self._table.rows, len(self.sizes) - 1
        traces = [loops.evaluate(parameters, self.sizes, rows) for parameters in self.online]
        return np.array([loops.given_to(trace, self.sizes, last, len(rows)) for trace in traces])

    def greedy(self, observations: NDArray[Any], wanted: BoolArray) -> IntArray:
        """``[N]`` the best action for each agent's observation, ``[N, in]``.

        Of agents that are not ``wanted``, ``[N]``, it is 0.
        """
        inputs = observations.astype(self.online.dtype)
        actions = np.zeros(len(inputs), dtype=np.int64)
        for agent in np.flatnonzero(wanted):
            trace = loops.evaluate(self.online[agent], self.sizes, inputs[agent : agent + 1])
            actions[agent] = trace[-self.sizes[-1] :].argmax()
        return actions

    def update(self, batch: Batch, trains: BoolArray) -> Floats:
        """One gradient step for each agent that ``trains``, ``[N]``, on the mean Huber loss.

        The networks of the others, and their state of Adam, stay as they are, whatever their
        minibatches hold. Returned are the ``[N, M]`` TD errors before the step.
        """
        self.updates += 1
        precision = self.online.dtype
        size = self.learning_rate / (1 - KEPT**self.updates)
        correction = (1 - KEPT_SQUARE**self.updates) ** -0.5
        settings = [size, 1 - KEPT, KEPT_SQUARE, 1 - KEPT_SQUARE, EPSILON, correction]
        reward, not_done = batch.reward.astype(precision), batch.not_done.astype(precision)
        errors = loops.update(
            self.online,
            self.target,
            self._means,
            self._squares,
            np.array(settings, precision),
            self.sizes,
            batch._replace(reward=reward, not_done=not_done),
            trains,
            self._table,
            self.gamma,
            self.double,
        )
        if self.target_period and self.updates % self.target_period == 0:
            self.target[:] = self.online
            self._table.is_known[:] = False
        return errors
