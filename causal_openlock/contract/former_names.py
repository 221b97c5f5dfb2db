"""Former names and parameters of the bundled learners, which files of earlier releases hold.

Until 0.2 their package was called ``learners``, a name that many projects give to a package of
their own. Experiment files and results with the old names are still read: each name is translated
here where it is read. Nothing is installed under the old name. A parameter that a learner was
given since is left out of identities while it has the value that stands for before.

>>> present_name("learners.bayes:Bayes")
'openlock_learners.bayes:Bayes'
>>> present_name("learners.mine:Mine")
'learners.mine:Mine'
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from causal_openlock.files.plugins import LEARNERS, registered
from causal_openlock.usercode.module_source import module_source

PACKAGE, FORMER_PACKAGE = "openlock_learners", "learners"
TOOLKIT = "causal-openlock"
"""The distribution that the bundled learners come with."""
ADDED: Mapping[str, Any] = {"double": True}
"""Parameters that bundled learners were given since, and the value that stands for before."""


def present_name(name: str) -> str:
    """Return a learner's name, translated if it is a former name of a bundled one.

    A name that the user's own package ``learners`` has stays as it is.

    Args:
        name: ``module:Class``, or the name of a registered learner.
    """
    present = _present(name)
    if present == name or module_source(name.partition(":")[0]):
        return name
    return present


def present_class(name: str, package: str) -> str:
    """Return the class of a stored learner, translated if the toolkit brought it.

    Args:
        name: ``module:Class``.
        package: The package and version that the results say it is from.
    """
    return _present(name) if package.startswith(f"{TOOLKIT} ") else name


def in_identities(name: str) -> str:
    """Return the name of a class as identities of cells have it.

    A bundled learner has its former name there, so that cells played before are still the same.
    """
    package, dot, rest = name.partition(".")
    return f"{FORMER_PACKAGE}{dot}{rest}" if package == PACKAGE else name


def parameters_in_identities(name: str, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a learner as identities of cells have them.

    >>> parameters_in_identities("openlock_learners.ddqn:DDQN", {"gamma": 0.8, "double": True})
    {'gamma': 0.8}

    Args:
        name: Its class, ``module:Class``.
        parameters: All its hyper-parameters.
    """
    added = ADDED if name.partition(".")[0] == PACKAGE else {}
    return {
        key: value for key, value in parameters.items() if key not in added or value != added[key]
    }


def _present(name: str) -> str:
    return _renamed().get(name, name)


@cache
def _renamed() -> dict[str, str]:
    """Present names of the bundled learners by their former names."""
    values = [
        one.value for one in registered(LEARNERS).values() if one.module.split(".")[0] == PACKAGE
    ]
    return {in_identities(value): value for value in values}
