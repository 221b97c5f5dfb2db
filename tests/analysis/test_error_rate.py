"""Learners against themselves: how often a report says that anything differs where nothing does.

Hundreds of reports are simulated from what `ideal` and `oracle` do, without playing: the learners
of each report are the same one with other seeds. Nothing differs but by chance, so of the answers
to each question at most one in twenty may call anything significant.
"""

from collections import Counter
from itertools import combinations

import numpy as np
import pytest
from scipy import stats

from causal_openlock.analysis.effects import ALPHA, Group, holm, weighted_difference
from causal_openlock.analysis.topics.pairwise import pairs as all_pairs
from causal_openlock.analysis.topics.transfer import CONGRUENT, OTHER, transfer
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from support.paper_play import material, play

pytestmark = pytest.mark.slow

REPORTS, SUBJECTS, LEARNERS = 400, 20, ("a", "b", "c", "d")
IDEAL = {"3": ([2, 3], [1 / 3, 2 / 3]), "4": ([3, 4], [1 / 4, 3 / 4])}
"""What the ideal observer needs with so many levers, and how often."""
ORACLE = {"3": ([2], [1.0]), "4": ([3], [1.0])}


def drawn(rng, kind):
    """``[n, T]`` attempts of the learners of a report, by learner, by condition and phase."""

    def attempts(schema, trials):
        values, chances = kind[schema[-1]]
        return rng.choice(np.array(values, float), (SUBJECTS, trials), p=chances)

    def learner():
        cells = {}
        for name in PAPER_CONDITIONS:
            if "-" in name:
                cells[name, "train"] = attempts(name[:3], 6)
                cells[name, "test"] = attempts(name[-3:], 1)
            else:
                cells[name, "train"] = attempts(name, 5)
        return cells

    return {name: learner() for name in LEARNERS}


def p_of(played):
    """The p values of such a report by question, by the statistics alone."""
    pairs, congruent = {}, {}
    for one, other in combinations(played, 2):
        gaps = [
            Group.of((played[one][cell] - played[other][cell])[:, -1], 1 / 6)
            for name in PAPER_CONDITIONS
            for cell in [(name, "test" if "-" in name else "train")]
        ]
        pairs[one, other] = weighted_difference(gaps).p
    for learner, cells in played.items():
        for condition in CONGRUENT.values():
            same, other = (cells[name, "test"][:, 0] for name in (condition, OTHER[condition]))
            p = stats.ttest_ind(other, same).pvalue if np.ptp(other) else 1.0
            congruent[learner, condition] = float(p)
    # A question about pairs is one of all pairs; one about training is each by itself.
    return {"pairs": [*pairs.values()]} | {key: [p] for key, p in congruent.items()}


@pytest.mark.parametrize("kind", [IDEAL, ORACLE], ids=["ideal", "oracle"])
def test_one_answer_in_twenty_at_most_says_that_equals_differ(kind):
    rng = np.random.default_rng(14)
    wrong, careless = Counter(), Counter()
    for _ in range(REPORTS if kind is IDEAL else 20):  # the oracle always does the same
        for question, ps in p_of(drawn(rng, kind)).items():
            wrong[question] += min(holm(np.array(ps))) < ALPHA
            careless[question] += min(ps) < ALPHA
    assert len(wrong) == 1 + 4 * 2
    assert max(wrong.values()) <= stats.binom.ppf(0.9999, REPORTS, ALPHA)
    if kind is IDEAL:
        # Each pair by itself: an answer in six would say something false.
        assert max(careless.values()) > REPORTS / 6
    else:
        assert wrong.total() == careless.total() == 0


def test_these_are_the_tests_that_a_report_makes():
    played = drawn(np.random.default_rng(3), IDEAL)

    def as_drawn(name):
        """A made-up trial takes three attempts or more, so that all are one higher."""
        return lambda condition, phase, trial, subject: int(
            played[name][condition, phase][subject, trial - 1] + 1
        )

    rows = [row for name in LEARNERS for row in play(name, as_drawn(name), SUBJECTS)]
    ours, results = p_of(played), material(rows, LEARNERS)
    pairs = all_pairs(results)
    assert pairs["p"].tolist() == pytest.approx(ours.pop("pairs"))
    assert pairs["p_corrected"].tolist() == pytest.approx(holm(pairs["p"].to_numpy()).tolist())
    saved = transfer(results).query("not reference").set_index(["learner", "condition"])["p"]
    assert saved[[*ours]].tolist() == pytest.approx([p for (p,) in ours.values()])
