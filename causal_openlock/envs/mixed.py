"""Rooms of several kinds in one environment; each trial is in one of them, drawn at random."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from numpy.typing import NDArray

from causal_openlock.envs.settings import Recreatable, check_options, plain_arguments
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.errors import OpenLockError


class MixedRoomsEnv(Recreatable, gymnasium.Env[NDArray[np.int8], int]):
    """The rooms of a transfer or of a whole comparison, as one environment.

    Args:
        rooms: The arguments of an :class:`~causal_openlock.envs.OpenLockEnv` for each kind, all of
            them with the same number of positions and the same ``episode``.
        render_mode: As for a single room.
        reveal: As for a single room.

    Raises:
        OpenLockError: If there is no room, or they do not fit together.

    Example:
        >>> env = MixedRoomsEnv([{"schema": "CC3"}, {"schema": "CE3"}], reveal=True)
        >>> _, info = env.reset(seed=0)
        >>> info["latent"]["schema"]
        'CE3'
    """

    metadata = OpenLockEnv.metadata

    def __init__(
        self,
        rooms: Sequence[Mapping[str, Any]],
        render_mode: str | None = None,
        reveal: bool = False,
    ) -> None:
        if isinstance(rooms, str) or not all(isinstance(room, Mapping) for room in rooms):
            raise OpenLockError(
                "rooms are a list of the arguments of each, such as [{'schema': 'CC3'}, "
                "{'schema': 'CE3'}]"
            )
        self._rooms = [
            OpenLockEnv(**room, render_mode=render_mode, reveal=reveal) for room in rooms
        ]
        if not self._rooms:
            raise OpenLockError("rooms of several kinds need at least one")
        if len({room.observation_space.shape for room in self._rooms}) > 1:
            raise OpenLockError("rooms in one environment must have the same number of positions")
        if len({room.get("episode", "attempt") for room in rooms}) > 1:
            raise OpenLockError("rooms in one environment must have episodes of the same kind")
        self.render_mode = render_mode
        self.observation_space = self._rooms[0].observation_space
        self.action_space = self._rooms[0].action_space
        self._whole_trial = rooms[0].get("episode") == "trial"
        self._room: OpenLockEnv | None = None

    def _as_plain(self, given: Mapping[str, Any]) -> dict[str, Any]:
        rooms = zip(given["rooms"], self._rooms, strict=True)
        return {**given, "rooms": [plain_arguments(one, room.settings) for one, room in rooms]}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """Begin the next attempt, or a new trial in a room of any kind; as for a single room."""
        if seed is not None:
            super().reset(seed=seed)
        if seed is not None or self._room is None:
            for room, own in zip(
                self._rooms, self.np_random.integers(2**31, size=len(self._rooms)), strict=True
            ):
                room.reset(seed=int(own))
            self._room = None
        asked = check_options(options, "new_trial")
        if self._room is None or asked or self._whole_trial or self._room.trial_over:
            self._room = self._rooms[int(self.np_random.integers(len(self._rooms)))]
            options = {**(options or {}), "new_trial": True}
        return self._room.reset(options=options)

    def step(self, action: int) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            ResetNeeded: Before the first reset, and after the end of an episode.
            InvalidAction: If the action is not in the action space.
        """
        if self._room is None:
            raise ResetNeeded("call reset() before step()")
        return self._room.step(action)

    def render(self) -> Any:
        """The present room; as for a single room."""
        if self._room is None:
            raise ResetNeeded("call reset() before render()")
        return self._room.render()
