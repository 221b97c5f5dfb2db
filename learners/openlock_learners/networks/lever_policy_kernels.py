"""A lever policy's course over many steps, and its gradients through time, as compiled loops.

What is computed is :meth:`~openlock_learners.networks.recurrent_policy.LeverPolicy.forward`, of one
network, and the loss of :class:`~openlock_learners.networks.ppo.PPO`: torch goes through memory for
every gate of every lever, and that takes longer than the products. Here a group of rooms at a time
goes through all steps, forward and back, so that what it leaves is still in the processor's cache
when it is needed. Products are those of the BLAS library. Rooms are the last axis of every array,
so that loops between two products run over rooms and become vector instructions; each loop names
few arrays, or the compiler would not see that they are apart.

:func:`forward` keeps in a :class:`Trace` what :func:`backward` needs. A trace is most of what goes
through memory, so it holds nothing twice: the state before a step is that after the step before.
A group is always computed whole; where it has fewer rooms, the columns left are of rooms
that were there before, and nothing is read from them or learned by them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openlock_learners.networks.double_q_kernels import inlined, loops, reassociated
from openlock_learners.networks.recurrent_policy import OWN, SHARED

Floats = NDArray[np.float32]
Flags = NDArray[np.bool_]
Rooms = NDArray[np.int64]

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
    """The weights of one network, in the order of a ``LeverPolicy``'s parameters, or gradients.

    Gradients are transposed.
    """

    room_input: Floats  # [9 + 3H, 3G]
    room_hidden: Floats  # [G, 3G]
    room_input_bias: Floats  # biases are [1, out]
    room_hidden_bias: Floats
    lever_own: Floats  # [4, 3H] of a lever's inputs, from what is perceived of it
    lever_shared: Floats  # [9 + G, 3H] and from what all levers share
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


class Perceived(NamedTuple):
    """Numbers that M rooms are perceived by, in T steps."""

    inputs: Floats  # [T, M, in]
    state: Floats  # [M, S] hidden state before the first step
    fresh: Flags  # [T, M] steps before which the hidden state is reset


class Taken(NamedTuple):
    """Actions in M rooms, in T steps, and what :class:`~.ppo.PPO` learns from them, ``[T, M]``."""

    factors: Floats  # [3] the clip, and the weights of values' errors and of entropy in the loss
    action: NDArray[np.int64]
    log_prob: Floats  # of the action, under the policy that took it
    advantage: Floats
    returns: Floats
    mask: Flags  # the step happened


class Trace(NamedTuple):
    """Intermediate results of a group of R rooms in T steps; L stands for its P * R levers."""

    own: Floats  # [T, 4, P, R] what is perceived of each lever
    kept: Floats  # [T, R] 0 where the hidden state is reset before the step, otherwise 1
    levers: Floats  # [T + 1, H, L] hidden states, the first before the first step
    gates: Floats  # [T, 3H, L] reset and update gates, and the last state's part in new content
    new: Floats  # [T, H, L] new content
    read: Floats  # [T, K, L] units that read a lever
    whole: Floats  # [T + 1, 9 + G + 2H, R] perceived; room's state, levers' mean and maximum after
    room_inputs: Floats  # [T, 9 + 3H, R] what is perceived, levers' mean and maximum, the last one
    room_gates: Floats  # [T, 3G, R]
    room_new: Floats  # [T, G, R]
    whole_read: Floats  # [T, 2K, R] units that read the room's state, and levers' mean and maximum
    outputs: Floats  # [T, A + 1, R] logits and value; then a loss's gradients by them


def new_trace(weights: Weights, steps: int, positions: int) -> Trace:
    """Make room for a trace; one that is used again is quicker than memory just handed out."""
    h, g, k = len(weights.lever_hidden), len(weights.room_hidden), len(weights.moves)
    many = positions * ROOMS
    shapes = (
        (steps, OWN, positions, ROOMS),
        (steps, ROOMS),
        (steps + 1, h, many),
        (steps, 3 * h, many),
        (steps, h, many),
        (steps, k, many),
        (steps + 1, SHARED + g + 2 * h, ROOMS),
        (steps, SHARED + 3 * h, ROOMS),
        (steps, 3 * g, ROOMS),
        (steps, g, ROOMS),
        (steps, 2 * k, ROOMS),
        (steps, 2 * positions + 2, ROOMS),
    )
    return Trace(*(np.zeros(shape, np.float32) for shape in shapes))


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
    for row in range(len(values)):
        for column in range(values.shape[1]):
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
    """Add the sum of each row of a matrix to ``[rows, 1]``."""
    for row in range(len(values)):
        total = ZERO
        for column in range(values.shape[1]):
            total += values[row, column]
        output[row, 0] += total


@loops
def turn(matrix: Floats, turned: Floats) -> None:
    """Transpose a matrix; BLAS takes half as long again for a product whose right side it turns."""
    for column in range(matrix.shape[1]):
        for row in range(len(matrix)):
            turned[column, row] = matrix[row, column]


@loops
def add_product(slopes: Floats, inputs: Floats, spare: Floats, output: Floats) -> None:
    """Add ``slopes @ inputs.T`` to a matrix."""
    turned = spare[: inputs.size].reshape((inputs.shape[1], len(inputs)))
    turn(inputs, turned)
    add(np.dot(slopes, turned), output)


@loops
def times_kept(states: Floats, kept: Floats, output: Floats) -> None:
    """Copy states, one or more for each of R rooms, as zeros where a room's are not kept."""
    shape = len(states), states.shape[1] // ROOMS, ROOMS
    each, copied = states.reshape(shape), output.reshape(shape)
    for row in range(shape[0]):
        for column in range(shape[1]):
            for room in range(ROOMS):
                copied[row, column, room] = each[row, column, room] * kept[room]


