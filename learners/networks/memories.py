"""Networks with a memory that choose actions: a policy, and a value of what is still to come.

:class:`LeverMemory` is not told where a lever stands: every lever has a small recurrent state of
its own, all of them are updated by the same weights, and one more state belongs to the room as a
whole. What was learned about one place so holds for every other, and in rooms of any size. This
is assumed and not learned, and it is all that is assumed; :class:`FlatMemory`, an ordinary
recurrent network, assumes nothing, so that one can see what the assumption is worth.

As in :mod:`learners.networks.stacked_recurrent`, N networks are one: their weights are ``[N, in,
out]``. Meta-training has a single network in many rooms; subjects that go on learning have one
each.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

from learners.networks.stacked_recurrent import StackedGRU, StackedLinear

OWN, SHARED = 4, 9
"""What is perceived of each lever (pushed, grey, just pushed, just pulled), and beside that."""


@dataclass(frozen=True)
class Sizes:
    """Kind and sizes of a network; a checkpoint holds them.

    Attributes:
        kind: ``levers``, :class:`LeverMemory`, or ``flat``, :class:`FlatMemory`.
        lever: Numbers that are remembered of each lever, H; a flat memory knows of none.
        room: Numbers that are remembered of the room as a whole, G.
        reader: Units of the layer that reads the memory.
    """

    kind: Literal["levers", "flat"] = "levers"
    lever: int = 32
    room: int = 48
    reader: int = 48


def split(inputs: Tensor, positions: int) -> tuple[Tensor, Tensor]:
    """What is perceived, sorted by lever.

    Args:
        inputs: ``[..., in]`` as :class:`~learners.networks.perception.Perception` gives them.
        positions: Levers, P.

    Returns:
        ``[..., P, 4]`` of each lever and ``[..., 9]`` of the room.
    """
    pushed, grey, door, push, pull, rest = torch.split(
        inputs,
        [positions, positions, 2, positions, positions, inputs.shape[-1] - 4 * positions - 2],
        -1,
    )
    return torch.stack([pushed, grey, push, pull], dim=-1), torch.cat([door, rest], dim=-1)


class Memory(nn.Module, ABC):
    """N recurrent networks that tell what to do next and what is still to come.

    Attributes:
        sizes: Kind and sizes.
        positions: Levers of the rooms that it fits, if it does not fit them all.
    """

    sizes: Sizes
    positions: int | None = None

    @abstractmethod
    def state_size(self, positions: int) -> int:
        """Numbers that are remembered in a room of so many positions, S."""

    @abstractmethod
    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Walk through time.

        Args:
            inputs: ``[N, T, M, in]`` what each network perceives in M rooms at T steps.
            state: ``[N, M, S]`` what it remembers to begin with.
            fresh: ``[N, T, M]`` steps before which everything is forgotten; by default none.

        Returns:
            ``[N, T, M, A]`` logits of the actions, ``[N, T, M]`` values, and ``[N, M, S]`` what is
            remembered in the end.
        """


