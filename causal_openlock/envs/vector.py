"""Many rooms at once as a Gymnasium vector environment."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from causal_openlock.envs.settings import ATTEMPT_LIMIT, AnySchema, Episode, Settings, check_options
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import whole_number
from causal_openlock.world.rewards import BASIC_REWARD, RewardForm
from causal_openlock.world.room import RANDOM_LAYOUT, LayoutForm
from causal_openlock.world.rooms import Rooms, RoomTables


class OpenLockVectorEnv(VectorEnv[NDArray[np.int8], NDArray[np.int64], NDArray[Any]]):
    """Many rooms at once, each with its own trial.

    They are neither drawn nor simulated. Episodes end and begin as in :class:`OpenLockEnv`. A room
    whose episode has ended is reset by the next step, which ignores its action and pays nothing
    (Gymnasium's ``NEXT_STEP``).

    Whether an action fails by chance is drawn for each room from a stream of its own, so it depends
    neither on the number of rooms nor on what the others do.

    Args:
        num_envs: How many rooms.
        schema, reward, episode, attempt_limit, action_limit, positions: As for
            :class:`OpenLockEnv`.
        layout: As there; ``random`` draws one for every trial of every room.
        reveal: Whether ``info["latent"]`` holds, for analysis, the ``layout`` of each room,
            ``[num_envs, positions]``: the index of the lever there, -1 for an inactive one; and
            which solutions are ``found``, ``[num_envs, solutions]``.

    Raises:
        OpenLockError: If the arguments do not fit together.

    Example:
        >>> env = OpenLockVectorEnv(4, "CC3", layout="trial1")
        >>> observation, info = env.reset(seed=0)
        >>> env.step(np.array([0, 1, 6, 14]))[0].shape
        (4, 16)
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own form
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        schema: AnySchema = "CC3",
        layout: LayoutForm = RANDOM_LAYOUT,
        reward: RewardForm = BASIC_REWARD,
        episode: Episode = "attempt",
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        reveal: bool = False,
    ) -> None:
        settings = Settings(schema, layout, reward, episode, attempt_limit, action_limit, positions)
        num_envs = whole_number(num_envs, "num_envs", 1)
        self.settings, self.num_envs, self._reveal = settings, num_envs, reveal
        self.single_observation_space = settings.observation_space
        self.single_action_space = settings.action_space
        self.observation_space = batch_space(settings.observation_space, num_envs)
        self.action_space = batch_space(settings.action_space, num_envs)
        tables = RoomTables.of([(settings.schema, settings.action_limit)], settings.positions)
        limit, whole_trial = settings.attempt_limit, settings.whole_trial
        self._rooms = Rooms(tables, [settings.reward], num_envs, limit, put_back=whole_trial)
        self._waits = tables.waits
        self._started = False
        # Rooms whose trial is over: the next step begins another.
        self._due = np.zeros(0, dtype=np.int64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """Begin a new trial in every room.

        Args:
            seed: One seed for the whole batch.
            options: ``{"reset_mask": [num_envs] of bool}`` resets only those rooms.
        """
        mask = check_options(options, "reset_mask")
        if mask is not None:
            mask = np.asarray(mask)
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
                raise OpenLockError(
                    f"reset_mask is a boolean array of {self.num_envs}, one for each room, and "
                    f"this is {mask.dtype} of shape {mask.shape}"
                )
        super().reset(seed=seed)
        if mask is None or not self._started:
            mask = np.ones(self.num_envs, dtype=bool)
        if seed is not None or mask.all():
            high = np.iinfo(np.uint64).max
            self._rooms.state.luck[:] = self.np_random.integers(1, high, self.num_envs, np.uint64)
        self._started = True
        self._begin_trials(np.flatnonzero(mask))
        self._due = self._due[~mask[self._due]]
        return self._rooms.observation, self._info()

    def _begin_trials(self, which: NDArray[np.int64]) -> None:
        many, layout = len(which), self.settings.layout
        order = np.arange(self.settings.positions) if layout is None else layout.lever_at()
        lever = np.tile(order, (many, 1))
        if layout is None:
            lever = self.np_random.permuted(lever, axis=1)
        self._rooms.begin_trials(which, np.zeros(many, np.int64), lever)

    def step(
        self, actions: NDArray[np.int64]
    ) -> tuple[NDArray[np.int8], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Take one action in every room.

        Args:
            actions: ``[num_envs]`` integers.

        Raises:
            ResetNeeded: Before the first reset.
            InvalidAction: If there are not ``num_envs`` actions, or one is outside the space.
        """
        if not self._started:
            raise ResetNeeded("call reset() before step()")
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise InvalidAction(
                f"step takes {self.num_envs} integers, one for each room, not "
                f"{actions.dtype} of shape {actions.shape}"
            )
        legal = self._waits - 1
        if len(self._due):
            if not 0 <= actions.min() <= actions.max() < legal:
                raise self._outside()  # before any trial begins
            self._begin_trials(self._due)
            actions = actions.copy()
            actions[self._due], legal = self._waits, self._waits + 1
        try:
            outcome = self._rooms.step(actions, legal=legal)
        except IndexError:
            raise self._outside() from None
        (self._due,) = outcome.trial_over.nonzero()
        truncated = np.zeros(self.num_envs, dtype=bool)
        terminated = outcome.attempt_over
        if self.settings.whole_trial:
            terminated = outcome.trial_over
            if len(self._due):
                truncated = terminated & (self._rooms.console[:, 0] > 0)
                terminated = terminated & ~truncated
        return self._rooms.observation, outcome.reward, terminated, truncated, self._info()

    def _outside(self) -> InvalidAction:
        last = self._waits - 2
        return InvalidAction(f"an action is outside the space; actions are 0 to {last}")

    def _info(self) -> dict[str, Any]:
        console = self._rooms.console
        info: dict[str, Any] = {
            "console": {
                "solutions_left": console[:, 0],
                "solutions_found": console[:, 1],
                "attempts_left": console[:, 2],
                "actions_left": console[:, 3],
            }
        }
        if self._reveal:
            levers, state = len(self.settings.schema.levers), self._rooms.state
            lever = state.column[:, : self.settings.positions].astype(np.int64)
            info["latent"] = {
                "layout": np.where(lever < levers, lever, -1),
                "found": state.found.copy(),
            }
        return info
