"""A recurrent network that chooses actions: a policy, and a value of the reward still to come.

All positions are treated alike: every lever has a small hidden state of its own, all of them are
updated by the same weights, and one more state belongs to the room as a whole. What was learned
about one position so holds for every other, and in rooms of any size. This is built in and not
learned, and it is all that is built in.

The network is evaluated in M rooms at once: subjects, or the rooms of meta-training.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from causal_openlock.files.validation import StrictModel

OWN, SHARED = 4, 9
"""Numbers perceived of each lever (pushed, grey, just pushed, just pulled), and of the room."""
HEADS = "moves", "door_and_value"
"""Layers that give logits and values."""
Units = Annotated[int, Field(ge=1, le=1024)]


class Sizes(StrictModel):
    """Sizes of a network, as in a checkpoint and in a file of meta-training."""

    kind: Literal["levers"] = "levers"  # other kinds are of earlier versions
    lever: Units = 32  # H, hidden units of each lever
    room: Units = 48  # G, hidden units of the room as a whole
    reader: Units = 48  # units of the layer that reads the hidden state


class LeverPolicy(nn.Module):
    """A network with a hidden state for each lever, wherever it is.

    The room's state is updated from what is perceived of the room, from the states of all levers
    (their mean and their maximum) and from that of the lever acted on last; each lever's from what
    is perceived of it, and from the room's. A lever's own state and the room's then give the logits
    of pushing it and of pulling it.
    """

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
        """Numbers in a hidden state, S: H for each lever, and G."""
        return positions * self.sizes.lever + self.sizes.room

    def step(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """``[M, A]`` logits, ``[M]`` values and ``[M, S]`` next state, from ``[M, in]``."""
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

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """``[T, M, A]`` logits, ``[T, M]`` values and ``[M, S]`` last state of T steps.

        Before the steps that are ``fresh``, ``[T, M]``, the hidden state is reset.
        """
        all_logits, all_values = [], []
        for now, resets in zip(inputs, fresh, strict=True):
            logits, values, state = self.step(now, state * ~resets[:, None])
            all_logits.append(logits)
            all_values.append(values)
        return torch.stack(all_logits), torch.stack(all_values), state


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


def empty_policy(sizes: Sizes) -> LeverPolicy:
    """A network without weights, which takes no memory."""
    with torch.device("meta"):
        return LeverPolicy(sizes)


def make_policy(sizes: Sizes, generator: np.random.Generator) -> LeverPolicy:
    """A network with random weights: all actions are about equally likely at first."""
    network, weights = empty_policy(sizes), {}
    for name, layer in network.named_children():
        # Uniform within 1/sqrt(width) as torch's own weights, but drawn by this generator. The
        # width of a cell is that of its hidden state, and of its last matrix.
        *_, width = (part.shape[1] for part in layer.parameters() if part.dim() == 2)
        for part, tensor in layer.named_parameters():
            drawn = generator.uniform(-1.0, 1.0, tensor.shape) * width**-0.5
            if name in HEADS:
                drawn *= 0.0 if part == "bias" else 0.1
            weights[f"{name}.{part}"] = torch.tensor(drawn, dtype=torch.float32)
    network.load_state_dict(weights, assign=True)
    return network
