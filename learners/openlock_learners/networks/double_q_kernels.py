"""The double-Q update as compiled loops: one agent after the other, and every row by itself.

A minibatch holds only some ten distinct observations, and half or more of the activations are zero:
too little for a library of matrix products, which rearranges 64 kB of weights before it multiplies
them with six rows. Here each row of a product is summed by itself, zeros left out, in an order that
depends on the row alone. That is quicker, and it makes an agent's numbers its own: they do
not depend on which observations are evaluated together, on which agents share a cell, or on whether
a run was interrupted.

On the way back, the weights are gone through once. For each row of weights: what it passes on to
the layer below, its gradient, and the optimizer's step, while all of it is in the cache. Nothing is
done for all agents at once, since the parameters of twenty and Adam's two moments do not fit there.
What is computed, and why, is explained in :mod:`openlock_learners.networks.double_q`, the reference
for everything here.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.files.compiling import Compiled, compiled

if TYPE_CHECKING:
    from openlock_learners.networks.replay_buffer import Batch

Floats = NDArray[np.floating[Any]]
Integers = NDArray[np.int64]
Places = NDArray[np.uint64]  # of a signed one, each use asks whether it counts from the end

ADAM, RMSPROP, SGD = range(3)
HUBER, SQUARED = range(2)

BLOCK = 64
"""Rows of weights that all observations are multiplied with before the next rows are read."""


def loops(function: Compiled, **options: Any) -> Compiled:
    """Compile loops over numbers.

    Fused multiply-adds (``contract``) are all that is allowed of fast arithmetic, so that what is
    not a number stays so.
    """
    return compiled(function, **{"fastmath": {"contract"}, **options})


def inlined(function: Compiled) -> Compiled:
    """Compile into the functions that call this one: small ones, whose calls would cost most."""
    return loops(function, forceinline=True)


def reassociated(function: Compiled) -> Compiled:
    """Inline sums in several parts at once, in an order that their length decides."""
    return loops(function, fastmath={"contract", "reassoc"}, forceinline=True)


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


class Optimizer(NamedTuple):
    """One of torch's optimizers, and what it remembers.

    Attributes:
        rule: ``ADAM``, ``RMSPROP`` or ``SGD``.
        settings: Size of the step; share of the new gradient in ``first``; shares of the old mean
            and of the new square in ``second``; epsilon; and what corrects the root of ``second``.
        first: Mean of the gradients, laid out like the parameters; it is used by Adam alone.
        second: Mean of their squares; it is used by Adam and by RMSprop.
    """

    rule: int
    settings: Floats
    first: Floats
    second: Floats


class TargetTable(NamedTuple):
    """The distinct observations, and the values that the target networks give them.

    Attributes:
        rows: ``[D, in]`` the observations.
        values: ``[N, D, out]`` values by the target network of each agent.
        is_known: ``[N, D]`` which of them have been computed since it was last copied.
    """

    rows: Floats
    values: Floats
    is_known: NDArray[np.bool_]


class Scratch(NamedTuple):
    """Room for one agent's intermediate results, used again for the next agent.

    Attributes:
        given: What each layer is given and the outputs, one after the other.
        slope: Two halves: the gradient by what a layer gives and by what it is given, in turns.
        rest: Of a gradient, what has been summed of it; zeros between two of them.
        listed: Which terms of a sum are not zero.
        factors: By what they are multiplied.
        rows: Numbers of the distinct observations of a minibatch.
        inputs: These observations.
        column: ``[D]`` which of ``rows`` an observation is; -1 if it is none of them.
    """

    given: Floats
    slope: Floats
    rest: Floats
    listed: Places
    factors: Floats
    rows: Integers
    inputs: Floats
    column: Integers


# -- networks -------------------------------------------------------------------------------------


@loops
def weights_of(flat: Floats, networks: Networks, layer: int, agent: int) -> Floats:
    """``[in, out]`` an agent's weights in ``flat``, which is laid out like the parameters."""
    rows, columns = networks.sizes[layer], networks.sizes[layer + 1]
    begin = networks.begins[layer] + agent * rows * columns
    return flat[begin : begin + rows * columns].reshape((rows, columns))


@loops
def biases_of(flat: Floats, networks: Networks, layer: int, agent: int) -> Floats:
    """``[1, out]`` an agent's biases in ``flat``."""
    rows, columns = networks.sizes[layer], networks.sizes[layer + 1]
    begin = networks.begins[layer] + (networks.agents * rows + agent) * columns
    return flat[begin : begin + columns].reshape((1, columns))


