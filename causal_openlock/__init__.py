"""Which learners discover a causal schema by acting, and carry it to a new situation?

The names below are loaded when they are first used, so that importing the package costs little
more than importing Gymnasium. Importing it registers the environments
``causal_openlock/OpenLock-v0`` and ``causal_openlock/MixedRooms-v0``.
"""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING, Any

from gymnasium.envs.registration import register, registry

from causal_openlock.version import __version__

if TYPE_CHECKING:
    from causal_openlock.contract.learner import Brief as Brief
    from causal_openlock.contract.learner import InformedLearner as InformedLearner
    from causal_openlock.contract.learner import Learner as Learner
    from causal_openlock.contract.learner import Step as Step
    from causal_openlock.contract.learner import View as View
    from causal_openlock.contract.one_subject import OneSubjectLearner as OneSubjectLearner
    from causal_openlock.envs import OpenLockEnv as OpenLockEnv
    from causal_openlock.envs import OpenLockVectorEnv as OpenLockVectorEnv
    from causal_openlock.errors import OpenLockError as OpenLockError
    from causal_openlock.experiment.protocol import Condition as Condition
    from causal_openlock.experiment.protocol import Protocol as Protocol
    from causal_openlock.experiment.session import Session as Session
    from causal_openlock.formats.schema_file import find_schema as find_schema
    from causal_openlock.formats.schema_file import read_schema as read_schema
    from causal_openlock.formats.schema_file import write_schema as write_schema
    from causal_openlock.world.fsm import FSM as FSM
    from causal_openlock.world.fsm import compile_schema as compile_schema
    from causal_openlock.world.room import Layout as Layout
    from causal_openlock.world.room import Room as Room
    from causal_openlock.world.schema import Gate as Gate
    from causal_openlock.world.schema import Schema as Schema

ENV_ID = "causal_openlock/OpenLock-v0"
MIXED_ID = "causal_openlock/MixedRooms-v0"

_HOMES = {
    "envs": ("OpenLockEnv", "OpenLockVectorEnv"),
    "errors": ("OpenLockError",),
    "world.fsm": ("FSM", "compile_schema"),
    "contract.learner": ("Brief", "InformedLearner", "Learner", "Step", "View"),
    "contract.one_subject": ("OneSubjectLearner",),
    "experiment.protocol": ("Condition", "Protocol"),
    "world.room": ("Layout", "Room"),
    "world.schema": ("Gate", "Schema"),
    "formats.schema_file": ("find_schema", "read_schema", "write_schema"),
    "experiment.session": ("Session",),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = ["ENV_ID", "__version__", *_HOME_OF]

if ENV_ID not in registry:
    register(
        id=ENV_ID,
        entry_point="causal_openlock.envs:OpenLockEnv",
        vector_entry_point="causal_openlock.envs:OpenLockVectorEnv",
    )
    register(id=MIXED_ID, entry_point="causal_openlock.envs:MixedRoomsEnv")

if "IPython" in sys.modules:
    from causal_openlock.notebook import register_formatters

    register_formatters()


def __getattr__(name: str) -> Any:
    if name in _HOME_OF:
        return getattr(importlib.import_module(f"{__name__}.{_HOME_OF[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
