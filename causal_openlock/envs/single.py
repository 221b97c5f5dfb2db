"""One room as a Gymnasium environment."""

from __future__ import annotations

from operator import index
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from numpy.typing import NDArray

from causal_openlock.envs.settings import ATTEMPT_LIMIT, AnySchema, Episode, Settings, check_options
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import whole_number
from causal_openlock.schemas.fsm import compile_schema
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
from causal_openlock.world.rewards import BASIC_REWARD, RewardForm, rewards_by_event
from causal_openlock.world.room import RANDOM_LAYOUT, Layout, LayoutForm
from causal_openlock.world.rooms import RoomTables, events_of

if TYPE_CHECKING:
    from causal_openlock.physics.room import PhysicalRoom


SMALLEST, LARGEST = 32, 4320  # height of a picture in pixels


class _Lists:
    """The tables of a room as Python lists, which a single step reads fastest."""

    def __init__(self, settings: Settings) -> None:
        limit = settings.action_limit
        self.tables = tables = RoomTables.of([(settings.schema, limit)], settings.positions)
        self.fails, self.columns = tables.fails, tables.waits + 1
        self.after: list[int] = tables.after.ravel().tolist()
        self.event: list[int] = tables.event.ravel().tolist()
        self.chance: list[float] = tables.chance.ravel().tolist()
        self.solution: list[int] = tables.solution.tolist()
        self.actions_left: list[int] = tables.actions_left.tolist()
        self.begins = tables.begins
        most = min(len(settings.schema.solutions), settings.attempt_limit)
        (self.paid,) = rewards_by_event([settings.reward], tables.event, most)


