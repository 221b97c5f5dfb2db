"""Checkpoints made of attributes."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any, ClassVar


class Checkpointed:
    """An object whose checkpoint is made of its attributes.

    Attributes:
        checkpointed: By key of the checkpoint, the name of the attribute; if empty, all attributes
            by their names. An attribute with a ``state_dict`` of its own is saved and restored by
            that, any other one is copied.
    """

    checkpointed: ClassVar[Mapping[str, str]] = {}

    def _attributes(self) -> Mapping[str, str]:
        return self.checkpointed or {name: name for name in vars(self)}

    def state_dict(self) -> dict[str, Any]:
        """A copy of the whole state, for a checkpoint."""
        state = {}
        for key, name in self._attributes().items():
            part = getattr(self, name)
            held = part.state_dict() if hasattr(part, "state_dict") else part
            state[key] = held if isinstance(part, Checkpointed) else copy.deepcopy(held)
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from a checkpoint, which stays as it is."""
        for key, name in self._attributes().items():
            held, part = copy.deepcopy(state[key]), getattr(self, name)
            if hasattr(part, "load_state_dict"):
                part.load_state_dict(held)
            else:  # a tensor stays on the device where it is
                setattr(self, name, held.to(part) if hasattr(part, "to") else held)