class LeverMemory(Memory):
    """Networks that know levers, and not where they stand.

    The room's state is updated from what is perceived of the room, from the states of all levers
    (their mean and their maximum) and from that of the lever acted on last; each lever's from what
    is perceived of it, and from the room's. A lever's own state and the room's then say how good
    it is to push it or to pull it.

    Args:
        sizes: Its sizes.
        generators: One source of initial weights for each network.
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
        _undecided(self.moves, self.door_and_value)

    def state_size(self, positions: int) -> int:
        """H for each lever, and G."""
        return positions * self.sizes.lever + self.sizes.room

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Walk through time; see :class:`Memory`."""
        networks, steps, rooms, width = inputs.shape
        size = self.sizes
        levers = (width - SHARED) // OWN
        own, shared = split(inputs, levers)
        acted = (own[..., 2] + own[..., 3]).unbind(1)
        # What depends on no step before goes through one product for all of them.
        weight = self.lever.input_weight
        seen = torch.bmm(own.flatten(1, 3), weight[:, :OWN])
        seen_of_lever = seen.view(networks, steps, rooms, levers, -1).unbind(1)
        now = torch.bmm(shared.flatten(1, 2), weight[:, OWN : OWN + SHARED])
        seen_beside = (now + self.lever.input_bias).view(networks, steps, rooms, 1, -1).unbind(1)
        from_room = weight[:, OWN + SHARED :]
        weight = self.room.input_weight
        now = torch.baddbmm(self.room.input_bias, shared.flatten(1, 2), weight[:, :SHARED])
        seen_of_room = now.view(networks, steps, rooms, -1).unbind(1)
        from_levers = weight[:, SHARED:]

        held = state[..., : levers * size.lever].reshape(networks, rooms, levers, size.lever)
        room = state[..., levers * size.lever :]
        remembered, of_room = [], []
        pooled = _pooled(held)
        for step in range(steps):
            if fresh is not None and bool(fresh[:, step].any()):
                kept = (~fresh[:, step]).to(held.dtype)[..., None]
                room, held, pooled = room * kept, held * kept[..., None], pooled * kept
            last = (acted[step][..., None] * held).sum(dim=2)
            told = torch.cat([pooled, last], dim=-1)
            projected = torch.baddbmm(seen_of_room[step], told, from_levers)
            recalled = torch.baddbmm(self.room.hidden_bias, room, self.room.hidden_weight)
            room = self.room.step(projected, recalled, room)
            beside = seen_beside[step] + torch.bmm(room, from_room)[:, :, None]
            recalled = torch.baddbmm(
                self.lever.hidden_bias, held.flatten(1, 2), self.lever.hidden_weight
            )
            held = self.lever.step(
                seen_of_lever[step] + beside, recalled.view((*beside.shape[:2], levers, -1)), held
            )
            pooled = _pooled(held)
            remembered.append(held)
            of_room.append(torch.cat([room, pooled], dim=-1))
        logits, values = self._read(torch.stack(remembered, dim=1), torch.stack(of_room, dim=1))
        return logits, values, torch.cat([held.flatten(2), room], dim=-1)

    def _read(self, held: Tensor, room: Tensor) -> tuple[Tensor, Tensor]:
        """Logits and values from ``[N, T, M, P, H]`` of the levers and ``[N, T, M, ...]``."""
        shape = held.shape
        whole = self.reads_room(room.flatten(1, 2)).view(*shape[:3], -1)
        for_levers, for_room = whole.chunk(2, dim=-1)
        each = self.reads_lever(held.flatten(1, 3)).view(*shape[:4], -1)
        each = torch.relu(each + for_levers[..., None, :])
        moves = self.moves(each.flatten(1, 3)).view(*shape[:4], 2)
        last = self.door_and_value(torch.relu(for_room).flatten(1, 2)).view(*shape[:3], 2)
        logits = torch.cat([moves[..., 0], moves[..., 1], last[..., :1]], dim=-1)
        return logits, last[..., 1]


def _pooled(held: Tensor) -> Tensor:
    """``[N, M, 2H]`` mean and maximum over the levers, ``[N, M, P, H]``."""
    return torch.cat([held.mean(dim=2), held.amax(dim=2)], dim=-1)


class FlatMemory(Memory):
    """A plain recurrent network: to it, every position is something else.

    Args:
        sizes: Its sizes.
        positions: Levers of the rooms that it is made for.
        generators: One source of initial weights for each network.
    """

    def __init__(
        self, sizes: Sizes, positions: int, generators: Sequence[np.random.Generator]
    ) -> None:
        super().__init__()
        self.sizes, self.positions = sizes, positions
        self.room = StackedGRU(OWN * positions + SHARED, sizes.room, generators)
        self.reads = StackedLinear(sizes.room, 2 * sizes.reader, generators)
        self.moves = StackedLinear(sizes.reader, 2 * positions + 1, generators)
        self.value = StackedLinear(sizes.reader, 1, generators)
        _undecided(self.moves, self.value)

    def state_size(self, positions: int) -> int:
        """G, whatever the room."""
        return self.sizes.room

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Walk through time; see :class:`Memory`."""
        projected = torch.baddbmm(
            self.room.input_bias, inputs.flatten(1, 2), self.room.input_weight
        )
        remembered = []
        pieces = projected.view(*inputs.shape[:3], -1).unbind(1)
        for step, seen in enumerate(pieces):
            if fresh is not None and bool(fresh[:, step].any()):
                kept = (~fresh[:, step]).to(state.dtype)[..., None]
                state = torch.mul(state, kept)
            recalled = torch.baddbmm(self.room.hidden_bias, state, self.room.hidden_weight)
            state = self.room.step(seen, recalled, state)
            remembered.append(state)
        read = torch.relu(self.reads(torch.stack(remembered, dim=1).flatten(1, 2)))
        policy, judge = read.chunk(2, dim=-1)
        logits = self.moves(policy).view(*inputs.shape[:3], -1)
        values: Tensor = self.value(judge)
        return logits, values.view(*inputs.shape[:3]), state


def _undecided(*heads: StackedLinear) -> None:
    """Make all actions about equally likely at first."""
    with torch.no_grad():
        for head in heads:
            head.weight.mul_(0.1)
            head.bias.zero_()


def make_memory(sizes: Sizes, positions: int, generators: Sequence[np.random.Generator]) -> Memory:
    """A network of a kind, for rooms of so many positions; one for each generator."""
    if sizes.kind == "flat":
        return FlatMemory(sizes, positions, generators)
    return LeverMemory(sizes, generators)
