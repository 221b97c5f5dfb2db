"""The double-Q update as compiled loops: one agent after the other, and every row by itself.

A minibatch holds only some ten distinct observations, and half or more of the activations are zero:
too little for a library of matrix products. Here each row of a product is summed by itself, zeros
left out, in an order that depends on the row alone. That is quicker, and an agent's numbers do not
depend on which observations are evaluated together or on which agents share a cell.

The parameters of an agent are one vector: layer by layer, ``[in, out]`` weights before ``[1, out]``
biases; ``sizes`` are the widths of the input and of each layer's output. What an evaluation leaves
for the way back is one vector as well, its *trace*: what each layer is given and the outputs, one
after the other.
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

BLOCK = 64
"""Rows of weights that all observations are multiplied with before the next rows are read."""


def loops(function: Compiled, **options: Any) -> Compiled:
    """Compile loops; fused multiply-adds are all that is allowed of fast arithmetic."""
    return compiled(function, **{"fastmath": {"contract"}, **options})


def inlined(function: Compiled) -> Compiled:
    """Compile into the functions that call this one: small ones, whose calls would cost most."""
    return loops(function, forceinline=True)


def reassociated(function: Compiled) -> Compiled:
    """Inline sums in several parts at once, in an order that their length decides."""
    return loops(function, fastmath={"contract", "reassoc"}, forceinline=True)


class Table(NamedTuple):
    """The D distinct observations, and the values that the target networks give them."""

    rows: Floats  # [D, in] the observations
    values: Floats  # [N, D, out] values by the target network of each agent
    is_known: NDArray[np.bool_]  # [N, D] which of them were computed since it was last copied


# -- networks -------------------------------------------------------------------------------------


@loops
def layer_of(parameters: Floats, sizes: Integers, layer: int) -> tuple[Floats, Floats]:
    """``[in, out]`` the weights of a layer and ``[1, out]`` its biases, as views."""
    rows, columns = sizes[layer], sizes[layer + 1]
    begin = ((sizes[:layer] + 1) * sizes[1 : layer + 1]).sum()
    end = begin + rows * columns
    weights = parameters[begin:end].reshape((rows, columns))
    return weights, parameters[end : end + columns].reshape((1, columns))


@loops
def given_to(trace: Floats, sizes: Integers, layer: int, many: int) -> Floats:
    """``[many, in]`` what a layer is given; that of the layer after the last is the outputs."""
    begin, width = many * sizes[:layer].sum(), sizes[layer]
    return trace[begin : begin + many * width].reshape((many, width))


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
def evaluate(parameters: Floats, sizes: Integers, inputs: Floats) -> Floats:
    """The trace of an agent's values of ``[U, in]`` observations."""
    many, layers = len(inputs), len(sizes) - 1
    trace = np.empty(many * sizes.sum(), parameters.dtype)
    listed, factors = np.empty(BLOCK + 4, np.uint64), np.empty(BLOCK + 4, parameters.dtype)
    given = given_to(trace, sizes, 0, many)
    given[:] = inputs
    for layer in range(layers):
        output = given_to(trace, sizes, layer + 1, many)
        weights, biases = layer_of(parameters, sizes, layer)
        output[:] = biases
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
    return trace


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
    settings: Floats,
) -> None:
    """Train the weights of units, one unit after the other, and pass the gradient on below.

    What a unit passes on, its gradient and the step on it are done at once, while its weights are
    in the cache: the sums of the gradient take no time next to the step's divisions and roots.

    Args:
        given: ``[R, U]`` what the units gave for R observations.
        slope: ``[R + 1, out]`` gradient by the outputs, with zeros in the last row.
        below: ``[R + 1, U]`` zeros, set to the gradient by what the units gave, where they let
            something through (ReLU); its last row means nothing. Empty if there is no layer below.
        weights: ``[U, out]``, as are Adam's means of their gradients and of the squares.
        first: The means.
        second: The means of squares.
        settings: Size of the step; share of the new gradient in ``first``; shares of the old mean
            and of the new square in ``second``; epsilon; what corrects the root of ``second``.
    """
    size, new, old_square = settings[0], settings[1], settings[2]
    new_square, epsilon, correction = settings[3], settings[4], settings[5]
    outputs, terms = weights.shape[1], len(given) + 4
    listed, factors = np.empty(terms, np.uint64), np.empty(terms, weights.dtype)
    rest = np.zeros(outputs, weights.dtype)
    for unit in range(len(weights)):
        many = list_terms(given[:, unit], len(given), listed, factors)
        for t in range(0, many if len(below) else 0, 4):
            i, j, k, m = listed[t], listed[t + 1], listed[t + 2], listed[t + 3]
            a, b, c, d = four_products(slope, i, j, k, m, weights, unit)
            below[i, unit], below[j, unit], below[k, unit], below[m, unit] = a, b, c, d
        add_terms(4, many, listed, factors, slope, rest)
        which = listed[0], listed[1], listed[2], listed[3]
        four = factors[0], factors[1], factors[2], factors[3]
        for output in range(outputs):
            gradient = four_terms(rest[output], slope, which, four, output)
            mean = first[unit, output] + new * (gradient - first[unit, output])
            square = old_square * second[unit, output] + new_square * gradient * gradient
            first[unit, output], second[unit, output] = mean, square
            weights[unit, output] -= size * mean / (np.sqrt(square) * correction + epsilon)
        if many > 4:
            rest[:] = 0