@loops
def states_before(states: Floats, kept: Floats, spare: Floats) -> Floats:
    """The states, or, if some of them are reset before the step, a copy where they are."""
    if kept.min() == ONE:
        return states
    times_kept(states, kept, spare)
    return spare


@loops
def pool(levers: Floats, mean: Floats, most: Floats) -> None:
    """Mean and maximum, ``[H, R]``, over the levers, ``[H, P, R]``."""
    units, positions, _ = levers.shape
    share = ONE / np.float32(positions)
    for unit in range(units):
        for room in range(ROOMS):
            mean[unit, room] = levers[unit, 0, room]
            most[unit, room] = levers[unit, 0, room]
        for position in range(1, positions):
            for room in range(ROOMS):
                lever = levers[unit, position, room]
                highest = most[unit, room]
                mean[unit, room] += lever
                most[unit, room] = lever if lever > highest else highest
        for room in range(ROOMS):
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
    """The state of the lever acted on, ``[H, R]``; zeros if it was none."""
    units, positions, _ = levers.shape
    for unit in range(units):
        for room in range(ROOMS):
            last[unit, room] = ZERO
        for position in range(positions):
            for room in range(ROOMS):
                acted = own[2, position, room] + own[3, position, room]
                last[unit, room] += acted * levers[unit, position, room]


@loops
def acted_on_back(own: Floats, by_last: Floats, by_levers: Floats) -> None:
    """Add gradients through :func:`acted_on`."""
    units, positions, _ = by_levers.shape
    for unit in range(units):
        for position in range(positions):
            for room in range(ROOMS):
                acted = own[2, position, room] + own[3, position, room]
                by_levers[unit, position, room] += acted * by_last[unit, room]


