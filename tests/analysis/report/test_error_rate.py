"""Learners against themselves: how often a report says that anything differs where nothing does.

A thousand reports are simulated from what `ideal` and `oracle` do, without playing: the learners of
each report are the same one with other seeds. Nothing differs but by chance, so of the answers to
each question at most one in twenty may call anything significant.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from causal_openlock.analysis.decisions import Decisions
from causal_openlock.analysis.effects import ALPHA, Group, weighted_difference
from causal_openlock.analysis.topic import all_topics, decisions_of
from causal_openlock.analysis.topics.congruency import COMPARED
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.schemas.fsm import FloatArray
from support.paper_play import Attempts, material, play
from support.topics import topics_called

pytestmark = pytest.mark.slow

REPORTS, SUBJECTS, LEARNERS = 1000, 20, ("a", "b", "c", "d")

IDEAL = {"3": ([2, 3], [1 / 3, 2 / 3]), "4": ([3, 4], [1 / 4, 3 / 4])}
"""What the ideal observer needs with so many levers, and how often."""
ORACLE = {"3": ([2], [1.0]), "4": ([3], [1.0])}

Played = Mapping[str, Mapping[tuple[str, str], FloatArray]]
"""By learner, by condition and phase: ``[n, T]`` attempts."""


def drawn(rng: np.random.Generator, kind: Mapping[str, tuple[list[int], list[float]]]) -> Played:
    """What the learners of a report did."""

    def attempts(schema: str, trials: int) -> FloatArray:
        values, chances = kind[schema[-1]]
        return rng.choice(np.array(values, float), (SUBJECTS, trials), p=chances)

    def learner() -> dict[tuple[str, str], FloatArray]:
        held = {}
        for name in PAPER_CONDITIONS:
            if "-" in name:
                held[name, "train"] = attempts(name[:3], 6)
                held[name, "test"] = attempts(name[-3:], 1)
            else:
                held[name, "train"] = attempts(name, 5)
        return held

    return {name: learner() for name in LEARNERS}


def decided(played: Played) -> tuple[Decisions, dict[tuple[str, object], float]]:
    """The tests of such a report, and their p values, by the statistics alone."""
    pairs, congruent = {}, {}
    for one, other in combinations(played, 2):
        gaps = [
            Group.of((played[one][cell] - played[other][cell])[:, -1], 1 / 6)
            for name in PAPER_CONDITIONS
            for cell in [(name, "test" if "-" in name else "train")]
        ]
        pairs["human", one, other] = weighted_difference(gaps).p
    for learner, held in played.items():
        for test, names in COMPARED.items():
            congruent_, other = (held[name, "test"][:, 0] for name in names)
            p = stats.ttest_ind(other, congruent_).pvalue if np.ptp(other) else 1.0
            congruent["human", learner, test] = float(p)
    decisions = Decisions()
    each = {"pairwise": pairs, "congruency": congruent}
    for topic in topics_called(*each):
        decisions.register(topic.name, each[topic.name], family=topic.family)
    return decisions, {(s, key): p for s, tests in each.items() for key, p in tests.items()}


@pytest.mark.parametrize("kind", [IDEAL, ORACLE], ids=["ideal", "oracle"])
def test_one_answer_in_twenty_at_most_says_that_equals_differ(
    kind: Mapping[str, tuple[list[int], list[float]]],
) -> None:
    rng = np.random.default_rng(14)
    wrong, careless = Counter[object](), Counter[object]()
    for _ in range(REPORTS if kind is IDEAL else 20):  # the oracle always does the same
        decisions, tests = decided(drawn(rng, kind))
        asked: dict[object, list[tuple[str, object]]] = {}
        for name, key in tests:
            asked.setdefault(decisions._family[name, key], []).append((name, key))
        for question, keys in asked.items():
            wrong[question] += any(decisions.found(*key) for key in keys)
            careless[question] += any(tests[key] < ALPHA for key in keys)
    assert len(wrong) == 1 + 4 * 2
    assert max(wrong.values()) <= stats.binom.ppf(0.9999, REPORTS, ALPHA)
    if kind is IDEAL:
        # Each pair by itself: an answer in six would say something false.
        assert max(careless.values()) > REPORTS / 6
    else:
        assert wrong.total() == careless.total() == 0


def test_these_are_the_tests_that_a_report_makes() -> None:
    played = drawn(np.random.default_rng(3), IDEAL)

    # A made-up trial takes three attempts or more, so that all are one higher.
    def as_drawn(name: str) -> Attempts:
        return lambda condition, phase, trial, subject: int(
            played[name][condition, phase][subject, trial - 1] + 1
        )

    rows = [row for name in LEARNERS for row in play(name, as_drawn(name), SUBJECTS)]
    ours, tests = decided(played)
    # Without the first screen's tests against people, from whom learners do differ.
    sections = [topic for topic in all_topics() if topic.name not in ("exploration", "leaderboard")]
    theirs = decisions_of(material(rows, LEARNERS), sections)
    assert ours.total == theirs.total == len(tests)
    for key in tests:
        assert theirs.p(*key) == pytest.approx(ours.p(*key))
