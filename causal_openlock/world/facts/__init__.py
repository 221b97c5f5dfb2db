"""Published facts: the room, the layouts, and what people and models did in it.

``room.yaml`` holds the geometry of the paper's Figure 2a and the layouts that its authors
published; ``results.yaml`` holds the results of three papers, measured from their figures.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any


def room_facts() -> dict[str, Any]:
    """The content of ``room.yaml``."""
    return _loaded("room.yaml")


def results() -> dict[str, Any]:
    """The content of ``results.yaml``."""
    return _loaded("results.yaml")


@cache
def _loaded(name: str) -> Any:
    from ruamel.yaml import YAML

    return YAML(typ="safe", pure=True).load(Path(__file__).with_name(name))
