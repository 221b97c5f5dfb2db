"""The double-Q update as compiled loops: one agent after the other, each in the cache.

A network of the paper's size takes 215 kB, its gradient and Adam's two moments as much each. Taken
together they fit into a core's cache, those of twenty agents do not. So nothing here is done for
all agents at once: an agent's minibatch is looked up, evaluated and propagated back, and each
layer's gradient is spent by the optimiser while it is still in the cache, before the next agent's
turn. Nor is anything padded: each agent evaluates as many observations as its minibatch has.

Matrix products are BLAS's, through ``np.dot``; whoever calls sees to it that BLAS keeps to one
thread, since several only wait for each other at this size. What is computed, and why, is told in
:mod:`learners.stacked`, the reference for everything here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

Compiled = TypeVar("Compiled", bound=Callable[..., Any])
Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]

ADAM, RMSPROP, SGD = range(3)
HUBER, SQUARED = range(2)


def compiled(function: Compiled) -> Compiled:
    """Compile at the first call, once for an installation.

    ``error_model="numpy"`` divides as NumPy does: a check for zero would keep loops from being
    vectorised. Fused multiply-adds (``contract``) are all that is allowed of fast arithmetic, so
    that what is not a number stays so.
    """
    compiler = numba.njit(cache=True, error_model="numpy", fastmath={"contract"})
    return cast(Compiled, compiler(function))


class Networks(NamedTuple):
    """The parameters of N networks of the same shape, laid out as in a ``StackedMLP``.

    Attributes:
        flat: All of them in one piece: layer by layer, weights before biases, agent by agent.
        sizes: ``[L + 1]`` width of the input, and of each layer's output.
        begins: ``[L]`` where in ``flat`` each layer begins.
        agents: N.
    """

    flat: Floats
    sizes: Integers
    begins: Integers
    agents: int


class Optimiser(NamedTuple):
    """One of torch's optimisers, and what it remembers.

    Attributes:
        rule: ``ADAM``, ``RMSPROP`` or ``SGD``.
        settings: Size of the step; share of the new gradient in ``first``; shares of the old mean
            and of the new square in ``second``; epsilon; and what corrects the root of ``second``.
        first: Mean of the gradients, laid out like the parameters; Adam's alone.
        second: Mean of their squares; that of Adam and of RMSprop.
    """

    rule: int
    settings: Floats
    first: Floats
    second: Floats


class Minibatch(NamedTuple):
    """Minibatches of N agents as in ``learners.replay.Batch``; every part is ``[N, M]``."""

    before: Integers
    action: Integers
    reward: Floats
    after: Integers
    goes_on: Floats
    weight: Floats


class Table(NamedTuple):
    """The distinct observations, and what the target networks hold of them.

    Attributes:
        rows: ``[D, in]`` the observations.
        judged: ``[N, D, out]`` values by the target network of each agent.
        is_judged: ``[N, D]`` which of them have been computed since it was last copied.
    """

    rows: Floats
    judged: Floats
    is_judged: NDArray[np.bool_]


class Scratch(NamedTuple):
    """Room for one agent's intermediate results, used again for the next agent.

    Attributes:
        given: What each layer is given and the outputs, one after the other.
        slope: Two halves: the gradient by what a layer gives and by what it is given, in turns.
        gradient: Of the weights and biases of one layer.
        rows: Numbers of the distinct observations of a minibatch.
        inputs: These observations.
        column: ``[D]`` which of ``rows`` an observation is; -1 if it is none of them.
    """

    given: Floats
    slope: Floats
    gradient: Floats
    rows: Integers
    inputs: Floats
    column: Integers


# -- networks -------------------------------------------------------------------------------------


@compiled
def weights_of(flat: Floats, networks: Networks, layer: int, agent: int) -> Floats:
    """``[in, out]`` an agent's weights in ``flat``, which is laid out like the parameters."""
    rows, columns = networks.sizes[layer], networks.sizes[layer + 1]
    begin = networks.begins[layer] + agent * rows * columns
    return flat[begin : begin + rows * columns].reshape((rows, columns))


@compiled
def biases_of(flat: Floats, networks: Networks, layer: int, agent: int) -> Floats:
    """``[out]`` an agent's biases in ``flat``."""
    rows, columns = networks.sizes[layer], networks.sizes[layer + 1]
    begin = networks.begins[layer] + (networks.agents * rows + agent) * columns
    return flat[begin : begin + columns]


@compiled
def given_to(scratch: Scratch, networks: Networks, layer: int, many: int) -> Floats:
    """``[many, in]`` what a layer is given; that of the layer after the last is the outputs."""
    begin = many * networks.sizes[:layer].sum()
    width = networks.sizes[layer]
    return scratch.given[begin : begin + many * width].reshape((many, width))