class OpenLockEnv(gymnasium.Env[NDArray[np.int8], int]):
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
        render_size: Height of a picture in pixels, 32 to 4320.
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
        schema: AnySchema = "CC3",
        layout: LayoutForm = RANDOM_LAYOUT,
        reward: RewardForm = BASIC_REWARD,
        episode: Episode = "attempt",
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        render_mode: str | None = None,
        physics: bool = False,
        render_size: int = 600,
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
        self._render_size = whole_number(render_size, "render_size", SMALLEST)
        if render_size > LARGEST:
            raise OpenLockError(f"render_size is at most {LARGEST} pixels, not {render_size}")
        self._render_console = render_console
        self._reveal = reveal
        self._lists, self._fsm = _Lists(self.settings), compile_schema(self.settings.schema)
        self._actions = 2 * self.settings.positions + 1
        self._whole_trial = self.settings.whole_trial
        self._stochastic = not self.settings.schema.deterministic
        self._layout: Layout | None = None
        self._row, self._over, self.trial_over = 0, True, True
        self._bodies: PhysicalRoom | None = None
        self._movements = {"finished": True, "steps": 0, "unfinished": 0} if physics else None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """Begin the next attempt, or a new trial.

        Args:
            seed: Seeds the environment and begins a new trial.
            options: ``{"new_trial": True}`` begins a new trial.
        """
        asked = check_options(options, "new_trial")
        if seed is not None:
            super().reset(seed=seed)
        if self._row and not self._over and not self._whole_trial:
            self._spend_attempt()  # the attempt in progress is given up
        if self.trial_over or self._whole_trial or seed is not None or asked:
            self._begin_trial()
        self._put_back()
        if self._movements:
            self._movements |= {"finished": True, "steps": 0}
        self._over = False
        return self._observations[0].copy(), self._info()

    def _begin_trial(self) -> None:
        before, rules = self._layout, self.settings
        layout = rules.layout or Layout.random(rules.schema, self.np_random, rules.positions)
        self._layout = layout
        if layout != before:
            # The observation at each row, and the tables' column of each action.
            lever, positions = layout.lever_at().tolist(), layout.positions
            self._column = [*lever, *(positions + place for place in lever), 2 * positions]
            self._observations = [*layout.observations(self._fsm, self._lists.tables.state)]
        if self._movements:
            from causal_openlock.physics.room import PhysicalRoom

            watch = self._bodies.watch if self._bodies else None
            self._bodies = PhysicalRoom(self._fsm, layout)
            self._bodies.watch = watch
        self._attempts_left = self.settings.attempt_limit
        self._found: set[int] = set()
        self._solutions_left = len(self.settings.schema.solutions)
        self.trial_over = False

    def _put_back(self) -> None:
        self._row, self._previous = 0, -1
        if self._bodies:
            self._bodies.reset()

    def step(self, action: int) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        """Take one action.

        Raises:
            ResetNeeded: Before the first reset, and after the end of an episode.
            InvalidAction: If the action is not in the action space.
        """
        if self._over:
            raise ResetNeeded("call reset() before step(), and after the end of every episode")
        try:
            action = index(action)
        except TypeError:
            action = -1
        if not 0 <= action < self._actions:
            raise InvalidAction(f"an action is an integer from 0 to {self._actions - 1}")
        lists, found = self._lists, self._found
        start = self._row * lists.columns
        place = start + self._column[action]
        fails = self._stochastic and self.np_random.random() >= lists.chance[place] > 0.0
        if fails:
            place = start + lists.fails
        after, event = lists.after[place], lists.event[place]
        if self._movements:
            after, event = self._move(action, event, yields=not fails)
        if event & UNLOCKED and lists.solution[after] not in (-1, *found):
            event |= NEW
        if action == self._previous:
            event |= REPEATED
        if found and event & ON_PATH and lists.begins[after, list(found)].any():
            event |= RETRACED
        reward = lists.paid.item(event & (WORDS - 1), len(found))
        self._row, self._previous = after, action
        if lists.actions_left[after]:
            return self._observations[after].copy(), reward, False, False, self._info()
        if event & OPENS and event & NEW:
            found.add(lists.solution[after])
            self._solutions_left -= 1
        return self._end_attempt(self._observations[after].copy(), reward)

    def _move(self, action: int, event: int, yields: bool) -> tuple[int, int]:
        """Let the arm act: the row of the state that the bodies are in then, and the event."""
        assert self._bodies
        assert self._movements
        movement, tables = self._bodies.act(action, yields), self._lists.tables
        self._movements |= {"finished": movement.finished, "steps": movement.steps}
        self._movements["unfinished"] += not movement.finished
        used = tables.used == tables.used[self._row] + 1
        after = np.flatnonzero(used & (tables.state == self._bodies.state))
        (happened,) = events_of(tables, self._fsm, np.array([self._row]), after).tolist()
        return int(after[0]), event & INACTIVE | happened

    def _end_attempt(
        self, outcome: NDArray[np.int8], reward: float
    ) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        # The same rule as in world/kernel.py, for one room.
        solved = not self._solutions_left
        spent = self._attempts_left == 1 and not solved
        if solved or spent:
            self._attempts_left = 0
        if not self._whole_trial:
            info = self._info()  # the attempt counts as left until the trial is over
            self._spend_attempt()
            self._over = True
            return outcome, reward, True, False, info
        self._spend_attempt()
        self._put_back()
        self._over = solved or spent
        return self._observations[0].copy(), reward, solved, spent, self._info(outcome=outcome)

    def _spend_attempt(self) -> None:
        self._attempts_left = max(0, self._attempts_left - 1)
        self.trial_over = not self._attempts_left

    def _info(self, **more: Any) -> dict[str, Any]:
        info: dict[str, Any] = {
            "console": {
                "solutions_left": self._solutions_left,
                "solutions_found": len(self._found),
                "attempts_left": self._attempts_left,
                "actions_left": self._lists.actions_left[self._row],
            },
            **more,
        }
        if self._reveal and self._layout:
            schema = self.settings.schema
            info["latent"] = {
                "schema": schema.name,
                "layout": tuple(self._layout.as_mapping(schema).items()),
                "solutions": schema.solutions,
                "found": tuple(sorted(self._found)),
            }
        if self._movements:
            info["physics"] = dict(self._movements)
        return info

    @property
    def physical_room(self) -> PhysicalRoom:
        """The bodies of the trial in progress, with ``physics=True``.

        What its ``watch`` is set to is called with the pose after every step of the simulation, in
        the trials that follow as well.

        Raises:
            OpenLockError: Without ``physics=True``.
            ResetNeeded: Before the first reset.
        """
        if self._movements is None:
            raise OpenLockError("this room is not simulated; make it with physics=True")
        if self._bodies is None:
            raise ResetNeeded("call reset() before asking for the physical room")
        return self._bodies

    def render(self) -> Any:
        """The room as text or as a ``[height, width, 3]`` picture of bytes, by ``render_mode``.

        A picture of a physical room shows the simulated positions.
        """
        if self.render_mode is None:
            gymnasium.logger.warn("pass render_mode='ansi' or 'rgb_array' to see the room")
            return None
        if self._layout is None:
            raise ResetNeeded("call reset() before render()")
        seen, positions = self._observations[self._row], self.settings.positions
        from causal_openlock.render.paint import Panel, draw, room_text
        from causal_openlock.render.scene import Look

        if self.render_mode == "ansi":
            return room_text(seen, positions)
        look, panel = Look.of_observation(seen, positions), None
        if self._bodies:
            look = Look.of_pose(self._bodies.pose(), look.grey)
        if self._render_console:
            panel = Panel(
                solutions=(*[None] * len(self._found), *[""] * self._solutions_left),
                attempts_left=self._attempts_left if self._solutions_left else None,
                actions_left=self._lists.actions_left[self._row],
            )
        return draw(look, self._render_size, panel)