@loops
def given_to(scratch: Scratch, networks: Networks, layer: int, many: int) -> Floats:
    """``[many, in]`` what a layer is given; that of the layer after the last is the outputs."""
    begin = many * networks.sizes[:layer].sum()
    width = networks.sizes[layer]
    return scratch.given[begin : begin + many * width].reshape((many, width))


@loops
def slope_by(scratch: Scratch, turn: int, many: int, width: int) -> Floats:
    """``[many, width]`` room for a gradient by what a layer is given or gives."""
    begin = turn * (len(scratch.slope) // 2)
    return scratch.slope[begin : begin + many * width].reshape((many, width))


@inlined
def copy(values: Floats, output: Floats) -> None:
    """Set a vector; ``output[:] = values`` would also compile a message about shapes."""
    for element in range(len(output)):
        output[element] = values[element]


@inlined
def list_terms(values: Floats, filler: int, listed: Places, factors: Floats) -> int:
    """List and count what is not zero of some values.

    Four terms of factor zero follow, all of the vector ``filler``, so that sums can go by fours.
    """
    many = 0
    for i in range(len(values)):
        listed[many], factors[many] = i, values[i]
        many += values[i] != 0
    for term in range(many, many + 4):
        listed[term], factors[term] = filler, 0
    return many


@inlined
def four_terms(rest: Any, vectors: Floats, which: Any, factors: Any, element: int) -> Any:
    """One element of a sum of vectors: what has been summed so far, and four more terms."""
    i, j, k, m = which
    a, b, c, d = factors
    return (
        rest
        + a * vectors[i, element]
        + b * vectors[j, element]
        + c * vectors[k, element]
        + d * vectors[m, element]
    )


@inlined
def add_terms(
    first: int, many: int, listed: Places, factors: Floats, vectors: Floats, output: Floats
) -> None:
    """Add the terms listed, from the first on, to a vector: in their order, whatever else there is.

    Four go into one pass; with more, the compiler gives up on vectors.
    """
    for t in range(first, many, 4):
        which = listed[t], listed[t + 1], listed[t + 2], listed[t + 3]
        four = factors[t], factors[t + 1], factors[t + 2], factors[t + 3]
        for element in range(len(output)):
            output[element] = four_terms(output[element], vectors, which, four, element)


@loops
def evaluate(networks: Networks, agent: int, inputs: Floats, scratch: Scratch) -> Floats:
    """``[U, out]`` an agent's values of ``[U, in]`` observations; ``scratch`` keeps the trace."""
    many, layers = len(inputs), len(networks.begins)
    listed, factors = scratch.listed, scratch.factors
    given = given_to(scratch, networks, 0, many)
    for row in range(many):
        copy(inputs[row], given[row])
    for layer in range(layers):
        output = given_to(scratch, networks, layer + 1, many)
        biases = biases_of(networks.flat, networks, layer, agent)[0]
        for row in range(many):
            copy(biases, output[row])
        weights = weights_of(networks.flat, networks, layer, agent)
        for begin in range(0, len(weights), BLOCK):
            block = weights[begin : begin + BLOCK]
            for row in range(many):
                terms = list_terms(given[row, begin : begin + BLOCK], 0, listed, factors)
                add_terms(0, terms, listed, factors, block, output[row])
        if layer < layers - 1:  # ReLU; what is not a number stays so
            for row in range(many):
                for unit in range(output.shape[1]):
                    value = output[row, unit]
                    output[row, unit] = output.dtype.type(0) if value < 0 else value
        given = output
    return given


@loops
def best(values: Floats) -> int:
    """The first of the actions of the highest value; what is not a number counts as highest."""
    chosen = 0
    for action in range(1, len(values)):
        if values[action] > values[chosen] or (
            np.isnan(values[action]) and not np.isnan(values[chosen])
        ):
            chosen = action
    return chosen


@loops
def greedy(
    networks: Networks, observations: Floats, wanted: NDArray[np.bool_], scratch: Scratch
) -> Integers:
    """``[N]`` the best action for each agent's observation, ``[N, in]``; 0 where none is wanted."""
    actions = np.zeros(networks.agents, dtype=np.int64)
    for agent in range(networks.agents):
        if wanted[agent]:
            values = evaluate(networks, agent, observations[agent : agent + 1], scratch)
            actions[agent] = best(values[0])
    return actions


# -- training -------------------------------------------------------------------------------------


@reassociated
def four_products(
    rows: Floats, i: int, j: int, k: int, m: int, weights: Floats, unit: int
) -> tuple[Any, Any, Any, Any]:
    """The inner products of four rows with a unit's weights."""
    a = b = c = d = weights.dtype.type(0)
    for output in range(weights.shape[1]):
        weight = weights[unit, output]
        a += rows[i, output] * weight
        b += rows[j, output] * weight
        c += rows[k, output] * weight
        d += rows[m, output] * weight
    return a, b, c, d


@loops
def train_units(
    given: Floats,
    slope: Floats,
    below: Floats,
    weights: Floats,
    first: Floats,
    second: Floats,
    optimizer: Optimizer,
    scratch: Scratch,
) -> None:
    """Train the weights of units, one unit after the other, and pass the gradient on below.

    What a unit passes on, its gradient and the step on it are done at once, while its weights are
    in the cache: the sums of the gradient take no time next to the step's divisions and roots.

    For R observations, ``given``, ``[R, U]``, is what the units gave, and ``slope``,
    ``[R + 1, out]``, the gradient by the outputs, with zeros in the last row. ``below``,
    ``[R + 1, U]``, is set to the gradient by what the units gave, where they let something
    through (the slope of a ReLU is 1 there and 0 elsewhere); its last row means nothing, and it is
    empty where there is no layer below. ``weights`` are ``[U, out]``, as are the optimizer's
    ``first`` and ``second`` of them.
    """
    rule, settings = optimizer.rule, optimizer.settings
    size, new, old_square = settings[0], settings[1], settings[2]
    new_square, epsilon, correction = settings[3], settings[4], settings[5]
    listed, factors, rest = scratch.listed, scratch.factors, scratch.rest
    outputs = weights.shape[1]
    below[:] = 0
    for unit in range(len(weights)):
        many = list_terms(given[:, unit], len(given), listed, factors)
        for t in range(0, many if len(below) else 0, 4):
            i, j, k, m = listed[t], listed[t + 1], listed[t + 2], listed[t + 3]
            a, b, c, d = four_products(slope, i, j, k, m, weights, unit)
            below[i, unit], below[j, unit], below[k, unit], below[m, unit] = a, b, c, d
        add_terms(4, many, listed, factors, slope, rest[:outputs])
        which = listed[0], listed[1], listed[2], listed[3]
        four = factors[0], factors[1], factors[2], factors[3]
        moving = many
        if rule == ADAM and not many:
            for output in range(outputs):
                moving += first[unit, output] != 0
        if not moving:
            if rule != SGD:
                for output in range(outputs):
                    second[unit, output] *= old_square
        elif rule == ADAM:
            for output in range(outputs):
                gradient = four_terms(rest[output], slope, which, four, output)
                mean = first[unit, output] + new * (gradient - first[unit, output])
                square = old_square * second[unit, output] + new_square * gradient * gradient
                first[unit, output], second[unit, output] = mean, square
                weights[unit, output] -= size * mean / (np.sqrt(square) * correction + epsilon)
        elif rule == RMSPROP:
            for output in range(outputs):
                gradient = four_terms(rest[output], slope, which, four, output)
                square = old_square * second[unit, output] + new_square * gradient * gradient
                second[unit, output] = square
                weights[unit, output] -= size * gradient / (np.sqrt(square) + epsilon)
        else:
            for output in range(outputs):
                weights[unit, output] -= size * four_terms(rest[output], slope, which, four, output)
        if many > 4:
            rest[:outputs] = 0


@loops
def backward(
    networks: Networks, agent: int, many: int, used: int, optimizer: Optimizer, scratch: Scratch
) -> None:
    """Train an agent's network on the gradient by its outputs, which ``slope_by(0)`` holds.

    ``scratch`` has the trace of ``many`` observations; the first ``used`` of them have a gradient.
    """
    always = np.ones((used, 1), networks.flat.dtype)
    turn = 0
    for layer in range(len(networks.begins) - 1, -1, -1):
        given = given_to(scratch, networks, layer, many)[:used]
        slope = slope_by(scratch, turn, used + 1, networks.sizes[layer + 1])
        slope[used] = 0
        below = slope_by(scratch, 1 - turn, used + 1 if layer else 0, networks.sizes[layer])
        train_units(
            given,
            slope,
            below,
            weights_of(networks.flat, networks, layer, agent),
            weights_of(optimizer.first, networks, layer, agent),
            weights_of(optimizer.second, networks, layer, agent),
            optimizer,
            scratch,
        )
        # A bias is the weight of a unit that always gives 1.
        train_units(
            always,
            slope,
            below[:0],
            biases_of(networks.flat, networks, layer, agent),
            biases_of(optimizer.first, networks, layer, agent),
            biases_of(optimizer.second, networks, layer, agent),
            optimizer,
            scratch,
        )
        turn = 1 - turn


# -- double Q-learning ----------------------------------------------------------------------------


@loops
def look_up(batch: Batch, agent: int, table: TargetTable, scratch: Scratch) -> tuple[int, int]:
    """Gather the distinct observations of an agent's minibatch in ``scratch``.

    Those that an action was taken in come first. What followed is left out where the target ends
    there, since nothing needs to be evaluated. Returned are how many an action was taken in, and
    how many there are.
    """
    before, after, not_done = batch.before[agent], batch.after[agent], batch.not_done[agent]
    column, rows = scratch.column, scratch.rows
    many = 0
    for row in before:
        if column[row] < 0:
            column[row], rows[many] = many, row
            many += 1
    acted_in = many
    for transition in range(len(after)):
        row = after[transition]
        if column[row] < 0 and not_done[transition] > 0:
            column[row], rows[many] = many, row
            many += 1
    for observation in range(many):
        copy(table.rows[rows[observation]], scratch.inputs[observation])
    return acted_in, many


@loops
def td_errors(
    values: Floats,
    batch: Batch,
    agent: int,
    table: TargetTable,
    gamma: float,
    double: bool,
    scratch: Scratch,
    errors: Floats,
) -> None:
    """Set an agent's ``[M]`` TD errors, by its values of the distinct observations."""
    for transition in range(len(errors)):
        td_target = batch.reward[agent, transition]
        not_done = batch.not_done[agent, transition]
        if not_done > 0:
            row = batch.after[agent, transition]
            judged = table.values[agent, row]
            # Double Q: the online network chooses, the target network evaluates. Else it does both.
            choice = best(values[scratch.column[row]] if double else judged)
            td_target += not_done * judged[choice] * values.dtype.type(gamma)
        before = scratch.column[batch.before[agent, transition]]
        errors[transition] = values[before, batch.action[agent, transition]] - td_target


@loops
def loss_gradient(
    errors: Floats, batch: Batch, agent: int, loss: int, scratch: Scratch, gradient: Floats
) -> None:
    """Set the ``[U, out]`` gradient of an agent's loss by its values of the observations."""
    gradient[:] = 0
    for transition in range(len(errors)):
        # The slope of half the square is the error; Huber's never exceeds 1.
        slope = errors[transition]
        if loss == HUBER and slope > 1:
            slope = errors.dtype.type(1)
        elif loss == HUBER and slope < -1:
            slope = errors.dtype.type(-1)
        slope *= batch.weight[agent, transition] / errors.dtype.type(len(errors))
        before = scratch.column[batch.before[agent, transition]]
        gradient[before, batch.action[agent, transition]] += slope


@loops
def update(
    online: Networks,
    target: Networks,
    batch: Batch,
    trains: NDArray[np.bool_],
    table: TargetTable,
    optimizer: Optimizer,
    gamma: float,
    loss: int,
    double: bool,
    scratch: Scratch,
) -> Floats:
    """One gradient step for each agent that ``trains``, ``[N]``, on a minibatch of arrays.

    ``loss`` is ``HUBER`` or ``SQUARED``; without ``double``, the target network also chooses the
    next action; and ``scratch`` has room for all distinct observations of
    an agent's minibatch. Returned are the ``[N, M]`` TD errors before the step, also of agents that
    take none.
    """
    errors = np.empty(batch.reward.shape, dtype=online.flat.dtype)
    actions = online.sizes[-1]
    for agent in range(online.agents):
        acted_in, many = look_up(batch, agent, table, scratch)
        for row in scratch.rows[:many]:
            if not table.is_known[agent, row]:
                observation = table.rows[row : row + 1]
                values = evaluate(target, agent, observation, scratch)
                copy(values[0], table.values[agent, row])
                table.is_known[agent, row] = True
        values = evaluate(online, agent, scratch.inputs[:many], scratch)
        td_errors(values, batch, agent, table, gamma, double, scratch, errors[agent])
        if trains[agent]:
            gradient = slope_by(scratch, 0, acted_in, actions)
            loss_gradient(errors[agent], batch, agent, loss, scratch, gradient)
            backward(online, agent, many, acted_in, optimizer, scratch)
        scratch.column[scratch.rows[:many]] = -1
    return errors