@loops
def project(own: Floats, weights: Floats, shared: Floats, projected: Floats) -> None:
    """Contributions of inputs to gates of levers, ``[3H, P, R]``; the room's is ``shared``."""
    rows, positions, _ = projected.shape
    for row in range(rows):
        push, grey, pushed, pulled = (
            weights[0, row],
            weights[1, row],
            weights[2, row],
            weights[3, row],
        )
        for position in range(positions):
            for room in range(ROOMS):
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
def open_units(units: Floats, bias: Floats, shared: Floats) -> None:
    """Add biases and what is ``shared`` by all levers to units, ``[K, P, R]``; none is negative."""
    many, positions, _ = units.shape
    for unit in range(many):
        for position in range(positions):
            for room in range(ROOMS):
                total = units[unit, position, room] + (bias[unit] + shared[unit, room])
                units[unit, position, room] = ZERO if total < ZERO else total


@loops
def close_units(units: Floats, by_units: Floats) -> None:
    """Set gradients by units to zero where the units are."""
    for row in range(len(units)):
        for column in range(units.shape[1]):
            slope = by_units[row, column]
            by_units[row, column] = slope if units[row, column] > ZERO else ZERO


@loops
def sum_over_levers(values: Floats, sums: Floats) -> None:
    """The sum over the levers of ``[rows, P, R]``, ``[rows, R]``."""
    rows, positions, rooms = values.shape
    for row in range(rows):
        for room in range(rooms):
            sums[row, room] = values[row, 0, room]
        for position in range(1, positions):
            for room in range(rooms):
                sums[row, room] += values[row, position, room]


@loops
def perceive(seen: Perceived, rooms: Rooms, trace: Trace) -> None:
    """Sort what is perceived of a group's rooms, which are ``rooms`` among M, into its trace."""
    steps, _, p, _ = trace.own.shape
    h, g = trace.new.shape[1], trace.room_new.shape[1]
    for r in range(len(rooms)):
        for lever in range(p):
            for unit in range(h):
                trace.levers[0, unit, lever * ROOMS + r] = seen.state[rooms[r], lever * h + unit]
        for unit in range(g):
            trace.whole[0, SHARED + unit, r] = seen.state[rooms[r], p * h + unit]
    for step in range(steps):
        own, inputs, whole = trace.own[step], trace.room_inputs[step], trace.whole[step + 1]
        for r in range(len(rooms)):
            numbers = seen.inputs[step, rooms[r]]
            for lever in range(p):
                own[0, lever, r], own[1, lever, r] = numbers[lever], numbers[p + lever]
                own[2, lever, r] = numbers[2 * p + 2 + lever]
                own[3, lever, r] = numbers[3 * p + 2 + lever]
            for number in range(SHARED):
                value = numbers[number + (2 if number < 2 else 4) * p]
                inputs[number, r] = whole[number, r] = value
            trace.kept[step, r] = ZERO if seen.fresh[step, rooms[r]] else ONE


