"""Recurrent networks that choose actions: a policy, and a value of the reward still to come.

:class:`LeverPolicy` treats all positions alike: every lever has a small hidden state of its own,
all of them are updated by the same weights, and one more state belongs to the room as a whole. What
was learned about one position so holds for every other, and in rooms of any size. This is built in
and not learned, and it is all that is built in; :class:`FlatPolicy`, an ordinary recurrent network,
has nothing built in, to show what the assumption is worth.

A network is evaluated in M rooms at once: subjects, or the rooms of meta-training.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from causal_openlock.files.validation import StrictModel

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


class RecurrentPolicy(nn.Module, ABC):
    """A recurrent network with a policy and a value.

    Attributes:
        sizes: Kind and sizes.
        positions: Levers of the rooms that it fits, if it does not fit them all.
        heads: Names of the layers that give logits and values.
    """

    sizes: Sizes
    positions: int | None = None
    heads: tuple[str, ...]

    @abstractmethod
    def state_size(self, positions: int) -> int:
        """Numbers in a hidden state for a room with this number of positions, S."""

    @abstractmethod
    def step(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """``[M, A]`` logits, ``[M]`` values and ``[M, S]`` next state, from ``[M, in]``."""

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Run over T steps.

        Args:
            inputs: ``[T, M, in]`` what is perceived in M rooms at T steps.
            state: ``[M, S]`` hidden state before the first step.
            fresh: ``[T, M]`` steps before which the hidden state is reset.

        Returns:
            ``[T, M, A]`` logits of the actions, ``[T, M]`` values, and ``[M, S]`` the last hidden
            state.
        """
        all_logits, all_values = [], []
        for now, resets in zip(inputs, fresh, strict=True):
            logits, values, state = self.step(now, state * ~resets[:, None])
            all_logits.append(logits)
            all_values.append(values)
        return torch.stack(all_logits), torch.stack(all_values), state


class LeverPolicy(RecurrentPolicy):
    """A network with a hidden state for each lever, wherever it is.

    The room's state is updated from what is perceived of the room, from the states of all levers
    (their mean and their maximum) and from that of the lever acted on last; each lever's from what
    is perceived of it, and from the room's. A lever's own state and the room's then give the logits
    of pushing it and of pulling it.
    """

    heads = "moves", "door_and_value"

    def __init__(self, sizes: Sizes) -> None:
        super().__init__()
        self.sizes = sizes
        lever, room, reader = sizes.lever, sizes.room, sizes.reader
        self.room = nn.GRUCell(SHARED + 3 * lever, room)
        self.lever = nn.GRUCell(OWN + SHARED + room, lever)
        self.reads_lever = nn.Linear(lever, reader)
        self.reads_room = nn.Linear(room + 2 * lever, 2 * reader)
        self.moves = nn.Linear(reader, 2)
        self.door_and_value = nn.Linear(reader, 2)

    def state_size(self, positions: int) -> int:
        """H for each lever, and G."""
        return positions * self.sizes.lever + self.sizes.room

    def step(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Update the room's state and then the levers', and read both."""
        rooms, positions = len(inputs), (inputs.shape[1] - SHARED) // OWN
        own, shared = split(inputs, positions)
        room = state[:, positions * self.sizes.lever :]
        levers = state[:, : positions * self.sizes.lever].view(rooms, positions, -1)
        acted_on = (own[..., 2:].sum(dim=-1, keepdim=True) * levers).sum(dim=1)
        room = self.room(torch.cat([shared, pooled(levers), acted_on], dim=-1), room)
        whole = torch.cat([shared, room], dim=-1)[:, None].expand(-1, positions, -1)
        lever_inputs = torch.cat([own, whole], dim=-1).flatten(0, 1)
        levers = self.lever(lever_inputs, levers.flatten(0, 1)).view(rooms, positions, -1)
        whole = self.reads_room(torch.cat([room, pooled(levers)], dim=-1))
        for_levers, for_room = whole.chunk(2, dim=-1)
        moves = self.moves(torch.relu(self.reads_lever(levers) + for_levers[:, None]))
        door, value = self.door_and_value(torch.relu(for_room)).unbind(-1)
        logits = torch.cat([moves[..., 0], moves[..., 1], door[:, None]], dim=-1)
        return logits, value, torch.cat([levers.flatten(1), room], dim=-1)


def split(inputs: Tensor, positions: int) -> tuple[Tensor, Tensor]:
    """``[M, P, 4]`` of each lever and ``[M, 9]`` of the room, from ``[M, in]``.

    The inputs are those of :class:`~openlock_learners.networks.perception.Perception`.
    """
    pushed, grey, door, push, pull, rest = torch.split(
        inputs, [positions, positions, 2, positions, positions, SHARED - 2], dim=-1
    )
    return torch.stack([pushed, grey, push, pull], dim=-1), torch.cat([door, rest], dim=-1)


def pooled(levers: Tensor) -> Tensor:
    """``[M, 2H]`` mean and maximum over the levers, ``[M, P, H]``."""
    return torch.cat([levers.mean(dim=1), levers.amax(dim=1)], dim=-1)


class FlatPolicy(RecurrentPolicy):
    """A plain recurrent network, with inputs and actions of each position of its own."""

    heads = "moves", "value"

    def __init__(self, sizes: Sizes, positions: int) -> None:
        super().__init__()
        self.sizes, self.positions = sizes, positions
        self.room = nn.GRUCell(OWN * positions + SHARED, sizes.room)
        self.reads = nn.Linear(sizes.room, 2 * sizes.reader)
        self.moves = nn.Linear(sizes.reader, 2 * positions + 1)
        self.value = nn.Linear(sizes.reader, 1)

    def state_size(self, positions: int) -> int:
        """G, in any room."""
        return self.sizes.room

    def step(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Update the state, and read it."""
        state = self.room(inputs, state)
        policy, critic = torch.relu(self.reads(state)).chunk(2, dim=-1)
        return self.moves(policy), self.value(critic)[:, 0], state


def empty_policy(sizes: Sizes, positions: int) -> RecurrentPolicy:
    """A network without weights, which takes no memory; ``positions`` is the size of a flat one."""
    with torch.device("meta"):
        return FlatPolicy(sizes, positions) if sizes.kind == "flat" else LeverPolicy(sizes)


def make_policy(sizes: Sizes, positions: int, generator: np.random.Generator) -> RecurrentPolicy:
    """A network with random weights: all actions are about equally likely at first."""
    network, weights = empty_policy(sizes, positions), {}
    for name, layer in network.named_children():
        # Uniform within 1/sqrt(width) as torch's own weights, but drawn by this generator. The
        # width of a cell is that of its hidden state, and of its last matrix.
        *_, width = (part.shape[1] for part in layer.parameters() if part.dim() == 2)
        for part, tensor in layer.named_parameters():
            drawn = generator.uniform(-1.0, 1.0, tensor.shape) * width**-0.5
            if name in network.heads:
                drawn *= 0.0 if part == "bias" else 0.1
            weights[f"{name}.{part}"] = torch.tensor(drawn, dtype=torch.float32)
    network.load_state_dict(weights, assign=True)
    return network
