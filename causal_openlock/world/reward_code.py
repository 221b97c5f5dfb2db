"""User-defined rewards, written in Python.

``module:function`` names a function of the events of actions, in a file of the working directory or
next to the experiment file, or in an installed package::

    def eager(events):
        # Opening the door pays more while fewer solutions are found.
        return 50.0 * events.opens / (1 + events.found) - 0.1

It gets the :class:`~causal_openlock.world.events.Events` of N actions and returns N numbers, each
of which must depend on the events of its own action alone: the function is called once for all
events that there can be. In Python the function itself can be given, also one that a notebook's
cell defines. A hash of its file and of the user's modules that it imports is recorded, and results
can be read without the code.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from causal_openlock.errors import ExperimentError
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.usercode import own_files
from causal_openlock.usercode.session_code import is_of_session, session_origin
from causal_openlock.world.events import Events, RewardFunction, rewards_by_event


@dataclass(frozen=True)
class OwnReward(RewardFunction):
    """A reward that is a user's function, loaded when it is evaluated."""

    name: str  #: ``module:function``
    source: str  #: name of its file, and a hash of it and of the user's modules that it imports
    is_own = True

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action.

        Raises:
            ExperimentError: If the function fails or does not return N finite numbers.
        """
        function, number = _function(self.name), len(events.first)
        try:
            paid = np.asarray(function(events))
        except Exception as error:  # a user's code can fail in any way
            raise ExperimentError(
                f"the reward {self.name} fails ({type(error).__name__}: {error})"
            ) from error
        if paid.shape != (number,) or paid.dtype.kind not in "iufb" or not np.isfinite(paid).all():
            raise ExperimentError(
                f"the reward {self.name} has to return one finite number for each of {number} "
                f"actions, and returned {paid.dtype} of shape {paid.shape}: {paid}"
            )
        return paid.astype(np.float64)

    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data."""
        return {"name": self.name, "function": self.name, "source": self.source}


def own_reward(given: str | Callable[..., Any]) -> OwnReward:
    """A function, itself or as ``module:function``, as a reward, tried out on all events.

    Raises:
        ExperimentError: If there is no such function, workers cannot find it by a name, or it does
            not work as a reward.
    """
    name = given
    if not isinstance(name, str):
        name = f"{given.__module__}:{getattr(given, '__qualname__', '')}"
        if not (own_files.MODULE_AND_NAME.fullmatch(name) and _function(name) is given):
            raise ExperimentError(
                f"the reward {given!r} cannot be found by a name, as workers have to; define it "
                "with def at the top level of a notebook or of a module"
            )
    reward = OwnReward(name, reward_source(name))
    rewards_by_event([reward], np.arange(256), 2)
    return reward


def _function(name: str) -> Callable[[Events], Any]:
    """A user's function by its name."""
    function = own_files.load_named(name, "reward", inspect.isfunction)
    if not callable(function) or isinstance(function, type):
        raise ExperimentError(f"{name!r} is not a function; a reward is a function of events")
    return function


def reward_source(name: str) -> str:
    """The file of a user's function, with a hash of it as this process imported it."""
    _function(name)
    if is_of_session(name):
        return session_origin(name)
    module = name.partition(":")[0]  # even if it has the function from elsewhere
    source = own_files.module_source(module)
    if source is None:
        raise ExperimentError(f"{name!r} has no source that can be recorded; write it in a file")
    return f"{source.name} {own_files.code_digest([module], imported=True)}"