@loops
def forward(weights: Weights, trace: Trace) -> None:
    """Run over the T steps that a trace has perceived, and fill it."""
    steps, _, p, _ = trace.own.shape
    h, g, k = len(weights.lever_hidden), len(weights.room_hidden), len(weights.moves)
    many, pooled = p * ROOMS, SHARED + g
    spare, room_spare = np.empty((h, many), np.float32), np.empty((g, ROOMS), np.float32)
    room_projected = np.empty((3 * g, ROOMS), np.float32)
    shared = np.empty((3 * h, ROOMS), np.float32)
    projected = np.empty((3 * h, p, ROOMS), np.float32)
    no_bias, nothing = np.zeros(k, np.float32), np.zeros((k, ROOMS), np.float32)
    whole = trace.whole[0]
    pool(trace.levers[0].reshape((h, p, ROOMS)), whole[pooled : pooled + h], whole[pooled + h :])
    for step in range(steps):
        own, kept, inputs = trace.own[step], trace.kept[step], trace.room_inputs[step]
        before, whole = trace.whole[step], trace.whole[step + 1]
        levers = states_before(trace.levers[step], kept, spare)
        room = states_before(before[SHARED:pooled], kept, room_spare)
        summary = inputs[SHARED:]
        times_kept(before[pooled:], kept, summary[: 2 * h])
        acted_on(own, levers.reshape((h, p, ROOMS)), summary[2 * h :])
        np.dot(weights.room_input.T, inputs, room_projected)
        add_to_rows(weights.room_input_bias[0], room_projected)
        gates, bias = trace.room_gates[step], weights.room_hidden_bias[0]
        np.dot(weights.room_hidden.T, room, gates)
        gru(room_projected, bias, gates, room, trace.room_new[step], whole[SHARED:pooled])

        np.dot(weights.lever_shared.T, whole[:pooled], shared)
        add_to_rows(weights.lever_input_bias[0], shared)
        project(own, weights.lever_own, shared, projected)
        gates, bias = trace.gates[step], weights.lever_hidden_bias[0]
        np.dot(weights.lever_hidden.T, levers, gates)
        after = trace.levers[step + 1]
        gru(projected.reshape((3 * h, many)), bias, gates, levers, trace.new[step], after)
        pool(after.reshape((h, p, ROOMS)), whole[pooled : pooled + h], whole[pooled + h :])

        units, whole_units, outputs = trace.read[step], trace.whole_read[step], trace.outputs[step]
        np.dot(weights.reads_lever.T, after, units)
        np.dot(weights.reads_room.T, whole[SHARED:], whole_units)
        add_to_rows(weights.reads_room_bias[0], whole_units)
        bias = weights.reads_lever_bias[0]
        open_units(units.reshape((k, p, ROOMS)), bias, whole_units[:k])
        open_units(whole_units[k:].reshape((k, 1, ROOMS)), no_bias, nothing)
        moves, last = outputs[: 2 * p].reshape((2, many)), outputs[2 * p :]
        np.dot(weights.moves.T, units, moves)
        np.dot(weights.door_and_value.T, whole_units[k:], last)
        add_to_rows(weights.moves_bias[0], moves)
        add_to_rows(weights.door_and_value_bias[0], last)


