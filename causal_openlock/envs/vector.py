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

from causal_openlock.envs.settings import ATTEMPT_LIMIT, Episode, Settings
from causal_openlock.errors import OpenLockError
from causal_openlock.world.reward_table import RewardTable
from causal_openlock.world.rewards import BASIC_REWARD, RewardForm
from causal_openlock.world.room import RANDOM_LAYOUT, Layout
from causal_openlock.world.tables import ACTIONS_LEFT, OPENED, UNLOCKED, RoomTables

if TYPE_CHECKING:
    from causal_openlock.world.schema import Schema


KEPT_CHOICES = 1 << 23
"""How many rows times actions may be stacked before rooms that nobody is in are forgotten.

All layouts of the paper's rooms are far below it, and ten rooms of twelve levers fit: 150 MB.
"""


class OpenLockVectorEnv(VectorEnv[NDArray[np.int8], NDArray[np.int64], NDArray[Any]]):
    """Many rooms at once, each with its own trial.

    Episodes end and begin as in :class:`OpenLockEnv`. A room whose episode has ended is reset by
    the next step, which ignores its action and pays nothing (Gymnasium's ``NEXT_STEP``).

    Args:
        num_envs: How many rooms.
        schema: As for :class:`OpenLockEnv`, like all that follow.
        layout: See there; ``random`` draws one for every trial of every room.
        reward: See there.
        episode: See there.
        attempt_limit: See there.
        action_limit: See there.
        positions: See there.
        render_mode: None; many rooms are not drawn.
        physics: False; only a single room has bodies.

    Raises:
        OpenLockError: If the arguments do not fit together.
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
    ) -> None:
        if physics:
            raise OpenLockError(
                "many rooms at once have no bodies; use OpenLockEnv(physics=True), or the same "
                "rooms without physics, which a learner sees alike"
            )
        if render_mode is not None:
            raise OpenLockError("many rooms at once are not drawn; use OpenLockEnv to see one")
        settings = Settings.of(
            schema, layout, reward, episode, attempt_limit, action_limit, positions
        )
        self._settings = settings
        self.num_envs = num_envs
        self.render_mode = None
        self.single_observation_space = settings.observation_space
        self.single_action_space = settings.action_space
        self.observation_space = batch_space(settings.observation_space, num_envs)
        self.action_space = batch_space(settings.action_space, num_envs)
        self._tables = RoomTables(settings.positions)
        self._rewards = RewardTable(settings.reward, self._tables)
        self._solutions = len(settings.schema.solutions)
        self._heeds_found = settings.reward.heeds_found
        self._heeds_repeats = settings.reward.heeds_repeats
        self._room_of: dict[int, int] = {}
        self._kept_choices = KEPT_CHOICES
        self._started = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """Begin a new trial in every room.

        Args:
            seed: One seed for the whole batch; a list of seeds is combined into one.
            options: ``{"reset_mask": [num_envs] of bool}`` resets only those rooms.
        """
        if isinstance(seed, list):
            seed = int(np.random.SeedSequence([s or 0 for s in seed]).generate_state(1)[0])
        super().reset(seed=seed)
        many = self.num_envs
        mask = (options or {}).get("reset_mask")
        if mask is None or not self._started:
            self._room = np.zeros(many, dtype=np.int64)
            self._row = np.zeros(many, dtype=np.int64)
            self._attempts_left = np.zeros(many, dtype=np.int32)
            self._found = np.zeros((many, self._solutions), dtype=bool)
            self._left = np.full(many, self._solutions, dtype=np.int16)
            self._found_count = np.zeros(many, dtype=np.int16)
            self._previous = np.full(many, -1, dtype=np.int64)
            # Rooms whose trial is over: the next step begins another.
            self._due = _NONE
            mask = np.ones(many, dtype=bool)
            self._started = True
        self._begin_trials(np.flatnonzero(mask))
        self._due = np.setdiff1d(self._due, np.flatnonzero(mask))
        return self._seen(), self._info(self._tables.status.take(self._row) & ACTIONS_LEFT)

    def _begin_trials(self, rooms: NDArray[np.int64]) -> None:
        # Rooms in step all begin at once: then a slice spares the gathers.
        which = slice(None) if len(rooms) == self.num_envs else rooms
        self._room[which] = self._draw_rooms(len(rooms))
        self._row = self._row.copy()
        self._left = self._left.copy()
        self._attempts_left = self._attempts_left.copy()
        self._row[which] = self._tables.start[self._room[which]]
        self._attempts_left[which] = self._settings.attempt_limit
        self._left[which] = self._solutions
        self._found_count = self._solutions - self._left
        self._found[which] = False
        self._previous[which] = -1

    def _draw_rooms(self, many: int) -> NDArray[np.int64]:
        """``[many]`` rooms for new trials; a layout met before is not stacked again."""
        settings = self._settings
        if settings.layout is not None:
            return np.repeat(self._stacked([settings.layout]), many)
        levers, positions = len(settings.schema.levers), settings.positions
        order = self.np_random.random((many, positions)).argsort(axis=1)[:, :levers]
        codes, first, which = np.unique(
            order @ positions ** np.arange(levers), return_index=True, return_inverse=True
        )
        if self._tables.rows * self._tables.actions > self._kept_choices:
            self._forget()
        new = [i for i, code in enumerate(codes.tolist()) if code not in self._room_of]
        layouts = [Layout(tuple(order[first[i]].tolist()), positions) for i in new]
        self._room_of.update(zip(codes[new].tolist(), self._stacked(layouts), strict=True))
        return np.array([self._room_of[code] for code in codes.tolist()])[which]

    def _forget(self) -> None:
        """Stack anew the rooms that somebody is in, and no others: layouts can be countless."""
        old, (used, which) = self._tables, np.unique(self._room, return_inverse=True)
        self._tables = RoomTables(self._settings.positions)
        self._rewards = RewardTable(self._settings.reward, self._tables)
        self._room_of = {}
        moment = self._row - old.start[self._room]
        self._room = self._stacked([old.rooms[room].layout for room in used])[which]
        self._row = self._tables.start[self._room] + moment
        stacked = self._tables.rows * self._tables.actions
        self._kept_choices = max(KEPT_CHOICES, 2 * stacked)

    def _stacked(self, layouts: list[Layout]) -> NDArray[np.int64]:
        settings = self._settings
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
        tables, settings = self._tables, self._settings
        luck = self.np_random.random(self.num_envs) if tables.stochastic else None
        choice = tables.choice(self._row, actions)
        self._row, status = tables.step(choice, luck)
        experienced = _NONE
        if self._heeds_found and status.max() >= UNLOCKED:
            unlocked = np.flatnonzero(status >= UNLOCKED)
            experienced = unlocked[self._left[unlocked] < self._solutions]
        reward = self._rewards.pay(choice, self._row, self._previous, self._found, experienced)
        if self._heeds_repeats:
            # A room that was just put back has all its actions left, and none before the next.
            begins = status & ACTIONS_LEFT == settings.action_limit
            self._previous = np.where(begins, -1, actions)
        # Stepping a room whose attempt is over puts it back: that is the reset of NEXT_STEP.
        # Where the trial was over too, another trial begins.
        if len(self._due):
            reward[self._due] = 0.0
            self._begin_trials(self._due)
            tables = self._tables
            status[self._due] = tables.status[self._row[self._due]]
            self._due = _NONE

        left = status & ACTIONS_LEFT
        if np.minimum.reduce(left):
            return self._seen(), reward, self._nowhere(), self._nowhere(), self._info(left)
        over = left == 0
        solved, spent = self._end_attempts(over, np.flatnonzero(status >= OPENED))
        if settings.whole_trial:
            truncated = spent.copy()
            spent[solved] = True
            self._end_trials(spent)
            self._spend(over)
            self._row = np.where(over, tables.start.take(self._room), self._row)
            info = self._info(tables.status.take(self._row) & ACTIONS_LEFT)
            terminated = self._nowhere()
            terminated[solved] = True
            return self._seen(), reward, terminated, truncated, info
        spent[solved] = True
        self._end_trials(spent)
        info = self._info(left)
        self._spend(over)
        return self._seen(), reward, over, self._nowhere(), info

    def _nowhere(self) -> NDArray[np.bool_]:
        return np.zeros(self.num_envs, dtype=bool)

    def _checked(self, actions: Any) -> NDArray[np.int64]:
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise InvalidAction(
                f"step takes {self.num_envs} integers, one for each room, and not "
                f"{actions.dtype} of shape {actions.shape}"
            )
        actions = actions.astype(np.int64, copy=False)
        # Seen as unsigned, a negative number is a very large one: one look finds both.
        if np.maximum.reduce(actions.view(np.uint64)) >= self._tables.actions:
            raise InvalidAction(
                f"an action is outside the space; actions are 0 to {self._tables.actions - 1}"
            )
        return actions

    def _end_attempts(
        self, over: NDArray[np.bool_], opened: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Book the attempts that ended.

        Args:
            over: ``[num_envs]`` whether the attempt is over.
            opened: Indices of the rooms whose door is open.

        Returns:
            Indices of the rooms where every solution is now found, and ``[num_envs]`` whether the
            attempts are spent without that.
        """
        solved = _NONE
        if len(opened):
            solution = self._tables.solution[self._row[opened]]
            new = (solution >= 0) & ~self._found[opened, solution]
            self._found[opened[new], solution[new]] = True
            self._left = self._left.copy()
            self._left[opened] -= new
            self._found_count = self._solutions - self._left
            # A trial is solved by opening the door and in no other way.
            solved = opened[self._left[opened] == 0]
        spent = self._attempts_left <= 1
        spent &= over
        spent[solved] = False
        if self._settings.reward.heeds_repeats:
            self._previous[over] = -1
        return solved, spent

    def _end_trials(self, over: NDArray[np.bool_]) -> None:
        self._due = np.flatnonzero(over)
        if len(self._due):
            self._attempts_left = np.where(over, np.int32(0), self._attempts_left)

    def _spend(self, over: NDArray[np.bool_]) -> None:
        self._attempts_left = self._attempts_left - (over & (self._attempts_left > 0))

    def _seen(self) -> NDArray[np.int8]:
        return self._tables.observation.take(self._row, axis=0)

    def _info(self, actions_left: NDArray[np.uint8]) -> dict[str, Any]:
        # None of these arrays is written to again, by anybody: what changes is replaced.
        for kept in (self._left, self._found_count, self._attempts_left, self._row):
            kept.flags.writeable = False
        return {
            "console": {
                "solutions_left": self._left,
                "solutions_found": self._found_count,
                "attempts_left": self._attempts_left,
                "actions_left": actions_left,
            },
            "latent": {"tables": self._tables, "row": self._row},
        }


_NONE = np.zeros(0, dtype=np.int64)
