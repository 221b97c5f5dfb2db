"""Which learners discover a causal schema by acting, and carry it to a new situation?

What notebooks and scripts use is a name of this package, such as ``causal_openlock.compare``;
``__init__.pyi`` lists these names, and all others stand in their modules. A name is loaded when it
is first used, so that importing the package costs little more than importing Gymnasium. Importing
it registers the environments ``causal_openlock/OpenLock-v0`` and ``OpenLockText-v0`` and, where
IPython runs, what notebooks show.

>>> from causal_openlock import find_schema
>>> find_schema("CC3").solutions
(('L0', 'L1'), ('L0', 'L2'))
"""

from __future__ import annotations

import sys
import warnings
from importlib import import_module
from pathlib import Path
from typing import Any

import lazy_loader
from gymnasium.envs.registration import register, registry

from causal_openlock.version import __version__ as __version__

_public, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    """Load a public name; one that stood here before comes with a warning that says where."""
    if name not in __all__ and not name.startswith("_"):
        for line in Path(__file__).with_name("moved.txt").read_text(encoding="utf-8").splitlines():
            moved, module, now = line.split()
            if moved == name:
                text = f"causal_openlock.{name} is now imported by: from {module} import {now}"
                warnings.warn(text, DeprecationWarning, stacklevel=2)
                return getattr(import_module(module), now)
    return _public(name)


ENV_ID = "causal_openlock/OpenLock-v0"
TEXT_ID = "causal_openlock/OpenLockText-v0"

if ENV_ID not in registry:
    register(
        id=ENV_ID,
        entry_point="causal_openlock.envs:OpenLockEnv",
        vector_entry_point="causal_openlock.envs:OpenLockVectorEnv",
    )
    register(id=TEXT_ID, entry_point="causal_openlock.envs:OpenLockTextEnv")

if "IPython" in sys.modules:
    from causal_openlock.notebook import register_formatters

    register_formatters()
