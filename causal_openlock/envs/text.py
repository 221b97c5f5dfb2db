"""One room as a Gymnasium environment of words, for agents that read and write.

Observations and actions are texts (:mod:`causal_openlock.render.words`), an episode is a trial, and
the rules are those of :class:`~causal_openlock.envs.single.OpenLockEnv`. A text that names no
action does nothing and costs nothing: the observation says so and lists the actions.
"""

from __future__ import annotations

import string
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.error import InvalidAction, ResetNeeded

from causal_openlock.envs.settings import ATTEMPT_LIMIT, AnySchema
from causal_openlock.envs.single import OpenLockEnv
from causal_openlock.render.words import ANY, StoryName, Wording
from causal_openlock.world.rewards import BASIC_REWARD, RewardForm
from causal_openlock.world.room import RANDOM_LAYOUT, LayoutForm

LONGEST = 4000  # characters of an observation or an action


class OpenLockTextEnv(gymnasium.Env[str, str]):
    """One room in words; an episode is a trial.

    Args:
        schema, layout, reward, attempt_limit, action_limit, positions: As for
            :class:`~causal_openlock.envs.single.OpenLockEnv`.
        story: ``levers``, ``switches``, ``symbols``, or ``any``. ``reset(seed=...)`` draws the
            names of positions and their order, and the story if it is ``any``; they stay the same
            until the next seed.

    ``info`` also holds ``action``, the index of the last action or ``None`` if the text was none,
    ``actions``, the texts of all actions in the order in which they are listed, and ``console``.

    Example:
        >>> env = OpenLockTextEnv("CC3", layout="trial1", story="levers")
        >>> text, info = env.reset(seed=0)
        >>> print(text.splitlines()[-1])
        The door is locked and closed.
        >>> text, *_, info = env.step("open sesame")
        >>> text.split(":")[0], info["action"]
        ('That is no action, and nothing was done. The actions are', None)
    """

    metadata: dict[str, Any] = {"render_modes": ["ansi"], "render_fps": 4}  # noqa: RUF012

    def __init__(
        self,
        schema: AnySchema = "CC3",
        layout: LayoutForm = RANDOM_LAYOUT,
        reward: RewardForm = BASIC_REWARD,
        attempt_limit: int = ATTEMPT_LIMIT,
        action_limit: int | None = None,
        positions: int | None = None,
        story: StoryName = ANY,
        render_mode: str | None = None,
    ) -> None:
        self._env = OpenLockEnv(
            schema, layout, reward, "trial", attempt_limit, action_limit, positions
        )
        self.settings = self._env.settings
        self._story, self.render_mode = story, render_mode
        texts = spaces.Text(LONGEST, min_length=0, charset=string.printable)
        self.observation_space, self.action_space = texts, texts
        self._words = Wording.draw(self.settings.positions, np.random.default_rng(0), story)
        self._text = ""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[str, dict[str, Any]]:
        """Begin a new trial; the observation begins with the instructions.

        Args:
            seed: Seeds the environment and draws another wording.
            options: ``{"new_trial": True}``, which it does anyway.
        """
        self._observation, info = self._env.reset(seed=seed, options=options)
        super().reset(seed=seed)
        if seed is not None or not self._text:
            self._words = Wording.draw(self.settings.positions, self.np_random, self._story)
        self._console = info["console"]
        rules = self._words.instructions(self.settings.action_limit, self.settings.attempt_limit)
        self._text = f"{rules}\n\n{self._room()}"
        return self._text, self._info(None, info)

    def step(self, action: str) -> tuple[str, float, bool, bool, dict[str, Any]]:
        """Take the action that a text names; its last line counts.

        Raises:
            ResetNeeded: Before the first reset, and after the end of an episode.
            InvalidAction: If the action is not a text.
        """
        if self._env.trial_over:
            raise ResetNeeded("call reset() before step(), and after the end of every episode")
        words = self._words
        if not isinstance(action, str):
            raise InvalidAction(f"an action is a text, such as {words.choices[0]!r}")
        chosen = words.read(action)
        if chosen is None:
            self._text = words.no_action
            return self._text, 0.0, False, False, self._info(None, {})
        before, known = self._observation, self._console
        self._observation, reward, solved, spent, info = self._env.step(chosen)
        self._console = info["console"]
        new = self._console["solutions_found"] > known["solutions_found"]
        outcome = info.get("outcome", self._observation)  # right after the action
        lines = [words.outcome(before, outcome, new)]
        if "outcome" in info:
            number = self.settings.attempt_limit + 1 - known["attempts_left"]
            lines.append(words.ending(number, solved or spent, self._console["solutions_left"]))
        if not (solved or spent):
            lines.append(self._room())
        self._text = "\n".join(lines)
        return self._text, reward, solved, spent, self._info(chosen, info)

    def render(self) -> str | None:
        """The last observation, with ``render_mode="ansi"``."""
        return self._text if self.render_mode == "ansi" else None

    def _info(self, action: int | None, info: dict[str, Any]) -> dict[str, Any]:
        actions = tuple(self._words.choices)
        return {**info, "console": dict(self._console), "action": action, "actions": actions}

    def _room(self) -> str:
        number = self.settings.attempt_limit + 1 - self._console["attempts_left"]
        return self._words.room(self._observation, self._console, number, "1 of 1")
