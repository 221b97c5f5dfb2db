"""A schema compiled into a finite state machine: integer tables over states and actions.

A *state* says which levers are pushed and whether the door is open: bit *i* of the state is lever
*i*, the bit above the levers is the door. An *action* pushes or pulls one lever or pushes the
door; with *n* levers, actions 0..n-1 push, n..2n-1 pull, and 2n pushes the door. Levers have roles
here and no positions; :mod:`causal_openlock.world.room` adds the positions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.schema import DOOR, Schema

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
FloatArray = NDArray[np.float64]

NO_SOLUTION = -1


@dataclass(frozen=True, eq=False)
class FSM:
    """A finite state machine; S states, A actions.

    Example:
        >>> from causal_openlock import find_schema
        >>> fsm = compile_schema(find_schema("CC3"))
        >>> fsm.describe(fsm.next_state[0b001, 1])  # action 1 pushes L1
        'L0 L1 pushed, unlocked'
    """

    schema: Schema  #: what it was compiled from
    next_state: IntArray  #: ``[S, A]`` the state after an action; the same where it does nothing
    chance: FloatArray  #: ``[S, A]`` its probability to take effect; 0 where it can do nothing
    unlocked: BoolArray  #: ``[S]`` whether the door is unlocked
    solution: IntArray  #: ``[S]`` the solution whose levers are pushed, inert ones aside; or -1

    @property
    def levers(self) -> int:
        """Number of levers."""
        return len(self.schema.levers)

    @property
    def states(self) -> int:
        """Number of states, S."""
        return len(self.unlocked)

    @property
    def actions(self) -> int:
        """Number of actions, A: a push and a pull for each lever, and the push of the door."""
        return 2 * self.levers + 1

    @property
    def opened(self) -> BoolArray:
        """``[S]`` whether the door is open."""
        return np.arange(self.states) >> self.levers == 1

    def describe(self, state: int) -> str:
        """A state in words, such as ``L0 L1 pushed, unlocked``."""
        pushed = [lever for bit, lever in enumerate(self.schema.levers) if state >> bit & 1]
        levers = f"{' '.join(pushed)} pushed" if pushed else "all pulled"
        lock = "unlocked" if self.unlocked[state] else "locked"
        return f"{levers}, {lock}{', open' if state >> self.levers else ''}"

    def action_name(self, action: int) -> str:
        """An action in words, such as ``push L0`` or ``push door``."""
        if action == 2 * self.levers:
            return f"push {DOOR}"
        verb = "pull" if action >= self.levers else "push"
        return f"{verb} {self.schema.levers[action % self.levers]}"


def compile_schema(schema: Schema) -> FSM:
    """Compile a schema into its finite state machine.

    A pull is enabled under the same conditions as a push, and takes effect with the same
    probability. With *n* levers the tables have 2^(n+1) states: 32 for the paper's four levers,
    8,192 for twelve.

    Example:
        >>> from causal_openlock import find_schema
        >>> compile_schema(find_schema("CC3")).next_state.shape
        (16, 7)
    """
    levers = len(schema.levers)
    pushed = np.arange(1 << levers)
    door_action, door_bit = 2 * levers, 1 << levers

    unlocked = schema.holds(DOOR, pushed)
    next_state = np.tile(pushed[:, None], (2, 2 * levers + 1))
    next_state[len(pushed) :] |= door_bit
    chance = np.zeros(next_state.shape)
    for bit, lever in enumerate(schema.levers):
        moves, is_pushed = gate_chance(schema, lever, pushed), pushed >> bit & 1 == 1
        for action, possible in ((bit, ~is_pushed), (levers + bit, is_pushed)):
            chance[:, action] = np.tile(moves * possible, 2)
            next_state[chance[:, action] > 0, action] ^= 1 << bit
    closed = slice(0, len(pushed))
    chance[closed, door_action] = gate_chance(schema, DOOR, pushed) * unlocked
    next_state[closed, door_action] |= door_bit * unlocked

    relevant = pushed & ~schema.mask(schema.inert)
    solution = np.full(len(pushed), NO_SOLUTION)
    for index, needed in enumerate(schema.solutions):
        solution[relevant == schema.mask(needed)] = index
    return FSM(schema, next_state, chance, np.tile(unlocked, 2), np.tile(solution, 2))


def gate_chance(schema: Schema, node: str, pushed: IntArray) -> FloatArray:
    """``[2^n]`` probability that a push or pull of ``node`` takes effect, by the levers pushed.

    Each pushed cause transmits independently with its strength; the push or pull takes effect if at
    least as many transmit as the gate requires. This adds up the distribution of that number cause
    by cause, and treats all numbers above the threshold as one.
    """
    threshold = schema.threshold(node)
    counts = np.zeros((threshold + 1, len(pushed)))
    counts[0] = 1.0
    for cause, strength in zip(schema.causes(node), schema.strengths(node), strict=True):
        transmits = strength * (pushed >> schema.levers.index(cause) & 1)
        shifted = counts * transmits
        counts -= shifted
        counts[1:] += shifted[:-1]
        counts[-1] += shifted[-1]
    return np.minimum(counts[threshold], 1.0)  # rounding may end just above 1