@loops
def backward(weights: Weights, trace: Trace, gradients: Weights) -> None:
    """Add gradients by the weights, each transposed, to ``gradients``.

    ``trace.outputs`` holds those by the outputs, and the rest of the trace is as :func:`forward`
    left it.
    """
    steps, _, p, _ = trace.own.shape
    h, g, k = len(weights.lever_hidden), len(weights.room_hidden), len(weights.moves)
    many, pooled = p * ROOMS, SHARED + g
    spare, room_spare = np.empty((h, many), np.float32), np.empty((g, ROOMS), np.float32)
    turned = np.empty(max(OWN * many, (pooled + 3 * h) * ROOMS), np.float32)
    turned_levers, turned_after = np.empty((many, h), np.float32), np.empty((many, h), np.float32)
    turn(trace.levers[steps], turned_levers)
    by_read, by_whole_read = np.empty((k, many), np.float32), np.empty((2 * k, ROOMS), np.float32)
    by_levers, later_levers = np.empty((h, many), np.float32), np.zeros((h, many), np.float32)
    by_room, later_room = np.empty((g, ROOMS), np.float32), np.zeros((g, ROOMS), np.float32)
    by_whole = np.empty((g + 2 * h, ROOMS), np.float32)
    by_summary = np.zeros((3 * h, ROOMS), np.float32)
    by_inputs, by_gates = np.empty((3 * h, many), np.float32), np.empty((3 * h, many), np.float32)
    by_shared = np.empty((3 * h, ROOMS), np.float32)
    room_by_inputs = np.empty((3 * g, ROOMS), np.float32)
    room_by_gates = np.empty((3 * g, ROOMS), np.float32)
    for step in range(steps - 1, -1, -1):
        own, kept, slopes = trace.own[step], trace.kept[step], trace.outputs[step]
        by_moves, by_last = slopes[: 2 * p].reshape((2, many)), slopes[2 * p :]
        after, whole = trace.levers[step + 1], trace.whole[step + 1]
        levers = states_before(trace.levers[step], kept, spare)
        room = states_before(trace.whole[step, SHARED:pooled], kept, room_spare)

        add_sums(by_moves, gradients.moves_bias)
        add_sums(by_last, gradients.door_and_value_bias)
        units, last_units = trace.read[step], trace.whole_read[step, k:]
        add(np.dot(by_moves, units.T), gradients.moves)
        add(np.dot(by_last, last_units.T), gradients.door_and_value)
        np.dot(weights.moves, by_moves, by_read)
        np.dot(weights.door_and_value, by_last, by_whole_read[k:])
        close_units(units, by_read)
        close_units(last_units, by_whole_read[k:])
        sum_over_levers(by_read.reshape((k, p, ROOMS)), by_whole_read[:k])
        add_sums(by_whole_read, gradients.reads_room_bias)
        add_sums(by_whole_read[:k], gradients.reads_lever_bias)
        turned_levers, turned_after = turned_after, turned_levers
        turn(trace.levers[step], turned_levers)
        add(np.dot(by_read, turned_after), gradients.reads_lever)
        add_product(by_whole_read, whole[SHARED:], turned, gradients.reads_room)
        np.dot(weights.reads_lever, by_read, by_levers)
        np.dot(weights.reads_room, by_whole_read, by_whole)

        add(later_levers, by_levers)
        add(by_summary[: 2 * h], by_whole[g:])
        each, by_each = after.reshape((h, p, ROOMS)), by_levers.reshape((h, p, ROOMS))
        pool_back(each, whole[pooled + h :], by_whole[g:], by_whole[g + h :], by_each)
        gru_back(by_levers, trace.gates[step], trace.new[step], levers, by_inputs, by_gates)
        sum_over_levers(by_inputs.reshape((3 * h, p, ROOMS)), by_shared)
        add_sums(by_shared, gradients.lever_input_bias)
        add_sums(by_gates, gradients.lever_hidden_bias)
        add_product(by_inputs, own.reshape((OWN, many)), turned, gradients.lever_own)
        add_product(by_shared, whole[:pooled], turned, gradients.lever_shared)
        if kept.min() < ONE:  # the state before is zero there
            times_kept(by_gates, kept, by_gates)
        add(np.dot(by_gates, turned_levers), gradients.lever_hidden)
        np.dot(weights.lever_hidden, by_gates, later_levers)
        add(by_levers, later_levers)

        np.dot(weights.lever_shared[SHARED:], by_shared, by_room)
        add(by_whole[:g], by_room)
        add(later_room, by_room)
        gates, new = trace.room_gates[step], trace.room_new[step]
        gru_back(by_room, gates, new, room, room_by_inputs, room_by_gates)
        add_sums(room_by_inputs, gradients.room_input_bias)
        add_sums(room_by_gates, gradients.room_hidden_bias)
        add_product(room_by_inputs, trace.room_inputs[step], turned, gradients.room_input)
        add_product(room_by_gates, room, turned, gradients.room_hidden)
        np.dot(weights.room_hidden, room_by_gates, later_room)
        add(by_room, later_room)
        np.dot(weights.room_input[SHARED:], room_by_inputs, by_summary)
        acted_on_back(own, by_summary[2 * h :], later_levers.reshape((h, p, ROOMS)))
        if kept.min() < ONE:
            for later in (later_levers, later_room, by_summary):
                times_kept(later, kept, later)


