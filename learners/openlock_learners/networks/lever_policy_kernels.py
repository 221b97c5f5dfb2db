"""A lever policy's course over many steps, and its gradients through time, as compiled loops.

What is computed is :meth:`~openlock_learners.networks.recurrent_policy.LeverPolicy.forward`, of one
network: torch goes through memory for every gate of every lever, and that takes longer than the
products. Here some rooms at a time go through all steps, so that what one step leaves for the
next stays in the processor's cache. Products are those of the BLAS library. Rooms are the last axis
of every array, so that loops between two products run over rooms and become vector instructions;
each loop names few arrays, or the compiler would not see that they are apart.

:func:`forward` keeps in a :class:`Trace` what :func:`backward` needs. A trace is most of what goes
through memory, so it holds nothing twice: the state before a step is that after the step before.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openlock_learners.networks.double_q_kernels import inlined, loops, reassociated
from openlock_learners.networks.recurrent_policy import OWN, SHARED

Floats = NDArray[np.float32]

ROOMS = 32
"""Rooms that go through all steps together."""
ZERO, HALF, ONE = np.float32(0), np.float32(0.5), np.float32(1)
BOUND = np.float32(7.90531110763549805)
"""Beyond it, the hyperbolic tangent is 1 in single precision."""
ODD = tuple(
    map(
        np.float32,
        (
            *(4.89352455891786e-03, 6.37261928875436e-04, 1.48572235717979e-05),
            *(5.12229709037114e-08, -8.60467152213735e-11, 2.00018790482477e-13),
            -2.76076847742355e-16,
        ),
    )
)
EVEN = tuple(
    map(
        np.float32,
        (4.89352518554385e-03, 2.26843463243900e-03, 1.18534705686654e-04, 1.19825839466702e-06),
    )
)
"""Coefficients of the hyperbolic tangent as a quotient of polynomials, as in the library Eigen."""


class Weights(NamedTuple):
    """The weights of one network, in the order of a ``LeverPolicy``'s parameters, or gradients."""

    room_input: Floats  # [9 + 3H, 3G]
    room_hidden: Floats  # [G, 3G]
    room_input_bias: Floats  # biases are [1, out]
    room_hidden_bias: Floats
    lever_input: Floats  # [4 + 9 + G, 3H]
    lever_hidden: Floats  # [H, 3H]
    lever_input_bias: Floats
    lever_hidden_bias: Floats
    reads_lever: Floats  # [H, K]
    reads_lever_bias: Floats
    reads_room: Floats  # [G + 2H, 2K]
    reads_room_bias: Floats
    moves: Floats  # [K, 2]
    moves_bias: Floats
    door_and_value: Floats  # [K, 2]
    door_and_value_bias: Floats


class Trace(NamedTuple):
    """Intermediate results, one row for each group of n rooms; L stands for its P * n levers.

    A piece begins at the row's first number; smaller groups leave the rest of the row unused.
    """

    own: Floats  # [T, 4, L] what is perceived of each lever
    levers: Floats  # [1, H, L] hidden states before the first step
    gates: Floats  # [T, 3H, L] reset and update gates, and the last state's part in new content
    new: Floats  # [T, H, L] new content
    after: Floats  # [T, H, L] hidden states after each step
    read: Floats  # [T, K, L] units that read a lever
    room: Floats  # [1, G, n] the room's state before the first step, and so on
    room_gates: Floats  # [T, 3G, n]
    room_new: Floats  # [T, G, n]
    room_inputs: Floats  # [T, 9 + 3H, n] what is perceived, levers' mean and maximum, the last one
    lever_inputs: Floats  # [T, 9 + G, n] what is perceived, and the room's state
    whole: Floats  # [T, G + 2H, n] the room's state, levers' mean and maximum
    whole_read: Floats  # [T, 2K, n] units that read it


@loops
def shapes(weights: Weights, steps: int, n: int, positions: int) -> Any:
    """Shapes of the pieces of a trace."""
    h, g, k = len(weights.lever_hidden), len(weights.room_hidden), len(weights.moves)
    many = positions * n
    return (
        (steps, OWN, many),
        (1, h, many),
        (steps, 3 * h, many),
        (steps, h, many),
        (steps, h, many),
        (steps, k, many),
        (1, g, n),
        (steps, 3 * g, n),
        (steps, g, n),
        (steps, SHARED + 3 * h, n),
        (steps, SHARED + g, n),
        (steps, g + 2 * h, n),
        (steps, 2 * k, n),
    )