@loops
def backward(
    parameters: Floats,
    first: Floats,
    second: Floats,
    settings: Floats,
    sizes: Integers,
    trace: Floats,
    many: int,
    slope: Floats,
) -> None:
    """Train an agent's network on ``slope``, ``[R + 1, out]``, the gradient by its outputs.

    It is that of the first R of the ``many`` observations in the trace; its last row is zero.
    """
    used = len(slope) - 1
    always = np.ones((used, 1), parameters.dtype)
    for layer in range(len(sizes) - 2, -1, -1):
        given = given_to(trace, sizes, layer, many)[:used]
        below = np.zeros((used + 1 if layer else 0, sizes[layer]), parameters.dtype)
        weights, biases = layer_of(parameters, sizes, layer)
        mean, mean_of_biases = layer_of(first, sizes, layer)
        square, square_of_biases = layer_of(second, sizes, layer)
        train_units(given, slope, below, weights, mean, square, settings)
        # A bias is the weight of a unit that always gives 1.
        train_units(always, slope, below[:0], biases, mean_of_biases, square_of_biases, settings)
        below[used:] = 0
        slope = below


# -- double Q-learning ----------------------------------------------------------------------------


@loops
def look_up(batch: Batch, agent: int, rows: Integers, column: Integers) -> tuple[int, int]:
    """List the distinct observations of an agent's minibatch in ``rows``.

    Those that an action was taken in come first. What followed is left out where the target ends
    there, since nothing needs to be evaluated. Returned are how many an action was taken in, and
    how many there are. ``column``, ``[D]``, is set to where an observation is listed; it was -1.
    """
    before, after, not_done = batch.before[agent], batch.after[agent], batch.not_done[agent]
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
    return acted_in, many


@loops
def compare(
    values: Floats,
    column: Integers,
    batch: Batch,
    agent: int,
    table: Table,
    gamma: float,
    double: bool,
    errors: Floats,
    gradient: Floats,
) -> None:
    """Set an agent's ``[M]`` TD errors, by its values of the distinct observations.

    To ``gradient``, of zeros, is added that of the mean Huber loss by these values.
    """
    share = errors.dtype.type(1) / errors.dtype.type(len(errors))
    for transition in range(len(errors)):
        td_target = batch.reward[agent, transition]
        not_done = batch.not_done[agent, transition]
        if not_done > 0:
            row = batch.after[agent, transition]
            judged = table.values[agent, row]
            # Double Q: the online network chooses, the target network evaluates. Else it does both.
            choice = (values[column[row]] if double else judged).argmax()
            td_target += not_done * judged[choice] * values.dtype.type(gamma)
        before, action = column[batch.before[agent, transition]], batch.action[agent, transition]
        slope = errors[transition] = values[before, action] - td_target
        if abs(slope) > 1:  # what is not a number stays so
            slope = errors.dtype.type(1 if slope > 0 else -1)
        gradient[before, action] += slope * share


@loops
def update(
    online: Floats,
    target: Floats,
    first: Floats,
    second: Floats,
    settings: Floats,
    sizes: Integers,
    batch: Batch,
    trains: NDArray[np.bool_],
    table: Table,
    gamma: float,
    double: bool,
) -> Floats:
    """One gradient step for each agent that ``trains``, ``[N]``; TD errors, ``[N, M]``, of all.

    ``online`` and ``target`` are ``[N, P]`` parameters, ``first`` and ``second`` Adam's means of
    gradients and of their squares, and ``settings`` as for :func:`train_units`. Without ``double``,
    the target network also chooses the next action.
    """
    errors = np.empty(batch.reward.shape, online.dtype)
    rows, column = np.empty(2 * errors.shape[1], np.int64), np.full(len(table.rows), -1)
    for agent in range(len(online)):
        acted_in, many = look_up(batch, agent, rows, column)
        for row in rows[:many]:
            if not table.is_known[agent, row]:
                trace = evaluate(target[agent], sizes, table.rows[row : row + 1])
                table.values[agent, row] = trace[-sizes[-1] :]
                table.is_known[agent, row] = True
        trace = evaluate(online[agent], sizes, table.rows[rows[:many]])
        values = given_to(trace, sizes, len(sizes) - 1, many)
        gradient = np.zeros((acted_in + 1, sizes[-1]), online.dtype)
        compare(values, column, batch, agent, table, gamma, double, errors[agent], gradient)
        if trains[agent]:
            agents = online[agent], first[agent], second[agent]
            backward(*agents, settings, sizes, trace, many, gradient)
        column[rows[:many]] = -1
    return errors
