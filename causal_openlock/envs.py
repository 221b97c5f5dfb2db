"""The room as a Gymnasium environment, one or thousands at once.

``gymnasium.make("causal_openlock/OpenLock-v0", schema="CC4", layout="trial7")`` gives one room,
``gymnasium.make_vec(..., num_envs=16384, vectorization_mode="vector_entry_point")`` many. Both step
the tables of :mod:`causal_openlock.tables`.

An *episode* is either one attempt or a whole trial:

* ``episode="attempt"``: it terminates when the door opens or the actions are spent; nothing
  follows that a learner could value. ``reset`` begins the next attempt in the same room; once
  every solution is found or no attempt is left, it begins a new trial.
* ``episode="trial"``: it terminates when every solution is found and is truncated when no attempt
  is left. After each attempt the room is put back, and what is returned is the room as it then
  stands; how the attempt ended is in ``info["outcome"]``.

``reset(seed=...)`` and ``reset(options={"new_trial": True})`` always begin a new trial. ``info``
carries the console, which a person sees too, and under the key ``"latent"`` what no learner may
see: it is for analysis.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from operator import index
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from causal_openlock.errors import LayoutError, OpenLockError, ProtocolError
from causal_openlock.protocol import PAPER_ACTION_LIMIT
from causal_openlock.rewards import BASIC_REWARD, RewardFunction, RewardTable, find_reward
from causal_openlock.room import RANDOM_LAYOUT, Layout, Room, positions_for
from causal_openlock.tables import ACTIONS_LEFT, OPENED, UNLOCKED, RoomTables

if TYPE_CHECKING:
    from causal_openlock.schema import Schema

ATTEMPT_LIMIT = 30
Episode = Literal["attempt", "trial"]


@dataclass(frozen=True)
class Settings:
    """The arguments that both environments share, checked.

    Attributes:
        schema: What governs the room.
        layout: Where the levers stand; ``None`` draws a layout for every trial.
        positions: Number of positions.
        reward: What each action pays.
        whole_trial: Whether an episode is a whole trial.
        attempt_limit: Attempts in a trial.
        action_limit: Actions in an attempt.
    """

    schema: Schema
    layout: Layout | None
    positions: int
    reward: RewardFunction
    whole_trial: bool
    attempt_limit: int
    action_limit: int

    @classmethod
    def of(
        cls,
        schema: str | os.PathLike[str] | Schema,
        layout: str | Mapping[str, str] | Layout,
        reward: str | Iterable[str] | RewardFunction,
        episode: str,
        attempt_limit: int,
        action_limit: int | None,
        positions: int | None,
    ) -> Settings:
        """Check the arguments of an environment.

        Raises:
            OpenLockError: With what is wrong and how to mend it.
        """
        from causal_openlock.schema_file import find_schema

        schema = find_schema(schema)
        positions = positions or positions_for(schema)
        if positions < len(schema.levers):
            raise LayoutError(
                f"{schema.name} has {len(schema.levers)} levers, more than {positions} positions"
            )
        if episode not in ("attempt", "trial"):
            raise OpenLockError(f"an episode is 'attempt' or 'trial', not {episode!r}")
        if attempt_limit < 1:
            raise ProtocolError(f"attempt_limit must be at least 1, not {attempt_limit}")
        if action_limit is None:
            action_limit = max(PAPER_ACTION_LIMIT, schema.least_action_limit)
        if action_limit < schema.least_action_limit:
            raise ProtocolError(
                f"{schema.name} needs attempts of at least {schema.least_action_limit} actions, "
                f"so action_limit cannot be {action_limit}"
            )
        return cls(
            schema=schema,
            layout=None if layout == RANDOM_LAYOUT else Layout.of(schema, layout, positions),
            positions=positions,
            reward=find_reward(reward),
            whole_trial=episode == "trial",
            attempt_limit=attempt_limit,
            action_limit=action_limit,
        )

    def draw_layout(self, generator: np.random.Generator) -> Layout:
        """The layout of a new trial."""
        return self.layout or Layout.random(self.schema, generator, self.positions)

    @property
    def observation_space(self) -> spaces.MultiBinary:
        """``MultiBinary(2P + 2)``: 16 bits in the paper's room."""
        return spaces.MultiBinary(2 * self.positions + 2)

    @property
    def action_space(self) -> spaces.Discrete[Any]:
        """``Discrete(2P + 1)``: 15 actions in the paper's room."""
        return spaces.Discrete(2 * self.positions + 1)


