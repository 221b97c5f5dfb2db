"""Which effects a report may call found: all its tests are corrected together, once.

A report makes dozens of tests. If each were judged by itself, one in twenty would find an effect
where there is none, so that most reports said something false. Sections therefore register their
tests before any of them is written, and all p values of the report are corrected after Holm: of a
report on learners that do not differ at all, at most one in twenty says anywhere that they do.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np

from causal_openlock.analysis.effects import ALPHA, holm


class Decisions:
    """The tests of a report, by section and key, and what is found once all are there.

    >>> decisions = Decisions()
    >>> decisions.register("pairs", {"a, b": 0.02, "a, c": 0.001})
    >>> decisions.register("transfer", {"a": 0.04})
    >>> decisions.found("pairs", "a, c"), decisions.found("pairs", "a, b"), decisions.total
    (True, True, 3)
    >>> decisions.p("transfer", "a")
    0.04
    """

    def __init__(self) -> None:
        self._tests: dict[tuple[str, Hashable], float] = {}
        self._corrected: dict[tuple[str, Hashable], float] = {}
        self._computed: dict[str, Any] = {}

    def register(self, section: str, tests: Mapping[Hashable, float], computed: Any = None) -> None:
        """Add the p values of a section; those that are not defined are NaN.

        Args:
            section: Its name.
            tests: The p values, by key.
            computed: What they are taken from, for the section to be written from.

        Raises:
            ValueError: If something was decided already: it might come out otherwise now.
        """
        if self._corrected:
            raise ValueError(f"the tests of {section} come after the report's have been decided")
        self._tests |= {(section, key): p for key, p in tests.items()}
        self._computed[section] = computed

    def computed(self, section: str) -> Any:
        """What the tests of a section are taken from; None if it has registered none."""
        return self._computed.get(section)

    def of(self, section: str) -> Decided:
        """What is decided of one section."""
        return Decided(self, section)

    @property
    def total(self) -> int:
        """How many tests are defined."""
        return int((~np.isnan([*self._tests.values()])).sum()) if self._tests else 0

    def has(self, section: str, key: Hashable) -> bool:
        """Whether there is such a test."""
        return (section, key) in self._tests

    def p(self, section: str, key: Hashable) -> float:
        """A corrected p; NaN where the test is not defined."""
        if not self._corrected:
            corrected = holm(np.array([*self._tests.values()], float)).tolist()
            self._corrected = dict(zip(self._tests, corrected, strict=True))
        return self._corrected[section, key]

    def found(self, section: str, key: Hashable) -> bool:
        """Whether an effect is beyond chance, with all tests of the report in view."""
        return self.p(section, key) < ALPHA


class Decided(NamedTuple):
    """What is decided of one section, with all tests of the report in view."""

    decisions: Decisions
    section: str

    @property
    def computed(self) -> Any:
        """What its tests are taken from."""
        return self.decisions.computed(self.section)

    def p(self, key: Hashable) -> float:
        """A corrected p; NaN where the test is not defined."""
        return self.decisions.p(self.section, key)

    def found(self, key: Hashable) -> bool:
        """Whether an effect is beyond chance."""
        return self.decisions.found(self.section, key)
