"""Single rooms in place of a vector environment, and actions that solve now and then."""

from __future__ import annotations

from typing import Any

import numpy as np

from causal_openlock.envs import OpenLockEnv
from causal_openlock.world.room import Room


class Singles:
    """Some single rooms, stepped and reset as a vector environment with NEXT_STEP does."""

    def __init__(self, many: int, **arguments: Any) -> None:
        self.rooms = [OpenLockEnv(**arguments) for _ in range(many)]
        self.ended = [False] * many

    def reset(self, seed: int) -> tuple[list[Any], list[dict[str, Any]]]:
        seen, infos = zip(*[room.reset(seed=seed) for room in self.rooms], strict=True)
        return list(seen), list(infos)

    def step(self, actions: np.ndarray) -> tuple[list[Any], ...]:
        results = []
        for index, (room, action) in enumerate(zip(self.rooms, actions.tolist(), strict=True)):
            if self.ended[index]:
                seen, info = room.reset()
                result: tuple[Any, ...] = (seen, 0.0, False, False, info)
            else:
                result = room.step(action)
            self.ended[index] = result[2] or result[3]
            results.append(result)
        return tuple(map(list, zip(*results, strict=True)))


class Lively:
    """Actions for many rooms that often follow a solution, sometimes repeat, and sometimes err."""

    def __init__(self, room: Room, many: int) -> None:
        paths = [room.action_of(levers) for levers in room.schema.solutions]
        longest = max(map(len, paths))
        self.paths = np.array([path + [14] * (longest - len(path)) for path in paths])
        self.generator = np.random.default_rng(0)
        self.which = np.zeros(many, dtype=int)
        self.last = np.zeros(many, dtype=int)

    def act(self, used: np.ndarray) -> np.ndarray:
        """What to do after so many actions of the attempt."""
        many = len(used)
        other = self.generator.integers(len(self.paths), size=many)
        self.which = np.where(used == 0, other, self.which)
        on_path = self.paths[self.which, np.minimum(used, self.paths.shape[1] - 1)]
        chance = self.generator.random(many)
        any_action = self.generator.integers(15, size=many)
        self.last = np.where(chance < 0.1, any_action, np.where(chance < 0.2, self.last, on_path))
        return self.last
