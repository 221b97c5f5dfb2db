"""The arguments that the environments share, checked once."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any, Literal

from gymnasium import spaces

from causal_openlock.errors import ExperimentError, OpenLockError
from causal_openlock.experiment.protocol import MAX_ACTION_LIMIT, default_action_limit
from causal_openlock.files.validation import whole_number
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.rewards import RewardForm, find_reward
from causal_openlock.world.room import (
    RANDOM_LAYOUT,
    Layout,
    LayoutForm,
    position_names,
    positions_for,
)

ATTEMPT_LIMIT = 30
Episode = Literal["attempt", "trial"]
AnySchema = str | os.PathLike[str] | Mapping[str, Any] | Schema


class Settings:
    """The arguments that the environments share, checked.

    Attributes:
        schema: The schema of the rooms.
        layout: The positions of the levers; ``None`` draws a layout for every trial.
        positions: Number of positions.
        reward: The reward of each action.
        whole_trial: Whether an episode is a whole trial.
        attempt_limit: Attempts in a trial.
        action_limit: Actions in an attempt.
        observation_space: ``MultiBinary(2P + 2)``: 16 bits in the paper's room.
        action_space: ``Discrete(2P + 1)``: 15 actions in the paper's room.

    Raises:
        OpenLockError: What is wrong and how to correct it.
    """

    def __init__(
        self,
        schema: AnySchema,
        layout: LayoutForm,
        reward: RewardForm,
        episode: str,
        attempt_limit: int,
        action_limit: int | None,
        positions: int | None,
    ) -> None:
        self.schema = schema = find_schema(schema)
        if positions is None:
            own = layout.positions if isinstance(layout, Layout) else 0
            positions = max(own, positions_for(schema))
        self.positions = whole_number(positions, "positions")
        position_names(self.positions)  # refuses a number that no room has
        if self.positions < len(schema.levers):
            raise ExperimentError(
                f"{schema.name} has {len(schema.levers)} levers, more than {positions} positions"
            )
        if episode not in ("attempt", "trial"):
            raise OpenLockError(f"an episode is 'attempt' or 'trial', not {episode!r}")
        self.whole_trial = episode == "trial"
        self.attempt_limit = whole_number(attempt_limit, "attempt_limit", 1)
        if action_limit is None:
            action_limit = default_action_limit(schema)
        self.action_limit = whole_number(action_limit, "action_limit")
        if not schema.least_action_limit <= action_limit <= MAX_ACTION_LIMIT:
            raise ExperimentError(
                f"{schema.name} needs attempts of at least {schema.least_action_limit} actions and "
                f"no attempt can have more than {MAX_ACTION_LIMIT}, so action_limit cannot be "
                f"{action_limit}"
            )
        self.layout = None
        if not (isinstance(layout, str) and layout == RANDOM_LAYOUT):
            self.layout = Layout.of(schema, layout, self.positions)
        self.reward = find_reward(reward)
        self.observation_space = spaces.MultiBinary(2 * self.positions + 2)
        self.action_space: spaces.Discrete[Any] = spaces.Discrete(2 * self.positions + 1)


def check_options(options: Any, name: str) -> Any:
    """The option of this name of a reset; None if it is not given.

    Raises:
        OpenLockError: If the options are not a mapping, or there are others.
    """
    if options is None:
        return None
    if not isinstance(options, Mapping) or {*options} - {name}:
        raise OpenLockError(f"options is a dictionary such as {{{name!r}: ...}}, not {options!r}")
    return options.get(name)