@loops
def run(weights: Weights, seen: Perceived, trace: Trace) -> tuple[Floats, Floats, Floats]:
    """Run over T steps.

    Returns:
        ``[T, M, A]`` logits, ``[T, M]`` values, and ``[M, S]`` the last hidden state.
    """
    steps, many = seen.fresh.shape
    p, h, g = trace.own.shape[2], trace.new.shape[1], trace.room_new.shape[1]
    logits = np.empty((steps, many, 2 * p + 1), np.float32)
    values, states = np.empty((steps, many), np.float32), np.empty_like(seen.state)
    every = np.arange(many)
    for begin in range(0, many, ROOMS):
        rooms = every[begin : begin + ROOMS]
        perceive(seen, rooms, trace)
        forward(weights, trace)
        for r in range(len(rooms)):
            for step in range(steps):
                for action in range(2 * p + 1):
                    logits[step, rooms[r], action] = trace.outputs[step, action, r]
                values[step, rooms[r]] = trace.outputs[step, 2 * p + 1, r]
            for lever in range(p):
                for unit in range(h):
                    after = trace.levers[steps, unit, lever * ROOMS + r]
                    states[rooms[r], lever * h + unit] = after
            for unit in range(g):
                states[rooms[r], p * h + unit] = trace.whole[steps, SHARED + unit, r]
    return logits, values, states


@loops
def loss_slopes(taken: Taken, rooms: Rooms, outputs: Floats, sums: NDArray[np.float64]) -> None:
    """Replace outputs, ``[T, A + 1, R]``, by gradients of the loss, summed over steps.

    Added to ``sums``: the entropy, the values' squared error, and the ratios that were clipped.
    """
    clip, value_weight, entropy_weight = taken.factors[0], taken.factors[1], taken.factors[2]
    steps, width, _ = outputs.shape
    actions = width - 1
    log_probs, probs = np.empty(actions, np.float32), np.empty(actions, np.float32)
    for step in range(steps):
        found = outputs[step]
        for r in range(ROOMS):
            if r >= len(rooms) or not taken.mask[step, rooms[r]]:
                for number in range(width):
                    found[number, r] = ZERO
                continue
            room = rooms[r]
            most, total = found[0, r], ZERO
            for action in range(1, actions):
                most = max(most, found[action, r])
            for action in range(actions):
                log_probs[action] = found[action, r] - most
                probs[action] = np.exp(log_probs[action])
                total += probs[action]
            log_total, entropy = np.log(total), ZERO
            for action in range(actions):
                log_probs[action] -= log_total
                probs[action] /= total
                entropy -= probs[action] * log_probs[action]
            done, advantage = taken.action[step, room], taken.advantage[step, room]
            ratio = np.exp(log_probs[done] - taken.log_prob[step, room])
            clipped = min(max(ratio, ONE - clip), ONE + clip)
            # Beyond the bound, the ratio's gradient is 0.
            by_log_prob = -ratio * advantage if ratio * advantage <= clipped * advantage else ZERO
            for action in range(actions):
                of_action = ONE if action == done else ZERO
                by_entropy = -probs[action] * (log_probs[action] + entropy)
                found[action, r] = by_log_prob * (of_action - probs[action])
                found[action, r] -= entropy_weight * by_entropy
            error = found[actions, r] - taken.returns[step, room]
            found[actions, r] = value_weight * (error + error)
            sums[0] += entropy
            sums[1] += error * error
            sums[2] += ratio != clipped


@loops
def learn(
    weights: Weights, seen: Perceived, taken: Taken, rooms: Rooms, trace: Trace, gradients: Weights
) -> NDArray[np.float64]:
    """Add gradients of PPO's loss, summed over the steps of some of M rooms.

    Args:
        weights: The network.
        seen: All rooms.
        taken: See :class:`Taken`.
        rooms: ``[n]`` the rooms to learn from.
        trace: Overwritten.
        gradients: Added to; each is transposed.

    Returns:
        ``[3]`` sums of the entropy, the values' squared error, and the ratios that were clipped.
    """
    sums = np.zeros(3)
    for begin in range(0, len(rooms), ROOMS):
        group = rooms[begin : begin + ROOMS]
        perceive(seen, group, trace)
        forward(weights, trace)
        loss_slopes(taken, group, trace.outputs, sums)
        backward(weights, trace, gradients)
    return sums
