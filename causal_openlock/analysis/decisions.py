"""Decisions on significance: the tests of one question are corrected together, after Holm.

A report answers several questions, and some with several tests: which pairs of learners differ,
which learners differ from people. If each
test were judged by itself, one in twenty would find an effect where there is none. So the tests of
a *family*, which is one question, are corrected together: where nothing differs, at most one answer
in twenty says that something does. What else is in the report, such as one learner more, changes no
answer that is not about it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple

import numpy as np

from causal_openlock.analysis.effects import ALPHA, holm


class Decisions:
    """The tests of a report, by section and key, and what is significant.

    >>> decisions = Decisions()
    >>> decisions.register("pairs", {"a, b": 0.02, "a, c": 0.001, "b, c": 0.04})
    >>> decisions.register("transfer", {"a": 0.04, "b": 0.04}, family=lambda learner: learner)
    >>> decisions.p("pairs", "a, b"), decisions.p("transfer", "a")
    (0.04, 0.04)
    >>> decisions.found("pairs", "a, c")
    True
    """

    def __init__(self) -> None:
        self._tests: dict[tuple[str, Hashable], float] = {}
        self._family: dict[tuple[str, Hashable], Hashable] = {}
        self._corrected: dict[tuple[str, Hashable], float] = {}
        self._computed: dict[str, Any] = {}

    def register(
        self,
        section: str,
        tests: Mapping[Hashable, float],
        computed: Any = None,
        family: Callable[[Any], Hashable] = lambda _: None,
    ) -> None:
        """Add the p values of a section; those that are not defined are NaN.

        Args:
            section: Its name.
            tests: The p values, by key.
            computed: What they are taken from, for the section to be written from.
            family: From a key to the question that its test is about; by default the section asks
                one question.

        Raises:
            ValueError: If something was decided already: it might come out otherwise now.
        """
        if self._corrected:
            raise ValueError(f"the tests of {section} come after the report's have been decided")
        self._tests |= {(section, key): p for key, p in tests.items()}
        self._family |= {(section, key): (section, family(key)) for key in tests}
        self._computed[section] = computed

    def computed(self, section: str) -> Any:
        """Data behind the tests of a section; None if it has registered none."""
        return self._computed.get(section)

    def of(self, section: str) -> Decided:
        """Decisions on the tests of one section."""
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
            members = defaultdict(list)
            for test, family in self._family.items():
                members[family].append(test)
            for tests in members.values():
                corrected = holm(np.array([self._tests[test] for test in tests], float)).tolist()
                self._corrected |= dict(zip(tests, corrected, strict=True))
        return self._corrected[section, key]

    def size(self, section: str, key: Hashable) -> int:
        """How many tests are defined in the family of a test."""
        family = self._family[section, key]
        tests = [test for test, other in self._family.items() if other == family]
        return int((~np.isnan([self._tests[test] for test in tests])).sum())

    def found(self, section: str, key: Hashable) -> bool:
        """Whether an effect is significant, with all tests of its family in view."""
        return self.p(section, key) < ALPHA


class Decided(NamedTuple):
    """Decisions on the tests of one section."""

    decisions: Decisions
    section: str

    @property
    def computed(self) -> Any:
        """Data behind the section's tests."""
        return self.decisions.computed(self.section)

    def p(self, key: Hashable) -> float:
        """A corrected p; NaN where the test is not defined."""
        return self.decisions.p(self.section, key)

    def found(self, key: Hashable) -> bool:
        """Whether an effect is significant."""
        return self.decisions.found(self.section, key)