def new_trace(weights: Weights, steps: int, rooms: int, positions: int, kept: bool) -> Trace:
    """Make room for a trace; one that is not kept has room for one group, used again for all."""
    groups = -(-rooms // ROOMS) if kept else 1
    every = shapes(weights, steps, min(ROOMS, rooms), positions)
    return Trace(*(np.empty((groups, math.prod(shape)), np.float32) for shape in every))


@inlined
def piece(store: Floats, group: int, shape: Any) -> Floats:
    """One group's piece of a trace, in its shape."""
    return store[group, : shape[0] * shape[1] * shape[2]].reshape(shape)


@loops
def of_group(trace: Trace, group: int, shape: Any) -> Trace:
    """One group's trace, with every piece in its shape."""
    return Trace(
        piece(trace.own, group, shape[0]),
        piece(trace.levers, group, shape[1]),
        piece(trace.gates, group, shape[2]),
        piece(trace.new, group, shape[3]),
        piece(trace.after, group, shape[4]),
        piece(trace.read, group, shape[5]),
        piece(trace.room, group, shape[6]),
        piece(trace.room_gates, group, shape[7]),
        piece(trace.room_new, group, shape[8]),
        piece(trace.room_inputs, group, shape[9]),
        piece(trace.lever_inputs, group, shape[10]),
        piece(trace.whole, group, shape[11]),
        piece(trace.whole_read, group, shape[12]),
    )


@inlined
def tanh(number: Any) -> Any:
    """The hyperbolic tangent, within some units of the last place."""
    x = BOUND if number > BOUND else number
    x = -BOUND if x < -BOUND else x
    y = x * x
    upper = y * (y * (y * (y * ODD[6] + ODD[5]) + ODD[4]) + ODD[3]) + ODD[2]
    lower = y * (y * EVEN[3] + EVEN[2]) + EVEN[1]
    return x * (y * (y * upper + ODD[1]) + ODD[0]) / (y * lower + EVEN[0])


@inlined
def sigmoid(number: Any) -> Any:
    """The logistic function."""
    return tanh(number * HALF) * HALF + HALF


@loops
def add(values: Floats, output: Floats) -> None:
    """Add one matrix to another."""
    for row in range(len(output)):
        for column in range(output.shape[1]):
            output[row, column] += values[row, column]


@loops
def copy(values: Floats, output: Floats) -> None:
    """Copy a matrix; ``output[:] = values`` takes several times longer."""
    for row in range(len(output)):
        for column in range(output.shape[1]):
            output[row, column] = values[row, column]


@loops
def add_to_rows(values: Floats, output: Floats) -> None:
    """Add a number to each row of a matrix."""
    for row in range(len(output)):
        for column in range(output.shape[1]):
            output[row, column] += values[row]


@reassociated
def add_sums(values: Floats, output: Floats) -> None:
    """Add the sum of each row of a matrix to a vector."""
    for row in range(len(values)):
        total = ZERO
        for column in range(values.shape[1]):
            total += values[row, column]
        output[row] += total


@loops
def reset(states: Floats, kept: Floats) -> None:
    """Set states, ``[rows, columns]``, to zero in columns where ``kept`` is 0, and not 1."""
    for row in range(len(states)):
        for column in range(states.shape[1]):
            states[row, column] *= kept[column]


@loops
def states_before(states: Floats, kept: Floats, spare: Floats) -> Floats:
    """The states, or, if some of them are reset before the step, a copy where they are."""
    if kept.min() == ONE:
        return states
    copy(states, spare)
    reset(spare, kept)
    return spare


@loops
def pool(levers: Floats, mean: Floats, most: Floats) -> None:
    """Mean and maximum, ``[H, n]``, over the levers, ``[H, P, n]``."""
    units, positions, rooms = levers.shape
    share = ONE / np.float32(positions)
    for unit in range(units):
        for room in range(rooms):
            mean[unit, room] = levers[unit, 0, room]
            most[unit, room] = levers[unit, 0, room]
        for position in range(1, positions):
            for room in range(rooms):
                lever = levers[unit, position, room]
                highest = most[unit, room]
                mean[unit, room] += lever
                most[unit, room] = lever if lever > highest else highest
        for room in range(rooms):
            mean[unit, room] *= share


@loops
def pool_back(
    levers: Floats, most: Floats, by_mean: Floats, by_most: Floats, by_levers: Floats
) -> None:
    """Add gradients through :func:`pool`; levers that are all at the maximum share its gradient."""
    units, positions, rooms = levers.shape
    share, shares = ONE / np.float32(positions), np.empty(rooms, np.float32)
    for unit in range(units):
        shares[:] = ZERO
        for position in range(positions):
            for room in range(rooms):
                at_most = levers[unit, position, room] == most[unit, room]
                shares[room] += ONE if at_most else ZERO
        for room in range(rooms):
            shares[room] = by_most[unit, room] / shares[room]
        for position in range(positions):
            for room in range(rooms):
                at_most = levers[unit, position, room] == most[unit, room]
                by_levers[unit, position, room] += shares[room] if at_most else ZERO
            for room in range(rooms):
                by_levers[unit, position, room] += by_mean[unit, room] * share


@loops
def acted_on(own: Floats, levers: Floats, last: Floats) -> None:
    """The state of the lever acted on, ``[H, n]``; zeros if it was none."""
    units, positions, rooms = levers.shape
    for unit in range(units):
        for room in range(rooms):
            last[unit, room] = ZERO
        for position in range(positions):
            for room in range(rooms):
                acted = own[2, position, room] + own[3, position, room]
                last[unit, room] += acted * levers[unit, position, room]


@loops
def acted_on_back(own: Floats, by_last: Floats, by_levers: Floats) -> None:
    """Add gradients through :func:`acted_on`."""
    units, positions, rooms = by_levers.shape
    for unit in range(units):
        for position in range(positions):
            for room in range(rooms):
                acted = own[2, position, room] + own[3, position, room]
                by_levers[unit, position, room] += acted * by_last[unit, room]


@loops
def project(own: Floats, weights: Floats, shared: Floats, projected: Floats) -> None:
    """Contributions of inputs to gates of levers, ``[3H, P, n]``; the room's is ``shared``."""
    rows, positions, rooms = projected.shape
    for row in range(rows):
        push, grey, pushed, pulled = (
            weights[0, row],
            weights[1, row],
            weights[2, row],
            weights[3, row],
        )
        for position in range(positions):
            for room in range(rooms):
                projected[row, position, room] = (
                    shared[row, room]
                    + push * own[0, position, room]
                    + grey * own[1, position, room]
                    + pushed * own[2, position, room]
                    + pulled * own[3, position, room]
                )


@loops
def gru(
    projected: Floats, bias: Floats, gates: Floats, before: Floats, new: Floats, after: Floats
) -> None:
    """One step of gated recurrent units; ``gates`` holds the last state's part and is changed."""
    units, columns = before.shape
    for row in range(2 * units):
        for i in range(columns):
            gates[row, i] = sigmoid(projected[row, i] + (gates[row, i] + bias[row]))
    for row in range(units):
        keep, recurrent = units + row, 2 * units + row
        for i in range(columns):
            gates[recurrent, i] += bias[recurrent]
        for i in range(columns):
            new[row, i] = tanh(projected[recurrent, i] + gates[row, i] * gates[recurrent, i])
        for i in range(columns):
            after[row, i] = new[row, i] + gates[keep, i] * (before[row, i] - new[row, i])


@loops
def gru_back(
    slope: Floats, gates: Floats, new: Floats, before: Floats, by_inputs: Floats, by_gates: Floats
) -> None:
    """Gradients of :func:`gru`.

    Args:
        slope: ``[H, columns]`` by the state after; out: by the state before, as far as it was kept.
        gates: ``[3H, columns]`` as :func:`gru` left it.
        new: ``[H, columns]`` new content.
        before: ``[H, columns]`` the state before.
        by_inputs: ``[3H, columns]`` out: by the input's part.
        by_gates: ``[3H, columns]`` out: by the last state's part.
    """
    units, columns = slope.shape
    for row in range(units):
        keep, last = units + row, 2 * units + row
        for i in range(columns):
            content = new[row, i]
            by_inputs[last, i] = slope[row, i] * (ONE - gates[keep, i]) * (ONE - content * content)
        for i in range(columns):
            kept, moved = gates[keep, i], before[row, i] - new[row, i]
            by_gates[keep, i] = slope[row, i] * moved * kept * (ONE - kept)
        for i in range(columns):
            slope[row, i] *= gates[keep, i]
        for i in range(columns):
            opened = gates[row, i]
            by_open = by_inputs[last, i] * gates[last, i]
            by_gates[row, i] = by_open * opened * (ONE - opened)
        for i in range(columns):
            by_gates[last, i] = by_inputs[last, i] * gates[row, i]
    copy(by_gates[: 2 * units], by_inputs[: 2 * units])


@loops
def read(units: Floats, bias: Floats, shared: Floats, weights: Floats, found: Floats) -> None:
    """Add two outputs, ``[2, P, n]``, of units ``[K, P, n]``, which are made positive."""
    many, positions, rooms = units.shape
    for unit in range(many):
        first, second = weights[unit, 0], weights[unit, 1]
        for position in range(positions):
            for room in range(rooms):
                total = units[unit, position, room] + (bias[unit] + shared[unit, room])
                units[unit, position, room] = ZERO if total < ZERO else total
            for room in range(rooms):
                found[0, position, room] += first * units[unit, position, room]
                found[1, position, room] += second * units[unit, position, room]


@reassociated
def read_back(
    slopes: Floats, units: Floats, weights: Floats, gradients: Floats, by_units: Floats
) -> None:
    """Gradients of :func:`read`: by its weights, added to ``gradients``, and by its units."""
    many, columns = units.shape
    for unit in range(many):
        first, second = weights[unit, 0], weights[unit, 1]
        by_first, by_second = ZERO, ZERO
        for i in range(columns):
            by_first += slopes[0, i] * units[unit, i]
            by_second += slopes[1, i] * units[unit, i]
        gradients[unit, 0] += by_first
        gradients[unit, 1] += by_second
        for i in range(columns):
            slope = first * slopes[0, i] + second * slopes[1, i]
            by_units[unit, i] = slope if units[unit, i] > ZERO else ZERO


@loops
def sum_over_levers(values: Floats, sums: Floats) -> None:
    """The sum over the levers of ``[rows, P, n]``, ``[rows, n]``."""
    rows, positions, rooms = values.shape
    for row in range(rows):
        for room in range(rooms):
            sums[row, room] = values[row, 0, room]
        for position in range(1, positions):
            for room in range(rooms):
                sums[row, room] += values[row, position, room]


@loops
def forward(
    weights: Weights, inputs: Floats, state: Floats, fresh: NDArray[np.bool_], trace: Trace
) -> tuple[Floats, Floats, Floats]:
    """Run over T steps.

    Args:
        weights: The network.
        inputs: ``[T, M, in]`` what is perceived.
        state: ``[M, S]`` hidden state before the first step.
        fresh: ``[T, M]`` steps before which the hidden state is reset.
        trace: Filled.

    Returns:
        ``[T, M, A]`` logits, ``[T, M]`` values, and ``[M, S]`` the last hidden state.
    """
    steps, rooms, width = inputs.shape
    p = (width - SHARED) // OWN
    h, g, k = len(weights.lever_hidden), len(weights.room_hidden), len(weights.moves)
    logits = np.empty((steps, rooms, 2 * p + 1), np.float32)
    values, states = np.empty((steps, rooms), np.float32), np.empty_like(state)
    for group in range((rooms + ROOMS - 1) // ROOMS):
        begin = group * ROOMS
        n = min(ROOMS, rooms - begin)
        many = p * n
        kept = np.empty(many, np.float32)
        spare, room_spare = np.empty((h, many), np.float32), np.empty((g, n), np.float32)
        room_projected, shared = np.empty((3 * g, n), np.float32), np.empty((3 * h, n), np.float32)
        projected = np.empty((3 * h, p, n), np.float32)
        moves, last = np.empty((2, p, n), np.float32), np.empty((2, 1, n), np.float32)
        no_bias, nothing = np.zeros(k, np.float32), np.zeros((k, n), np.float32)
        of = of_group(trace, group % len(trace.own), shapes(weights, steps, n, p))
        for r in range(n):
            for lever in range(p):
                for unit in range(h):
                    of.levers[0, unit, lever * n + r] = state[begin + r, lever * h + unit]
            for unit in range(g):
                of.room[0, unit, r] = state[begin + r, p * h + unit]
        levers, room = of.levers[0], of.room[0]
        for step in range(steps):
            own, room_inputs, lever_inputs = (
                of.own[step],
                of.room_inputs[step],
                of.lever_inputs[step],
            )
            for r in range(n):
                seen = inputs[step, begin + r]
                for lever in range(p):
                    column = lever * n + r
                    own[0, column], own[1, column] = seen[lever], seen[p + lever]
                    own[2, column], own[3, column] = (
                        seen[2 * p + 2 + lever],
                        seen[3 * p + 2 + lever],
                    )
                    kept[column] = ZERO if fresh[step, begin + r] else ONE
                for number in range(SHARED):
                    value = seen[number + (2 if number < 2 else 4) * p]
                    room_inputs[number, r] = lever_inputs[number, r] = value
            levers = states_before(levers, kept, spare)
            room = states_before(room, kept[:n], room_spare)
            each_own, each_lever = own.reshape((OWN, p, n)), levers.reshape((h, p, n))
            summary, whole = room_inputs[SHARED:], of.whole[step]
            pool(each_lever, summary[:h], summary[h : 2 * h])
            acted_on(each_own, each_lever, summary[2 * h :])
            np.dot(weights.room_input.T, room_inputs, room_projected)
            add_to_rows(weights.room_input_bias[0], room_projected)
            gates, bias = of.room_gates[step], weights.room_hidden_bias[0]
            np.dot(weights.room_hidden.T, room, gates)
            gru(room_projected, bias, gates, room, of.room_new[step], whole[:g])
            room = whole[:g]

            copy(room, lever_inputs[SHARED:])
            np.dot(weights.lever_input[OWN:].T, lever_inputs, shared)
            add_to_rows(weights.lever_input_bias[0], shared)
            project(each_own, weights.lever_input, shared, projected)
            gates, bias = of.gates[step], weights.lever_hidden_bias[0]
            np.dot(weights.lever_hidden.T, levers, gates)
            after = of.after[step]
            gru(projected.reshape((3 * h, many)), bias, gates, levers, of.new[step], after)
            levers = after
            pool(levers.reshape((h, p, n)), whole[g : g + h], whole[g + h :])

            units, whole_units = of.read[step], of.whole_read[step]
            np.dot(weights.reads_lever.T, levers, units)
            np.dot(weights.reads_room.T, whole, whole_units)
            add_to_rows(weights.reads_room_bias[0], whole_units)
            moves[:], last[:] = ZERO, ZERO
            add_to_rows(weights.moves_bias[0], moves.reshape((2, many)))
            add_to_rows(weights.door_and_value_bias[0], last.reshape((2, n)))
            bias, each = weights.reads_lever_bias[0], units.reshape((k, p, n))
            read(each, bias, whole_units[:k], weights.moves, moves)
            each = whole_units[k:].reshape((k, 1, n))
            read(each, no_bias, nothing, weights.door_and_value, last)
            for r in range(n):
                found = logits[step, begin + r]
                for lever in range(p):
                    found[lever], found[p + lever] = moves[0, lever, r], moves[1, lever, r]
                found[2 * p], values[step, begin + r] = last[0, 0, r], last[1, 0, r]
        for r in range(n):
            for lever in range(p):
                for unit in range(h):
                    states[begin + r, lever * h + unit] = levers[unit, lever * n + r]
            for unit in range(g):
                states[begin + r, p * h + unit] = room[unit, r]
    return logits, values, states


@loops
def backward(
    weights: Weights,
    fresh: NDArray[np.bool_],
    trace: Trace,
    by_logits: Floats,
    by_values: Floats,
    gradients: Weights,
) -> None:
    """Add gradients by the weights.

    Args:
        weights: As for :func:`forward`.
        fresh: See there.
        trace: As :func:`forward` left it.
        by_logits: ``[T, M, A]`` gradients of a loss by the logits.
        by_values: ``[T, M]`` and by the values.
        gradients: Added to.
    """
    steps, rooms, actions = by_logits.shape
    p = (actions - 1) // 2
    h, g, k = len(weights.lever_hidden), len(weights.room_hidden), len(weights.moves)
    for group in range(len(trace.own)):
        begin = group * ROOMS
        n = min(ROOMS, rooms - begin)
        many = p * n
        kept = np.empty(many, np.float32)
        spare, room_spare = np.empty((h, many), np.float32), np.empty((g, n), np.float32)
        by_moves, by_last = np.empty((2, many), np.float32), np.empty((2, n), np.float32)
        by_read, by_whole_read = np.empty((k, many), np.float32), np.empty((2 * k, n), np.float32)
        by_levers, later_levers = np.empty((h, many), np.float32), np.zeros((h, many), np.float32)
        by_room, later_room = np.empty((g, n), np.float32), np.zeros((g, n), np.float32)
        by_whole, by_summary = (
            np.empty((g + 2 * h, n), np.float32),
            np.zeros((3 * h, n), np.float32),
        )
        by_inputs, by_gates = (
            np.empty((3 * h, many), np.float32),
            np.empty((3 * h, many), np.float32),
        )
        by_shared = np.empty((3 * h, n), np.float32)
        room_by_inputs = np.empty((3 * g, n), np.float32)
        room_by_gates = np.empty((3 * g, n), np.float32)
        of = of_group(trace, group, shapes(weights, steps, n, p))
        for step in range(steps - 1, -1, -1):
            for r in range(n):
                slopes = by_logits[step, begin + r]
                for lever in range(p):
                    column = lever * n + r
                    by_moves[0, column], by_moves[1, column] = slopes[lever], slopes[p + lever]
                    kept[column] = ZERO if fresh[step, begin + r] else ONE
                by_last[0, r], by_last[1, r] = slopes[2 * p], by_values[step, begin + r]
            own, after, whole = of.own[step], of.after[step], of.whole[step]
            levers = states_before(of.after[step - 1] if step else of.levers[0], kept, spare)
            room = of.whole[step - 1, :g] if step else of.room[0]
            room = states_before(room, kept[:n], room_spare)

            add_sums(by_moves, gradients.moves_bias[0])
            add_sums(by_last, gradients.door_and_value_bias[0])
            read_back(by_moves, of.read[step], weights.moves, gradients.moves, by_read)
            units, heads = of.whole_read[step, k:], weights.door_and_value
            read_back(by_last, units, heads, gradients.door_and_value, by_whole_read[k:])
            sum_over_levers(by_read.reshape((k, p, n)), by_whole_read[:k])
            add_sums(by_whole_read, gradients.reads_room_bias[0])
            add(np.dot(after, by_read.T), gradients.reads_lever)
            add(np.dot(whole, by_whole_read.T), gradients.reads_room)
            np.dot(weights.reads_lever, by_read, by_levers)
            np.dot(weights.reads_room, by_whole_read, by_whole)

            add(later_levers, by_levers)
            add(by_summary[: 2 * h], by_whole[g:])
            by_each, by_mean, by_most = (
                by_levers.reshape((h, p, n)),
                by_whole[g:],
                by_whole[g + h :],
            )
            pool_back(after.reshape((h, p, n)), whole[g + h :], by_mean, by_most, by_each)
            gru_back(by_levers, of.gates[step], of.new[step], levers, by_inputs, by_gates)
            sum_over_levers(by_inputs.reshape((3 * h, p, n)), by_shared)
            add_sums(by_shared, gradients.lever_input_bias[0])
            add_sums(by_gates, gradients.lever_hidden_bias[0])
            add(np.dot(own, by_inputs.T), gradients.lever_input[:OWN])
            add(np.dot(of.lever_inputs[step], by_shared.T), gradients.lever_input[OWN:])
            add(np.dot(levers, by_gates.T), gradients.lever_hidden)
            np.dot(weights.lever_hidden, by_gates, later_levers)
            add(by_levers, later_levers)

            np.dot(weights.lever_input[OWN + SHARED :], by_shared, by_room)
            add(by_whole[:g], by_room)
            add(later_room, by_room)
            gates, new = of.room_gates[step], of.room_new[step]
            gru_back(by_room, gates, new, room, room_by_inputs, room_by_gates)
            add_sums(room_by_inputs, gradients.room_input_bias[0])
            add_sums(room_by_gates, gradients.room_hidden_bias[0])
            add(np.dot(of.room_inputs[step], room_by_inputs.T), gradients.room_input)
            add(np.dot(room, room_by_gates.T), gradients.room_hidden)
            np.dot(weights.room_hidden, room_by_gates, later_room)
            add(by_room, later_room)
            np.dot(weights.room_input[SHARED:], room_by_inputs, by_summary)
            by_each = later_levers.reshape((h, p, n))
            acted_on_back(own.reshape((OWN, p, n)), by_summary[2 * h :], by_each)
            if kept.min() < ONE:
                reset(later_levers, kept)
                reset(later_room, kept[:n])
                reset(by_summary, kept[:n])
    add(gradients.reads_room_bias[:, :k], gradients.reads_lever_bias)
