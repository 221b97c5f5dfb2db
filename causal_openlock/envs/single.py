"""One room as a Gymnasium environment."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from operator import index
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from causal_openlock.envs.settings import (
    ATTEMPT_LIMIT,
    RENDER_SIZE,
    Checked,
    Episode,
    Settings,
    check_options,
    check_render_size,
)
from causal_openlock.errors import OpenLockError
from causal_openlock.schemas.fsm import compile_schema
from causal_openlock.world.events import rewards_by_event
from causal_openlock.world.kernel import (
    INACTIVE,
    NEW,
    ON_PATH,
    OPENS,
    REPEATED,
    RETRACED,
    UNLOCKED,
    WORDS,
)
from causal_openlock.world.rewards import BASIC_REWARD, RewardForm
from causal_openlock.world.room import RANDOM_LAYOUT, Layout
from causal_openlock.world.rooms import RoomTables, events_of

if TYPE_CHECKING:
    from causal_openlock.physics.room import PhysicalRoom
    from causal_openlock.physics.world import Pose
    from causal_openlock.render.paint import Panel
    from causal_openlock.schemas.schema import Schema


KEPT_ROWS = 500_000
"""The most rows, over all layouts met, to keep observations of: about 100 bytes each."""


class _Table:
    """The tables of a schema as Python lists, the fastest to read in a single step."""

    def __init__(self, settings: Settings) -> None:
        limit = settings.action_limit
        self.tables = tables = RoomTables.of([(settings.schema, limit)], settings.positions)
        self.fsm = compile_schema(settings.schema)
        self.fails, self.columns = tables.fails, tables.waits + 1
        self.after: list[int] = tables.after.ravel().tolist()
        self.event: list[int] = tables.event.ravel().tolist()
        self.chance: list[float] = tables.chance.ravel().tolist()
        self.solution: list[int] = tables.solution.tolist()
        self.actions_left: list[int] = tables.actions_left.tolist()
        self.begins = tables.begins
        most = min(len(settings.schema.solutions), settings.attempt_limit)
        (self.paid,) = rewards_by_event([settings.reward], tables.event, most)


class _Bodies:
    """The physical room of a trial; its states are rows of the table."""

    def __init__(self, table: _Table) -> None:
        self._fsm = table.fsm
        self._used: list[int] = table.tables.used.tolist()
        states = zip(self._used, table.tables.state.tolist(), strict=True)
        self._rows = {used_and_state: row for row, used_and_state in enumerate(states)}
        self.room: PhysicalRoom | None = None
        self.watch: Callable[[Pose], None] | None = None
        self._finished, self._steps, self._unfinished = True, 0, 0

    def enter(self, layout: Layout) -> None:
        from causal_openlock.physics.room import PhysicalRoom

        self.room = PhysicalRoom(self._fsm, layout)

    def put_back(self) -> None:
        assert self.room is not None
        self.room.reset()
        self._finished, self._steps = True, 0

    def move(self, row: int, action: int, yields: bool) -> int:
        """Carry out an action and return the row of the state that it led to."""
        assert self.room is not None
        self.room.watch = self.watch
        movement = self.room.act(action, yields)
        self._finished, self._steps = movement.finished, movement.steps
        self._unfinished += not movement.finished
        return self._rows[self._used[row] + 1, self.room.state]

    def info(self) -> dict[str, Any]:
        return {
            "finished": self._finished,
            "steps": self._steps,
            "unfinished": self._unfinished,
        }


class OpenLockEnv(Checked, gymnasium.Env[NDArray[np.int8], int]):
    """One room as a Gymnasium environment.

    Args:
        schema: Name of a schema, path of a schema file, its content as plain data, or a Schema.
        layout: A published layout such as ``trial7``, a mapping ``{lever: position}``, or
            ``random``, which draws one for every trial.
        reward: Name of a preset, a list of terms, weights by name, ``module:function`` or a
            reward function; see :func:`~causal_openlock.world.rewards.find_reward`.
        episode: ``attempt`` or ``trial``.
        attempt_limit: Attempts in a trial.
        action_limit: Actions in an attempt; by default 3, or as many as the schema needs.
        positions: Number of positions; by default seven, or as many as there are levers.
        render_mode: ``ansi`` (text) or ``rgb_array`` (a picture).
        render_size: Height of a picture in pixels.
        render_console: Whether the console is shown next to the room in a picture.
        physics: Whether an action is a whole movement of a simulated arm
            (:mod:`causal_openlock.physics`), and the observation follows from the simulated levers
            and door. ``info["physics"]`` holds whether the last movement was ``finished`` within
            its budget, how many ``steps`` of the simulation it took, and how many movements have
            been left ``unfinished`` so far.
        reveal: Whether ``info["latent"]`` holds what learners must not see, for analysis: the
            ``schema``, the ``layout``, the ``solutions``, and the indices of those ``found``.

    Raises:
        OpenLockError: If the arguments do not fit together.

    Example:
        >>> env = OpenLockEnv("CC3", layout="trial1", episode="trial")
        >>> observation, info = env.reset(seed=0)
        >>> info["console"]["solutions_left"], info["console"]["attempts_left"]
        (2, 30)
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - Gymnasium's own form
        "render_modes": ["ansi", "rgb_array"],
        "render_fps": 4,
    }

    def __init__(
        self,
        schema: str | os.PathLike[str] | Mapping[str, Any] | Schema = "CC3",
        layout: str | Mapping[str, str] | Layout = RANDOM_LAYOUT,
        reward: RewardForm = BASIC_REWARD,
        episode: Episode = "attempt",
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        render_mode: str | None = None,
        physics: bool = False,
        render_size: int = RENDER_SIZE,
        render_console: bool = False,
        reveal: bool = False,
    ) -> None:
        self.settings = Settings(
            schema, layout, reward, episode, attempt_limit, action_limit, positions
        )
        self.observation_space = self.settings.observation_space
        self.action_space = self.settings.action_space
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise OpenLockError(f"render_mode is ansi or rgb_array, not {render_mode!r}")
        self.render_mode = render_mode
        self._render_size = check_render_size(render_size)
        self._render_console = render_console
        self._reveal = reveal
        self._table = _Table(self.settings)
        self._bodies = _Bodies(self._table) if physics else None
        # For each layout, its observation at each row and the column of each action.
        self._layouts: dict[Layout, tuple[list[NDArray[np.int8]], list[int]]] = {}
        self._actions = 2 * self.settings.positions + 1
        self._whole_trial = self.settings.whole_trial
        self._stochastic = not self.settings.schema.deterministic
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
            self._spend_attempt()  # the attempt in progress is given up
        asked = check_options(options, "new_trial")
        if self._new_trial_due or self._whole_trial or seed is not None or asked:
            self._begin_trial()
        if self._bodies is not None:
            self._bodies.put_back()
        self._row = 0
        self._previous = -1
        return self._observations[0].copy(), self._info(0)

    def _begin_trial(self) -> None:
        layout = self.settings.draw_layout(self.np_random)
        if layout not in self._layouts:
            state = self._table.tables.state
            if len(self._layouts) * len(state) >= KEPT_ROWS:
                self._layouts.clear()
            observations = layout.observations(self._table.fsm, state)
            lever = layout.lever_at()
            columns = [*lever, *(layout.positions + lever), 2 * layout.positions]
            self._layouts[layout] = [*observations], [*map(int, columns)]
        self._layout = layout
        self._observations, self._column = self._layouts[layout]
        if self._bodies is not None:
            self._bodies.enter(layout)
        self._attempts_left = self.settings.attempt_limit
        self._found: set[int] = set()
        self._solutions_left = len(self.settings.schema.solutions)
        self._new_trial_due = False

    def step(self, action: int) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            ResetNeeded: Before the first reset, and after the end of an episode.
            InvalidAction: If the action is not in the action space.
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
        table, found = self._table, self._found
        at = row * table.columns
        place = at + self._column[action]
        fails = self._stochastic and self.np_random.random() >= table.chance[place] > 0.0
        if fails:
            place = at + table.fails
        after, event = table.after[place], table.event[place]
        if self._bodies is not None:
            after = self._bodies.move(row, action, not fails)
            happened = events_of(table.tables, table.fsm, np.array(row), np.array(after))
            event = event & INACTIVE | int(happened)
        if event & UNLOCKED and table.solution[after] not in (-1, *found):
            event |= NEW
        if action == self._previous:
            event |= REPEATED
        if found and event & ON_PATH and table.begins[after, list(found)].any():
            event |= RETRACED
        reward = table.paid.item(event & (WORDS - 1), len(found))
        self._previous = action
        if table.actions_left[after]:
            self._row = after
            return self._observations[after].copy(), reward, False, False, self._info(after)
        return self._end_attempt(after, event, reward)

    def _end_attempt(
        self, after: int, event: int, reward: float
    ) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        # The same rule as in world/kernel.py, for one room.
        if event & OPENS and event & NEW:
            self._found.add(self._table.solution[after])
            self._solutions_left -= 1
        solved = not self._solutions_left
        spent = self._attempts_left == 1 and not solved
        if solved or spent:  # the trial is over
            self._attempts_left, self._new_trial_due = 0, True
        outcome = self._observations[after].copy()
        if not self._whole_trial:
            info = self._info(after)
            self._spend_attempt()
            self._row = ~after
            return outcome, reward, True, False, info
        self._spend_attempt()
        info = self._info(0)
        info["outcome"] = outcome
        if self._bodies is not None:
            self._bodies.put_back()
        self._previous = -1
        self._row = ~0 if solved or spent else 0
        return self._observations[0].copy(), reward, solved, spent, info

    def _spend_attempt(self) -> None:
        if self._attempts_left:
            self._attempts_left -= 1
        self._new_trial_due = not self._attempts_left

    def _info(self, row: int) -> dict[str, Any]:
        info: dict[str, Any] = {
            "console": {
                "solutions_left": self._solutions_left,
                "solutions_found": len(self._found),
                "attempts_left": self._attempts_left,
                "actions_left": self._table.actions_left[row],
            },
        }
        if self._reveal:
            info["latent"] = self._describe()
        if self._bodies is not None:
            info["physics"] = self._bodies.info()
        return info

    def _describe(self) -> dict[str, Any]:
        """Latent facts, which learners must not see, in immutable values."""
        schema = self.settings.schema
        return {
            "schema": schema.name,
            "layout": tuple(self._layout.as_mapping(schema).items()),
            "solutions": schema.solutions,
            "found": tuple(sorted(self._found)),
        }

    @property
    def trial_over(self) -> bool:
        """Whether the next reset begins a new trial in any case."""
        return self._new_trial_due

    @property
    def physical_room(self) -> PhysicalRoom:
        """The bodies of the trial in progress, with ``physics=True``.

        Raises:
            OpenLockError: Without ``physics=True``.
            ResetNeeded: Before the first reset.
        """
        room = self._physics().room
        if room is None:
            raise ResetNeeded("call reset() before asking for the physical room")
        return room

    def watch(self, callback: Callable[[Pose], None] | None) -> None:
        """Call a function with the pose after every step of the simulation from now on.

        Args:
            callback: Called 120 times in a unit of time; ``None`` ends it.

        Raises:
            OpenLockError: Without ``physics=True``.
        """
        self._physics().watch = callback

    def _physics(self) -> _Bodies:
        if self._bodies is None:
            raise OpenLockError("this room is not simulated; make it with physics=True")
        return self._bodies

    def render(self) -> Any:
        """The room as text or as a ``[height, width, 3]`` picture of bytes, by ``render_mode``.

        A picture of a physical room shows the simulated positions.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("pass render_mode='ansi' or 'rgb_array' to see the room")
            return None
        if not hasattr(self, "_layout"):
            raise ResetNeeded("call reset() before render()")
        row = self._row if self._row >= 0 else ~self._row
        seen = self._observations[row]
        positions = self.settings.positions
        if self.render_mode == "ansi":
            from causal_openlock.render.room import room_text

            return room_text(seen, positions)
        from causal_openlock.render.paint import draw
        from causal_openlock.render.scene import Look

        if self._bodies is None:
            look = Look.of_observation(seen, positions)
        else:
            grey = seen[positions : 2 * positions].astype(bool).tolist()
            look = Look.of_pose(self.physical_room.pose(), grey)
        return draw(look, self._render_size, self._panel(row) if self._render_console else None)

    def _panel(self, row: int) -> Panel:
        from causal_openlock.render.paint import Panel

        found = len(self._found)
        return Panel(
            solutions=(*[None] * found, *[""] * self._solutions_left),
            attempts_left=self._attempts_left if self._solutions_left else None,
            actions_left=self._table.actions_left[row],
        )