@compiled
def slope_by(scratch: Scratch, turn: int, many: int, width: int) -> Floats:
    """``[many, width]`` room for a gradient by what a layer is given or gives."""
    begin = turn * (len(scratch.slope) // 2)
    return scratch.slope[begin : begin + many * width].reshape((many, width))


@compiled
def evaluate(networks: Networks, agent: int, inputs: Floats, scratch: Scratch) -> Floats:
    """``[U, out]`` an agent's values of ``[U, in]`` observations; ``scratch`` keeps the trace."""
    many, layers = len(inputs), len(networks.begins)
    given = given_to(scratch, networks, 0, many)
    given[:] = inputs
    for layer in range(layers):
        output = given_to(scratch, networks, layer + 1, many)
        np.dot(given, weights_of(networks.flat, networks, layer, agent), output)
        biases = biases_of(networks.flat, networks, layer, agent)
        is_hidden = layer < layers - 1
        for row in range(many):
            for unit in range(len(biases)):
                value = output[row, unit] + biases[unit]
                if is_hidden and value < 0:  # ReLU
                    value = biases.dtype.type(0)
                output[row, unit] = value
        given = output
    return given


@compiled
def best(values: Floats) -> int:
    """The first of the actions of the highest value; what is not a number counts as highest."""
    chosen = 0
    for action in range(1, len(values)):
        if values[action] > values[chosen] or (
            np.isnan(values[action]) and not np.isnan(values[chosen])
        ):
            chosen = action
    return chosen


@compiled
def greedy(networks: Networks, observations: Floats, scratch: Scratch) -> Integers:
    """``[N]`` the best action for each agent's observation, ``[N, in]``."""
    actions = np.empty(networks.agents, dtype=np.int64)
    for agent in range(networks.agents):
        values = evaluate(networks, agent, observations[agent : agent + 1], scratch)
        actions[agent] = best(values[0])
    return actions


# -- optimisers -----------------------------------------------------------------------------------


@compiled
def descend(optimiser: Optimiser, flat: Floats, begin: int, gradient: Floats) -> None:
    """Move the parameters from ``begin`` on down their gradient, as torch's optimisers do."""
    size, new, old_square, new_square, epsilon, correction = optimiser.settings
    end = begin + len(gradient)
    parameter = flat[begin:end]
    if optimiser.rule == ADAM:
        first, second = optimiser.first[begin:end], optimiser.second[begin:end]
        for i in range(len(gradient)):
            slope = gradient[i]
            mean = first[i] + new * (slope - first[i])
            square = old_square * second[i] + new_square * slope * slope
            first[i], second[i] = mean, square
            parameter[i] -= size * mean / (np.sqrt(square) * correction + epsilon)
    elif optimiser.rule == RMSPROP:
        second = optimiser.second[begin:end]
        for i in range(len(gradient)):
            square = old_square * second[i] + new_square * gradient[i] * gradient[i]
            second[i] = square
            parameter[i] -= size * gradient[i] / (np.sqrt(square) + epsilon)
    else:
        for i in range(len(gradient)):
            parameter[i] -= size * gradient[i]


@compiled
def backward(
    networks: Networks, agent: int, many: int, optimiser: Optimiser, scratch: Scratch
) -> None:
    """Train an agent's network on the gradient by its outputs, which ``slope_by(0)`` holds."""
    turn = 0
    for layer in range(len(networks.begins) - 1, -1, -1):
        weights = weights_of(networks.flat, networks, layer, agent)
        rows, columns = weights.shape
        given = given_to(scratch, networks, layer, many)
        slope = slope_by(scratch, turn, many, columns)
        if layer:  # with the weights as they are before the step
            below = slope_by(scratch, 1 - turn, many, rows)
            np.dot(slope, weights.T, below)
            for row in range(many):
                for unit in range(rows):
                    # The slope of a ReLU is 1 where it let something through and 0 elsewhere.
                    if given[row, unit] == 0:
                        below[row, unit] = 0
        gradient = scratch.gradient[: rows * columns]
        np.dot(given.T, slope, gradient.reshape((rows, columns)))
        begin = networks.begins[layer]
        descend(optimiser, networks.flat, begin + agent * rows * columns, gradient)
        gradient = scratch.gradient[:columns]
        gradient[:] = 0
        for row in range(many):
            for unit in range(columns):
                gradient[unit] += slope[row, unit]
        begin += networks.agents * rows * columns
        descend(optimiser, networks.flat, begin + agent * columns, gradient)
        turn = 1 - turn


# -- double Q-learning ----------------------------------------------------------------------------


@compiled
def look_up(batch: Minibatch, agent: int, table: Table, scratch: Scratch) -> int:
    """Gather the distinct observations of an agent's minibatch in ``scratch``, and count them.

    What followed is left out where the target ends there, since nothing needs to be evaluated.
    """
    rows, column, many = scratch.rows, scratch.column, 0
    for transition in range(batch.before.shape[1]):
        for is_after in range(2):
            row = batch.before[agent, transition]
            if is_after:
                if not batch.goes_on[agent, transition] > 0:
                    continue
                row = batch.after[agent, transition]
            if column[row] < 0:
                column[row] = many
                rows[many] = row
                scratch.inputs[many] = table.rows[row]
                many += 1
    return many


@compiled
def forget(many: int, scratch: Scratch) -> None:
    """Make ``scratch`` ready for the next agent."""
    for observation in range(many):
        scratch.column[scratch.rows[observation]] = -1


@compiled
def judge(target: Networks, agent: int, many: int, table: Table, scratch: Scratch) -> None:
    """Let the target network value those of the observations that it has not valued yet."""
    missing = 0
    inputs = np.empty((many, table.rows.shape[1]), dtype=table.rows.dtype)
    for observation in range(many):
        row = scratch.rows[observation]
        if not table.is_judged[agent, row]:
            inputs[missing] = table.rows[row]
            missing += 1
    if not missing:
        return
    values = evaluate(target, agent, inputs[:missing], scratch)
    missing = 0
    for observation in range(many):
        row = scratch.rows[observation]
        if not table.is_judged[agent, row]:
            table.judged[agent, row] = values[missing]
            table.is_judged[agent, row] = True
            missing += 1


@compiled
def td_errors(
    values: Floats,
    batch: Minibatch,
    agent: int,
    table: Table,
    gamma: float,
    scratch: Scratch,
    errors: Floats,
) -> None:
    """Set an agent's ``[M]`` TD errors, by its values of the distinct observations."""
    for transition in range(len(errors)):
        goal = batch.reward[agent, transition]
        goes_on = batch.goes_on[agent, transition]
        if goes_on > 0:
            row = batch.after[agent, transition]
            # Double Q: the online network chooses, the target network judges.
            choice = best(values[scratch.column[row]])
            goal += goes_on * table.judged[agent, row, choice] * values.dtype.type(gamma)
        before = scratch.column[batch.before[agent, transition]]
        errors[transition] = values[before, batch.action[agent, transition]] - goal


@compiled
def pull(
    errors: Floats, batch: Minibatch, agent: int, loss: int, scratch: Scratch, slope: Floats
) -> None:
    """Set ``[U, out]`` slopes of an agent's loss by its values of the distinct observations."""
    slope[:] = 0
    for transition in range(len(errors)):
        # The slope of half the square is the error; Huber's never exceeds 1.
        pulls = errors[transition]
        if loss == HUBER and pulls > 1:
            pulls = errors.dtype.type(1)
        elif loss == HUBER and pulls < -1:
            pulls = errors.dtype.type(-1)
        pulls *= batch.weight[agent, transition] / errors.dtype.type(len(errors))
        before = scratch.column[batch.before[agent, transition]]
        slope[before, batch.action[agent, transition]] += pulls


@compiled
def update(
    online: Networks,
    target: Networks,
    batch: Minibatch,
    trains: NDArray[np.bool_],
    table: Table,
    optimiser: Optimiser,
    gamma: float,
    loss: int,
    scratch: Scratch,
) -> Floats:
    """One gradient step for each agent that trains.

    Args:
        online: The networks to train.
        target: Those that judge.
        batch: The minibatches.
        trains: ``[N]`` which agents take the step.
        table: What the numbers in the minibatches mean.
        optimiser: By what the step is taken.
        gamma: Discount factor.
        loss: ``HUBER`` or ``SQUARED``.
        scratch: Room for at least two observations for each transition.

    Returns:
        ``[N, M]`` the TD errors before the step, also of those who take none.
    """
    errors = np.empty(batch.reward.shape, dtype=online.flat.dtype)
    actions = online.sizes[-1]
    for agent in range(online.agents):
        many = look_up(batch, agent, table, scratch)
        judge(target, agent, many, table, scratch)
        values = evaluate(online, agent, scratch.inputs[:many], scratch)
        td_errors(values, batch, agent, table, gamma, scratch, errors[agent])
        if trains[agent]:
            slope = slope_by(scratch, 0, many, actions)
            pull(errors[agent], batch, agent, loss, scratch, slope)
            backward(online, agent, many, optimiser, scratch)
        forget(many, scratch)
    return errors
