"""Recurrent networks that choose actions: a policy, and a value of the reward still to come.

:class:`LeverPolicy` treats all positions alike: every lever has a small hidden state of its own,
all of them are updated by the same weights, and one more state belongs to the room as a whole. What
was learned about one position so holds for every other, and in rooms of any size. This is built in
and not learned, and it is all that is built in; :class:`FlatPolicy`, an ordinary recurrent network,
has nothing built in, to show what the assumption is worth.

As in :mod:`openlock_learners.networks.recurrent_cells`, N networks are one: their weights are ``[N,
in, out]``. Meta-training has a single network in many rooms; subjects that continue to learn have
one each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from causal_openlock.files.validation import StrictModel
from openlock_learners.networks.recurrent_cells import StackedGRU, StackedLinear

OWN, SHARED = 4, 9
"""Numbers perceived of each lever (pushed, grey, just pushed, just pulled), and of the room."""
MOST_UNITS = 1024
"""The largest size that a network may have."""
Units = Annotated[int, Field(ge=1, le=MOST_UNITS)]


class Sizes(StrictModel):
    """Kind and sizes of a network, as in a checkpoint and in a file of meta-training.

    Attributes:
        kind: ``levers``, :class:`LeverPolicy`, or ``flat``, :class:`FlatPolicy`.
        lever: Hidden units of each lever, H; a flat policy has none.
        room: Hidden units of the room as a whole, G.
        reader: Units of the layer that reads the hidden state.
    """

    kind: Literal["levers", "flat"] = "levers"
    lever: Units = 32
    room: Units = 48
    reader: Units = 48


def split(inputs: Tensor, positions: int) -> tuple[Tensor, Tensor]:
    """Sort the output of :class:`~openlock_learners.networks.perception.Perception` by lever.

    That is ``[..., P, 4]`` of each lever and ``[..., 9]`` of the room, from ``[..., in]``.
    """
    pushed, grey, door, push, pull, rest = torch.split(
        inputs,
        [positions, positions, 2, positions, positions, inputs.shape[-1] - 4 * positions - 2],
        -1,
    )
    return torch.stack([pushed, grey, push, pull], dim=-1), torch.cat([door, rest], dim=-1)


class RecurrentPolicy(nn.Module, ABC):
    """N recurrent networks with a policy and a value.

    Attributes:
        sizes: Kind and sizes.
        positions: Levers of the rooms that it fits, if it does not fit them all.
    """

    sizes: Sizes
    positions: int | None = None

    @abstractmethod
    def state_size(self, positions: int) -> int:
        """Numbers in a hidden state for a room with this number of positions, S."""

    @abstractmethod
    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Run over T steps.

        Args:
            inputs: ``[N, T, M, in]`` what each network perceives in M rooms at T steps.
            state: ``[N, M, S]`` hidden state before the first step.
            fresh: ``[N, T, M]`` steps before which the hidden state is reset; by default none.

        Returns:
            ``[N, T, M, A]`` logits of the actions, ``[N, T, M]`` values, and ``[N, M, S]`` the last
            hidden state.
        """

    @torch.no_grad()
    def step(self, inputs: Tensor, state: Tensor, fresh: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Run over one step; all shapes are as for :meth:`forward`, without T."""
        logits, values, state = self(inputs[:, None], state, fresh[:, None])
        return logits[:, 0], values[:, 0], state


class LeverPolicy(RecurrentPolicy):
    """Networks with a hidden state for each lever, wherever it is.

    The room's state is updated from what is perceived of the room, from the states of all levers
    (their mean and their maximum) and from that of the lever acted on last; each lever's from what
    is perceived of it, and from the room's. A lever's own state and the room's then give the logits
    of pushing it and of pulling it.
    """

    def __init__(self, sizes: Sizes, generators: Sequence[np.random.Generator]) -> None:
        super().__init__()
        self.sizes = sizes
        lever, room, reader = sizes.lever, sizes.room, sizes.reader
        self.room = StackedGRU(SHARED + 3 * lever, room, generators)
        self.lever = StackedGRU(OWN + SHARED + room, lever, generators)
        self.reads_lever = StackedLinear(lever, reader, generators)
        self.reads_room = StackedLinear(room + 2 * lever, 2 * reader, generators)
        self.moves = StackedLinear(reader, 2, generators)
        self.door_and_value = StackedLinear(reader, 2, generators)
        _make_undecided(self.moves, self.door_and_value)

    def state_size(self, positions: int) -> int:
        """H for each lever, and G."""
        return positions * self.sizes.lever + self.sizes.room

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Run over T steps; see :class:`RecurrentPolicy`."""
        networks, steps, rooms, width = inputs.shape
        size = self.sizes
        positions = (width - SHARED) // OWN
        own, shared = split(inputs, positions)
        acted = (own[..., 2] + own[..., 3]).unbind(1)
        # What depends on no step before goes through one product for all steps.
        weight = self.lever.input_weight
        projected_own = torch.bmm(own.flatten(1, 3), weight[:, :OWN])
        lever_inputs = projected_own.view(networks, steps, rooms, positions, -1).unbind(1)
        now = torch.bmm(shared.flatten(1, 2), weight[:, OWN : OWN + SHARED])
        shared_inputs = (now + self.lever.input_bias).view(networks, steps, rooms, 1, -1).unbind(1)
        from_room = weight[:, OWN + SHARED :]
        weight = self.room.input_weight
        now = torch.baddbmm(self.room.input_bias, shared.flatten(1, 2), weight[:, :SHARED])
        room_inputs = now.view(networks, steps, rooms, -1).unbind(1)
        from_levers = weight[:, SHARED:]

        end = positions * size.lever
        levers = state[..., :end].reshape(networks, rooms, positions, size.lever)
        room = state[..., end:]
        all_levers, all_rooms = [], []
        pooled = _pooled(levers)
        for step in range(steps):
            if fresh is not None and bool(fresh[:, step].any()):
                kept = (~fresh[:, step]).to(levers.dtype)[..., None]
                room, levers, pooled = room * kept, levers * kept[..., None], pooled * kept
            last = (acted[step][..., None] * levers).sum(dim=2)
            summary = torch.cat([pooled, last], dim=-1)
            projected = torch.baddbmm(room_inputs[step], summary, from_levers)
            recurrent = torch.baddbmm(self.room.hidden_bias, room, self.room.hidden_weight)
            room = self.room.step(projected, recurrent, room)
            recurrent = torch.baddbmm(
                self.lever.hidden_bias, levers.flatten(1, 2), self.lever.hidden_weight
            )
            shared = shared_inputs[step] + torch.bmm(room, from_room)[:, :, None]
            projected = lever_inputs[step] + shared
            recurrent = recurrent.view(networks, rooms, positions, -1)
            levers = self.lever.step(projected, recurrent, levers)
            pooled = _pooled(levers)
            all_levers.append(levers)
            all_rooms.append(torch.cat([room, pooled], dim=-1))
        logits, values = self._read(torch.stack(all_levers, dim=1), torch.stack(all_rooms, dim=1))
        return logits, values, torch.cat([levers.flatten(2), room], dim=-1)

    def _read(self, levers: Tensor, room: Tensor) -> tuple[Tensor, Tensor]:
        """Logits and values from ``[N, T, M, P, H]`` of the levers and ``[N, T, M, ...]``."""
        shape = levers.shape
        whole = self.reads_room(room.flatten(1, 2)).view(*shape[:3], -1)
        for_levers, for_room = whole.chunk(2, dim=-1)
        each = self.reads_lever(levers.flatten(1, 3)).view(*shape[:4], -1)
        each = torch.relu(each + for_levers[..., None, :])
        moves = self.moves(each.flatten(1, 3)).view(*shape[:4], 2)
        last = self.door_and_value(torch.relu(for_room).flatten(1, 2)).view(*shape[:3], 2)
        logits = torch.cat([moves[..., 0], moves[..., 1], last[..., :1]], dim=-1)
        return logits, last[..., 1]


def _pooled(levers: Tensor) -> Tensor:
    """``[N, M, 2H]`` mean and maximum over the levers, ``[N, M, P, H]``."""
    return torch.cat([levers.mean(dim=2), levers.amax(dim=2)], dim=-1)


class FlatPolicy(RecurrentPolicy):
    """A plain recurrent network, with inputs and actions of each position of its own."""

    def __init__(
        self, sizes: Sizes, positions: int, generators: Sequence[np.random.Generator]
    ) -> None:
        super().__init__()
        self.sizes, self.positions = sizes, positions
        self.room = StackedGRU(OWN * positions + SHARED, sizes.room, generators)
        self.reads = StackedLinear(sizes.room, 2 * sizes.reader, generators)
        self.moves = StackedLinear(sizes.reader, 2 * positions + 1, generators)
        self.value = StackedLinear(sizes.reader, 1, generators)
        _make_undecided(self.moves, self.value)

    def state_size(self, positions: int) -> int:
        """G, in any room."""
        return self.sizes.room

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Run over T steps; see :class:`RecurrentPolicy`."""
        room = self.room
        projected = torch.baddbmm(room.input_bias, inputs.flatten(1, 2), room.input_weight)
        states = []
        for step, piece in enumerate(projected.view(*inputs.shape[:3], -1).unbind(1)):
            if fresh is not None and bool(fresh[:, step].any()):
                state = state * (~fresh[:, step]).to(state.dtype)[..., None]
            recurrent = torch.baddbmm(room.hidden_bias, state, room.hidden_weight)
            state = room.step(piece, recurrent, state)
            states.append(state)
        read = torch.relu(self.reads(torch.stack(states, dim=1).flatten(1, 2)))
        policy, critic = read.chunk(2, dim=-1)
        logits = self.moves(policy).view(*inputs.shape[:3], -1)
        values: Tensor = self.value(critic)
        return logits, values.view(*inputs.shape[:3]), state


def _make_undecided(*heads: StackedLinear) -> None:
    """Make all actions about equally likely at first."""
    with torch.no_grad():
        for head in heads:
            head.weight.mul_(0.1)
            head.bias.zero_()


def make_policy(
    sizes: Sizes, positions: int, generators: Sequence[np.random.Generator]
) -> RecurrentPolicy:
    """Make networks of a kind, one for each generator; ``positions`` is the size of a flat one."""
    if sizes.kind == "flat":
        return FlatPolicy(sizes, positions, generators)
    return LeverPolicy(sizes, generators)
