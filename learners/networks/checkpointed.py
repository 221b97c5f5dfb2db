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
        """All that is needed to go on, for a checkpoint."""
        parts = {key: getattr(self, name) for key, name in self.checkpointed.items()}
        return {
            key: part.state_dict() if hasattr(part, "state_dict") else copy.deepcopy(part)
            for key, part in parts.items()
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint, which stays as it is."""
        for key, name in self.checkpointed.items():
            part = getattr(self, name)
            if hasattr(part, "load_state_dict"):
                part.load_state_dict(state[key])
            else:
                setattr(self, name, copy.deepcopy(state[key]))
