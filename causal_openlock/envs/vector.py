"""Many rooms at once as a Gymnasium vector environment."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from causal_openlock.envs.settings import ATTEMPT_LIMIT, Episode, Recreatable, Settings
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import whole_number
from causal_openlock.world.batch import RoomBatch, Spare
from causal_openlock.world.rewards import BASIC_REWARD, RewardForm
from causal_openlock.world.room import RANDOM_LAYOUT, Layout
from causal_openlock.world.tables import ACTIONS_LEFT, RoomTables

if TYPE_CHECKING:
    from causal_openlock.schemas.schema import Schema


KEPT_CHOICES = 1 << 23
"""The most rows times actions to stack before unused rooms are dropped.

All layouts of the paper's rooms are far below it, and ten rooms of twelve levers fit: 150 MB.
"""


class OpenLockVectorEnv(Recreatable, VectorEnv[NDArray[np.int8], NDArray[np.int64], NDArray[Any]]):
    """Many rooms at once, each with its own trial.

    Episodes end and begin as in :class:`OpenLockEnv`. A room whose episode has ended is reset by
    the next step, which ignores its action and pays nothing (Gymnasium's ``NEXT_STEP``).

    Whether an action fails by chance is drawn by Philox4x32-10 for each room, seed and step
    (:func:`causal_openlock.world.kernel.uniform`), so it depends neither on the number of rooms nor
    on what the others do.

    Args:
        num_envs: How many rooms.
        schema: As for :class:`OpenLockEnv`, like the arguments below.
        layout: See there; ``random`` draws one for every trial of every room.
        reward: See there.
        episode: See there.
        attempt_limit: See there.
        action_limit: See there.
        positions: See there.
        render_mode: None; many rooms are not drawn.
        physics: False; only a single room has bodies.
        reveal: Whether ``info["latent"]`` holds, for analysis, the ``tables`` of all rooms and the
            ``row`` of each, ``[num_envs]``.
        max_episode_steps: None; the room's own limits end an episode.

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
        schema: str | os.PathLike[str] | Mapping[str, Any] | Schema = "CC3",
        layout: str | Mapping[str, str] | Layout = RANDOM_LAYOUT,
        reward: RewardForm = BASIC_REWARD,
        episode: Episode = "attempt",
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        render_mode: str | None = None,
        physics: bool = False,
        reveal: bool = False,
        max_episode_steps: int | None = None,
    ) -> None:
        if max_episode_steps is not None:
            raise OpenLockError(
                "many rooms at once have no max_episode_steps; give attempt_limit, or make them "
                'with vectorization_mode="sync"'
            )
        if physics:
            raise OpenLockError(
                "many rooms at once are not simulated; use OpenLockEnv(physics=True), or the same "
                "rooms without physics, which look the same to a learner"
            )
        if render_mode is not None:
            raise OpenLockError("many rooms at once are not drawn; use OpenLockEnv to see one")
        settings = Settings(schema, layout, reward, episode, attempt_limit, action_limit, positions)
        self.settings = settings
        self.num_envs = num_envs
        self.render_mode = None
        self._reveal = reveal
        self.single_observation_space = settings.observation_space
        self.single_action_space = settings.action_space
        self.observation_space = batch_space(settings.observation_space, num_envs)
        self.action_space = batch_space(settings.action_space, num_envs)
        self._tables = RoomTables(settings.positions)
        self._batch = RoomBatch(
            self._tables,
            [settings.reward],
            num_envs,
            settings.attempt_limit,
            put_back=settings.whole_trial,
        )
        self._whole_trial = settings.whole_trial
        # Returned in info, so replaced instead of changed.
        self._left = np.zeros(num_envs, dtype=np.int16)
        self._found_count = np.zeros(num_envs, dtype=np.int16)
        self._attempts_left = np.zeros(num_envs, dtype=np.int32)
        # Rooms whose trial is over: the next step begins another.
        self._due = _NONE
        # The layouts met so far as numbers, sorted, and the rooms that have them.
        self._codes, self._rooms = _NONE, _NONE
        self._kept_choices = KEPT_CHOICES
        self._started = False
        self._observations = Spare((num_envs, 2 * settings.positions + 2), np.dtype(np.int8))
        self._luck = np.empty(-(-num_envs // 4) * 4)  # Philox gives four numbers at a time
        self._moment, self._key = 0, (0, 0)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """Begin a new trial in every room.

        Args:
            seed: One seed for the whole batch; a list of seeds is combined into one.
            options: ``{"reset_mask": [num_envs] of bool}`` resets only those rooms.
        """
        mask = (options or {}).get("reset_mask")
        if mask is not None:
            mask = np.asarray(mask)
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
                raise OpenLockError(
                    f"reset_mask is a boolean array of {self.num_envs}, one for each room, and "
                    f"this is {mask.dtype} of shape {mask.shape}"
                )
        super().reset(seed=self._one_seed(seed))
        if not self.settings.schema.deterministic and (
            seed is not None or mask is None or not self._started
        ):
            first, second = self.np_random.integers(1 << 32, size=2).tolist()
            self._moment, self._key = 0, (first, second)
        if mask is None or not self._started:
            mask = np.ones(self.num_envs, dtype=bool)
            # Here, since numba takes a while to load.
            from causal_openlock.world.kernel import all_below, drawn, uniform

            self._all_below, self._drawn, self._uniform = all_below, drawn, uniform
            self._started = True
        begun = np.flatnonzero(mask)
        self._begin_trials(begun)
        self._due = np.setdiff1d(self._due, begun)
        tables, row = self._tables, self._batch.row
        actions_left = tables.status.take(row) & ACTIONS_LEFT
        return tables.observation.take(row, axis=0), self._info(actions_left, self._attempts_left)

    def _one_seed(self, seed: Any) -> int | None:
        """The seed of the whole batch, of one for each room."""
        if not isinstance(seed, list | tuple):
            return seed
        if len(seed) != self.num_envs:
            raise OpenLockError(
                f"there are {len(seed)} seeds for {self.num_envs} rooms; give one for each, or one"
            )
        if all(one is None for one in seed):
            return None
        fresh = np.random.default_rng()  # of what has no seed
        known = [
            int(fresh.integers(2**31)) if one is None else whole_number(one, "seed") for one in seed
        ]
        return int(np.random.SeedSequence(known).generate_state(1)[0])

    def _begin_trials(self, rooms: NDArray[np.int64]) -> None:
        # If all rooms begin at once, a slice is faster than indices.
        which = slice(None) if len(rooms) == self.num_envs else rooms
        self._batch.begin_trials(which, self._draw_rooms(len(rooms)))
        left, found_count, attempts_left = (
            array.copy() for array in (self._left, self._found_count, self._attempts_left)
        )
        left[which] = len(self.settings.schema.solutions)
        found_count[which] = 0
        attempts_left[which] = self.settings.attempt_limit
        self._left, self._found_count = _read_only(left), _read_only(found_count)
        self._attempts_left = _read_only(attempts_left)

    def _draw_rooms(self, many: int) -> NDArray[np.int64]:
        """``[many]`` rooms for new trials; each layout is stacked only once."""
        settings = self.settings
        if settings.layout is not None:
            return np.repeat(self._stacked([settings.layout]), many)
        levers, positions = len(settings.schema.levers), settings.positions
        if self._tables.rows * self._tables.actions > self._kept_choices:
            self._forget()
        numbers = self.np_random.random((many, positions))
        codes, at = self._drawn(numbers, levers, self._codes)
        unknown = np.flatnonzero(at < 0)
        if len(unknown):
            new = np.unique(codes[unknown])
            places = new[:, None] // positions ** np.arange(levers) % positions
            layouts = [Layout(tuple(own), positions) for own in places.tolist()]
            where = np.searchsorted(self._codes, new)
            self._rooms = np.insert(self._rooms, where, self._stacked(layouts))
            self._codes = np.insert(self._codes, where, new)
            at = np.searchsorted(self._codes, codes)
        return self._rooms[at]

    def _forget(self) -> None:
        """Make new tables with only the rooms in use: there can be very many layouts."""
        old, batch = self._tables, self._batch
        used, which = np.unique(batch.room, return_inverse=True)
        self._tables = RoomTables(self.settings.positions)
        self._codes, self._rooms = _NONE, _NONE
        moment = batch.row - old.start[batch.room]
        batch.room[:] = self._stacked([old.rooms[room].layout for room in used])[which]
        batch.use(self._tables)
        batch.row = self._tables.start[batch.room] + moment
        stacked = self._tables.rows * self._tables.actions
        self._kept_choices = max(KEPT_CHOICES, 2 * stacked)

    def _stacked(self, layouts: list[Layout]) -> NDArray[np.int64]:
        settings = self.settings
        return self._tables.add(
            [(settings.schema, layout, settings.action_limit) for layout in layouts]
        )

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
        actions = self._checked(actions)
        legal: int | None = self._tables.actions
        due, luck = self._due, None
        if len(due):
            actions = np.array(actions, np.int64)
            # Nothing may be begun for actions that are refused.
            if not self._all_below(actions, self._tables.actions):
                raise self._outside()
            legal = None
            self._begin_trials(due)
            actions[due] = self._tables.wait
            self._due = _NONE
        if self._tables.stochastic:
            self._uniform(self._luck, self._moment, *self._key)
            luck = self._luck[: self.num_envs]
        # Where an attempt is over, the step resets the room: that is the reset of NEXT_STEP.
        seen = self._observations.array()
        try:
            _, actions_left, reward, attempt_over, trial_over, new, ended, finished, found_new = (
                self._batch.step(actions, luck, seen, legal)
            )
        except IndexError:
            raise self._outside() from None
        if luck is not None:
            self._moment += 1
        terminated = trial_over if self._whole_trial else attempt_over
        truncated = np.zeros(self.num_envs, _BOOL)
        # Until the reset, an attempt that has just ended counts as left.
        shown = self._attempts_left
        if found_new:
            self._left = _read_only(self._left - new)
            self._found_count = _read_only(self._found_count + new)
        if ended:
            self._attempts_left = _read_only(shown - attempt_over)
        if finished:
            self._due = np.flatnonzero(trial_over)
            goes_on = ~trial_over
            shown = _read_only(shown * goes_on)
            self._attempts_left = _read_only(self._attempts_left * goes_on)
            if self._whole_trial:
                truncated = terminated & (self._left > 0)
                terminated = terminated & ~truncated
        if self._whole_trial:
            shown = self._attempts_left
        return seen, reward, terminated, truncated, self._info(actions_left, shown)

    def _checked(self, actions: Any) -> NDArray[Any]:
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise InvalidAction(
                f"step takes {self.num_envs} integers, one for each room, not "
                f"{actions.dtype} of shape {actions.shape}"
            )
        return actions

    def _outside(self) -> InvalidAction:
        return InvalidAction(
            f"an action is outside the space; actions are 0 to {self._tables.actions - 1}"
        )

    def _info(
        self, actions_left: NDArray[np.uint8], attempts_left: NDArray[np.int32]
    ) -> dict[str, Any]:
        info: dict[str, Any] = {
            "console": {
                "solutions_left": self._left,
                "solutions_found": self._found_count,
                "attempts_left": attempts_left,
                "actions_left": actions_left,
            },
        }
        if self._reveal:
            row = _read_only(self._batch.row)
            info["latent"] = {"tables": self._tables, "row": row}
        return info


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    array.setflags(write=False)
    return array


_BOOL = np.dtype(np.bool_)
_NONE = np.zeros(0, dtype=np.int64)