class _ListedRoom:
    """The tables of one room as Python lists, which a single step reads fastest."""

    def __init__(self, settings: Settings, layout: Layout) -> None:
        tables = RoomTables(settings.positions)
        tables.add([(settings.schema, layout, settings.action_limit)])
        self.tables = tables
        self.rewards = RewardTable(settings.reward, tables)
        self.room: Room = tables.rooms[0]
        self.effect: list[int] = tables.effect.tolist()
        self.chance: list[float] = tables.chance.tolist()
        self.idle: list[int] = tables.idle.tolist()
        self.unlocked: list[bool] = tables.unlocked.tolist()
        self.actions_left: list[int] = (tables.status & ACTIONS_LEFT).tolist()
        self.solution: list[int] = np.where(tables.opened, tables.solution, -1).tolist()
        self.observations = list(tables.observation)
        self.paid: list[float] = self.rewards.table().tolist()


class OpenLockEnv(gymnasium.Env[NDArray[np.int8], int]):
    """One room.

    Args:
        schema: Name of a schema, path of a schema file, or a Schema.
        layout: A published layout such as ``trial7``, a mapping ``{lever: position}``, or
            ``random``, which draws one for every trial.
        reward: Name of a preset, a list of terms, or a reward function
            (:mod:`causal_openlock.rewards`).
        episode: ``attempt`` or ``trial``.
        attempt_limit: Attempts in a trial.
        action_limit: Actions in an attempt; by default 3, or as many as the schema needs.
        positions: Number of positions; by default seven, or as many as there are levers.
        render_mode: ``ansi`` (text) or ``rgb_array`` (a picture).

    Raises:
        OpenLockError: If the arguments do not fit together.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["ansi", "rgb_array"], "render_fps": 4}

    def __init__(
        self,
        schema: str | os.PathLike[str] | Schema = "CC3",
        layout: str | Mapping[str, str] | Layout = RANDOM_LAYOUT,
        reward: str | Iterable[str] | RewardFunction = BASIC_REWARD,
        episode: Episode = "attempt",
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        self._settings = Settings.of(
            schema, layout, reward, episode, attempt_limit, action_limit, positions
        )
        self.observation_space = self._settings.observation_space
        self.action_space = self._settings.action_space
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise OpenLockError(f"render_mode is ansi or rgb_array, not {render_mode!r}")
        self.render_mode = render_mode
        self._listed: dict[Layout, _ListedRoom] = {}
        self._actions = 2 * self._settings.positions + 1
        self._whole_trial = self._settings.whole_trial
        self._stochastic = not self._settings.schema.deterministic
        self._heeds_repeats = self._settings.reward.heeds_repeats
        self._heeds_found = self._settings.reward.heeds_found
        # Row of the room; after the end of an episode its complement, which is negative.
        self._row = -1
        self._new_trial_due = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """Begin the next attempt, or a new trial.

        Args:
            seed: Seeds the environment and begins a new trial.
            options: ``{"new_trial": True}`` begins a new trial.
        """
        if seed is not None:
            super().reset(seed=seed)
        if self._row > 0 and not self._whole_trial:
            self._spend_attempt(solved=False)  # the attempt in progress is given up
        asked = options is not None and options.get("new_trial", False)
        if self._new_trial_due or self._whole_trial or seed is not None or asked:
            self._begin_trial()
        self._row = 0
        self._previous = -1
        return self._observations[0].copy(), self._info(0)

    def _begin_trial(self) -> None:
        layout = self._settings.draw_layout(self.np_random)
        if layout not in self._listed:
            if len(self._listed) >= 1000:
                self._listed.clear()
            self._listed[layout] = _ListedRoom(self._settings, layout)
        self._listed_room = self._listed[layout]
        self._observations = self._listed_room.observations
        self._attempts_left = self._settings.attempt_limit
        self._found: set[int] = set()
        self._solutions_left = len(self._settings.schema.solutions)
        self._new_trial_due = False
        self._latent = self._describe()

    def step(
        self, action: int
    ) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            ResetNeeded: Before the first reset, and after the end of an episode.
            InvalidAction: If the action is none of the action space.
        """
        row = self._row
        if row < 0:
            raise ResetNeeded("call reset() before step(), and after the end of every episode")
        try:
            action = index(action)
        except TypeError:
            action = -1
        if not 0 <= action < self._actions:
            raise InvalidAction(f"an action is an integer from 0 to {self._actions - 1}")
        flat = row * self._actions + action
        listed = self._listed_room
        after = listed.effect[flat]
        if self._stochastic and self.np_random.random() >= listed.chance[flat] > 0.0:
            after = listed.idle[row]
        reward = listed.paid[flat]
        if (
            (self._found and self._heeds_found and listed.unlocked[after])
            or (self._heeds_repeats and action == self._previous)
            or self._stochastic
        ):
            reward = self._judge(row, action, after)
        self._previous = action
        if listed.actions_left[after]:
            self._row = after
            return self._observations[after].copy(), reward, False, False, self._info(after)
        return self._end_attempt(listed, after, reward)

    def _judge(self, row: int, action: int, after: int) -> float:
        """The reward where history or luck matters."""
        found = np.zeros((1, len(self._settings.schema.solutions)), dtype=bool)
        found[0, list(self._found)] = True
        choice = row * self._actions + action
        paid = self._listed_room.rewards.pay(
            *(np.array([value]) for value in (choice, after, self._previous)),
            found,
            np.zeros(1, dtype=np.int64),
        )
        return float(paid[0])

    def _end_attempt(
        self, listed: _ListedRoom, after: int, reward: float
    ) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        solution = listed.solution[after]
        if solution >= 0 and solution not in self._found:
            self._found.add(solution)
            self._solutions_left -= 1
            self._latent = self._describe()
        solved = not self._solutions_left
        outcome = self._observations[after].copy()
        if not self._whole_trial:
            info = self._info(after)
            self._spend_attempt(solved)
            self._row = ~after
            return outcome, reward, True, False, info
        spent = self._attempts_left == 1 and not solved
        if not (solved or spent):
            self._spend_attempt(solved)
        info = self._info(0)
        info["outcome"] = outcome
        self._previous = -1
        self._row = ~0 if solved or spent else 0
        return self._observations[0].copy(), reward, solved, spent, info

    def _spend_attempt(self, solved: bool) -> None:
        self._attempts_left -= 1
        self._new_trial_due = solved or not self._attempts_left

    def _info(self, row: int) -> dict[str, Any]:
        return {
            "console": {
                "solutions_left": self._solutions_left,
                "solutions_found": len(self._found),
                "attempts_left": self._attempts_left,
                "actions_left": self._listed_room.actions_left[row],
            },
            "latent": self._latent.copy(),
        }

    def _describe(self) -> dict[str, Any]:
        """What no learner may see, in values that cannot be changed."""
        room = self._listed_room.room
        return {
            "schema": room.schema.name,
            "layout": tuple(room.layout.as_mapping(room.schema).items()),
            "solutions": room.schema.solutions,
            "found": tuple(sorted(self._found)),
        }

    def render(self) -> Any:
        """The room as text or as a ``[height, width, 3]`` picture of bytes, by ``render_mode``."""
        if self.render_mode is None:
            gymnasium.logger.warn("pass render_mode='ansi' or 'rgb_array' to see the room")
            return None
        from causal_openlock.render.room import draw_room, room_text

        if not hasattr(self, "_listed_room"):
            raise ResetNeeded("call reset() before render()")
        row = self._row if self._row >= 0 else ~self._row
        seen = self._listed_room.observations[row]
        positions = self._settings.positions
        if self.render_mode == "ansi":
            return room_text(seen, positions)
        return draw_room(seen, positions)


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
    """

    metadata: ClassVar[dict[str, Any]] = {
        "render_modes": [],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        schema: str | os.PathLike[str] | Schema = "CC3",
        layout: str | Mapping[str, str] | Layout = RANDOM_LAYOUT,
        reward: str | Iterable[str] | RewardFunction = BASIC_REWARD,
        episode: Episode = "attempt",
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        render_mode: str | None = None,
    ) -> None:
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
        self._room_of: dict[int, int] = {}
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
            self._previous = np.full(many, -1, dtype=np.int64)
            # Rooms whose trial is over: the next step begins another.
            self._due = _NONE
            mask = np.ones(many, dtype=bool)
            self._started = True
        self._begin_trials(np.flatnonzero(mask))
        self._due = np.setdiff1d(self._due, np.flatnonzero(mask))
        return self._seen(), self._info(self._tables.status.take(self._row) & ACTIONS_LEFT)

    def _begin_trials(self, which: NDArray[np.int64]) -> None:
        self._room[which] = self._draw_rooms(len(which))
        self._row, self._left, self._attempts_left = (
            array.copy() for array in (self._row, self._left, self._attempts_left)
        )
        self._row[which] = self._tables.start[self._room[which]]
        self._attempts_left[which] = self._settings.attempt_limit
        self._left[which] = self._solutions
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
        new = [i for i, code in enumerate(codes.tolist()) if code not in self._room_of]
        layouts = [Layout(tuple(order[first[i]].tolist()), positions) for i in new]
        self._room_of.update(zip(codes[new].tolist(), self._stacked(layouts), strict=True))
        return np.array([self._room_of[code] for code in codes.tolist()])[which]

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
        self._row = tables.step(choice, luck)
        status = tables.status.take(self._row)
        experienced = _NONE
        if settings.reward.heeds_found and status.max() >= UNLOCKED:
            unlocked = np.flatnonzero(status >= UNLOCKED)
            experienced = unlocked[self._left[unlocked] < self._solutions]
        reward = self._rewards.pay(choice, self._row, self._previous, self._found, experienced)
        if settings.reward.heeds_repeats:
            self._previous = actions.copy()
        # Stepping a room whose attempt is over puts it back: that is the reset of NEXT_STEP.
        # Where the trial was over too, another trial begins.
        if len(self._due):
            reward[self._due] = 0.0
            self._begin_trials(self._due)
            status[self._due] = tables.status[self._row[self._due]]
            self._due = _NONE

        left = status & ACTIONS_LEFT
        terminated, truncated = (np.zeros(self.num_envs, dtype=bool) for _ in range(2))
        if left.min() > 0:
            return self._seen(), reward, terminated, truncated, self._info(left)
        over = left == 0
        solved, spent = self._end_attempts(over, np.flatnonzero(status >= OPENED))
        self._due = np.flatnonzero(solved | spent)
        if settings.whole_trial:
            self._spend(over & ~(solved | spent))
            self._row = np.where(over, tables.start.take(self._room), self._row)
            info = self._info(tables.status.take(self._row) & ACTIONS_LEFT)
            return self._seen(), reward, solved, spent, info
        info = self._info(left)
        self._spend(over)
        return self._seen(), reward, over, truncated, info

    def _checked(self, actions: Any) -> NDArray[np.int64]:
        actions = np.asarray(actions)
        if actions.shape != (self.num_envs,) or actions.dtype.kind not in "iu":
            raise InvalidAction(
                f"step takes {self.num_envs} integers, one for each room, and not "
                f"{actions.dtype} of shape {actions.shape}"
            )
        actions = actions.astype(np.int64, copy=False)
        # Seen as unsigned, a negative number is a very large one: one look finds both.
        if actions.view(np.uint64).max() >= self._tables.actions:
            raise InvalidAction(
                f"an action is outside the space; actions are 0 to {self._tables.actions - 1}"
            )
        return actions

    def _end_attempts(
        self, over: NDArray[np.bool_], opened: NDArray[np.int64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Book the attempts that ended.

        Args:
            over: ``[num_envs]`` whether the attempt is over.
            opened: Indices of the rooms whose door is open.

        Returns:
            ``[num_envs]`` whether every solution is now found, and whether the attempts are spent
            without that.
        """
        if len(opened):
            solution = self._tables.solution[self._row[opened]]
            new = (solution >= 0) & ~self._found[opened, solution]
            self._found[opened[new], solution[new]] = True
            self._left = self._left.copy()
            self._left[opened] -= new
        solved = over & (self._left == 0)
        spent = over & (self._attempts_left <= 1) & ~solved
        if self._settings.reward.heeds_repeats:
            self._previous[over] = -1
        return solved, spent

    def _spend(self, over: NDArray[np.bool_]) -> None:
        self._attempts_left = self._attempts_left - over

    def _seen(self) -> NDArray[np.int8]:
        return self._tables.observation.take(self._row, axis=0)

    def _info(self, actions_left: NDArray[np.uint8]) -> dict[str, Any]:
        # None of these arrays is written to again: what changes is replaced.
        return {
            "console": {
                "solutions_left": self._left,
                "solutions_found": self._solutions - self._left,
                "attempts_left": self._attempts_left,
                "actions_left": actions_left,
            },
            "latent": {"tables": self._tables, "row": self._row},
        }


_NONE = np.zeros(0, dtype=np.int64)
