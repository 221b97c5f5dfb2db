"""Spares Sphinx work that changes nothing or that no page shows.

Only what it takes to write the same pages is changed; the site is the same without this file.
"""

from __future__ import annotations

import inspect
from collections import defaultdict
from functools import cache
from typing import Any

from sphinx.application import Sphinx
from sphinx.ext.autodoc._dynamic import _signatures
from sphinx.pycode.parser import Parser


def defaults_where_there_are_any() -> None:
    """Read the source of a function for its defaults only if it has some, and of no class."""
    update = _signatures.update_default_value

    def update_default_value(obj: Any, bound_method: bool) -> None:
        function = inspect.unwrap(obj)
        if getattr(function, "__defaults__", None) or getattr(function, "__kwdefaults__", None):
            update(obj, bound_method)

    _signatures.update_default_value = update_default_value


def no_lines_of_definitions() -> None:
    """Do not work out at which lines definitions are: only pages of source code show that."""
    Parser.parse_definition = lambda self: None


def find_by_last_name(app: Sphinx, env: Any) -> None:
    """Look for a name once, and only among those that end like it; most (int, Any) are not ours."""
    domain = env.domains.python_domain
    find, objects = domain.find_obj, domain.objects
    alike: dict[str, dict[str, Any]] = defaultdict(dict)
    for name, entry in objects.items():
        alike[name.rpartition(".")[2]][name] = entry

    @cache
    def find_obj(env: Any, module: str, owner: str, name: str, *how: Any) -> Any:
        domain.data["objects"] = alike[name.removesuffix("()").rpartition(".")[2]]
        try:
            return find(env, module, owner, name, *how)
        finally:
            domain.data["objects"] = objects

    domain.find_obj = find_obj


def setup(app: Sphinx) -> None:
    """Spare the work."""
    defaults_where_there_are_any()
    no_lines_of_definitions()
    app.connect("env-updated", find_by_last_name)
