"""Checkpoints made of attributes."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar


class Checkpointed:
    """An object whose checkpoint is made of some of its attributes.

    Attributes:
        checkpointed: By key of the checkpoint, the name of the attribute. An attribute with a
            ``state_dict`` of its own is saved and restored by that, any other one is copied.
    """

    checkpointed: ClassVar[Mapping[str, str]]

    def state_dict(self) -> dict[str, Any]:
        """A copy of all that is needed to go on, for a checkpoint."""
        state = {}
        for key, name in self.checkpointed.items():
            part = getattr(self, name)
            held = part.state_dict() if hasattr(part, "state_dict") else part
            state[key] = held if isinstance(part, Checkpointed) else copy.deepcopy(held)
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint, which stays as it is."""
        for key, name in self.checkpointed.items():
            held, part = copy.deepcopy(state[key]), getattr(self, name)
            if hasattr(part, "load_state_dict"):
                part.load_state_dict(held)
            else:
                setattr(self, name, held)
