"""The paper's tests, in the paper's order, for every learner that did what people did.

The paper tests whether people learn over the baseline trials, and which structure is the harder
one; whether the groups that are trained learn alike; and whether training with one structure helps
more with the same structure than with the other. The same tests are run on learners here, and next
to the statistics that the paper prints. Their p values are not corrected.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.measures import at_places, by_subject
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic
from causal_openlock.paper.published import people
from causal_openlock.paper.references import people_beside
from causal_openlock.paper.significance import (
    INTERACTION,
    SignificanceTest,
    contrast_test,
    hedges_g,
    t_test,
    trial_test,
)
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.world import facts

PEOPLE = "People"
_CC3, _CE3 = ("CC3-CC4", "CC3-CE4"), ("CE3-CC4", "CE3-CE4")
FAMILIES = {
    "baseline": "Baseline trials",
    "training": "Training trials",
    "transfer": "Transfer test",
}
_FORMATS = {
    "p": ".2g",
    **dict.fromkeys(("value", "hedges_g", "effect_size"), ".2f"),
    **{"difference": "+.2f", "subjects": ","},
}


class PaperTest(NamedTuple):
    """One of the paper's tests."""

    family: str  #: ``baseline``, ``training`` or ``transfer``
    name: str  #: what is compared; a difference of two is the first minus the second
    key: str  #: name of what the paper prints of it
    kind: str  #: ``trials``, ``one-way``, ``t`` or ``interaction``
    sides: tuple[tuple[str, ...], ...]  #: conditions that are compared; those of a side together
    phase: str  #: of the trials
    last: bool  #: whether the last trial alone is compared, and not the mean of all
    claim: str  #: what it tests, as the end of a sentence about people or learners
    directed: bool = True  #: whether only a difference above zero confirms it

    @property
    def conditions(self) -> tuple[str, ...]:
        """All conditions that the test needs."""
        return tuple(name for side in self.sides for name in side)

    def run(self, attempts: Mapping[str, FloatArray]) -> SignificanceTest:
        """Run it on ``[n, T]`` attempts of the n subjects of each condition in its T trials."""
        if self.kind == "trials":
            return trial_test([attempts[name] for name in self.conditions])
        groups = [
            np.concatenate([self._values(attempts[name]) for name in side]) for side in self.sides
        ]
        if self.kind == "t":
            return t_test(*groups)
        return contrast_test(groups, INTERACTION if self.kind == "interaction" else (1, -1))

    def _values(self, attempts: FloatArray) -> FloatArray:
        return attempts[:, -1] if self.last else attempts.mean(axis=1)


TESTS = (
    PaperTest("baseline", "trials", "trial effect", "trials", (("CC4",), ("CE4",)), "train", False,
        "need fewer attempts in later baseline trials"),
    PaperTest("baseline", "CE4 − CC4", "structure effect baseline", "one-way",
        (("CE4",), ("CC4",)), "train", False, "find CE4 harder than CC4 over all baseline trials"),
    PaperTest("baseline", "CE4 − CC4, last", "trial5 CE4 vs CC4", "t",
        (("CE4",), ("CC4",)), "train", True, "find CE4 harder than CC4 in the last baseline trial"),
    PaperTest("training", "trials", "training trial effect", "trials", (_CC3, _CE3), "train", False,
        "need fewer attempts in later training trials"),
    PaperTest("training", "CE3 − CC3", "training CC3 vs CE3", "one-way", (_CE3, _CC3), "train",
        False, "find CE3 harder than CC3 in training"),
    PaperTest("training", "CC3, last: CC4 − CE4", "final training CC3-CC4 vs CC3-CE4", "t",
        (_CC3[:1], _CC3[1:]), "train", True,
        "differ in the last CC3 training trial by the test that awaits them", False),
    PaperTest("training", "CE3, last: CC4 − CE4", "final training CE3-CC4 vs CE3-CE4", "t",
        (_CE3[:1], _CE3[1:]), "train", True,
        "differ in the last CE3 training trial by the test that awaits them", False),
    PaperTest("transfer", "interaction", "transfer interaction", "interaction",
        (("CE3-CC4",), ("CC3-CC4",), ("CE3-CE4",), ("CC3-CE4",)), "test", False,
        "gain more from training with the structure of the test than with the other"),
    PaperTest("transfer", "CC4: CE3 − CC3", "CC4: CC3 vs CE3 training", "t",
        (("CE3-CC4",), ("CC3-CC4",)), "test", False,
        "solve CC4 in fewer attempts after CC3 than after CE3"),
    PaperTest("transfer", "CE4: CC3 − CE3", "CE4: CE3 vs CC3 training", "t",
        (("CC3-CE4",), ("CE3-CE4",)), "test", False,
        "solve CE4 in fewer attempts after CE3 than after CC3"),
    PaperTest("transfer", "CE4 − CC4", "transfer test structure", "one-way",
        (("CC3-CE4", "CE3-CE4"), ("CC3-CC4", "CE3-CC4")), "test", False,
        "find CE4 harder than CC4 in the transfer test"),
)  # fmt: skip
"""The paper's tests in the paper's order; every difference is positive in people where they show
the effect."""


@cache
def printed_tests() -> pd.DataFrame:
    """The paper's printed tests, in the form of :func:`paper_tests`.

    p values and sizes of effects follow from the printed statistics and their degrees of freedom,
    differences from the published means. Training trials are not published: there differences are
    NaN, and t has no sign.
    """
    rows = []
    means = people()
    size = int(means["subjects"].iloc[0])
    for test in TESTS:
        printed = facts.results()["cogsci2018"]["human"]["statistics"][test.key]
        drawn = means[(means["phase"] == test.phase) & means["condition"].isin(test.conditions)]
        difference = np.nan
        if len(drawn):  # the difference needs the means alone
            by_condition = drawn.groupby("condition", sort=False)["mean"]
            means_alone = {str(name): row.to_numpy()[None] for name, row in by_condition}
            difference = test.run(means_alone).difference
        if "F" in printed:
            outcome = SignificanceTest.of_f(printed["F"], tuple(printed["df"]), difference)
        else:
            d = printed["t"] * float(np.sqrt(2 / size))
            outcome = SignificanceTest("t", (printed["df"],), difference, printed["t"], d)
        rows.append(_row(PEOPLE, test, size * len(test.conditions), outcome))
    return pd.DataFrame(rows)


def paper_tests(trials: pd.DataFrame, learners: Sequence[str]) -> pd.DataFrame:
    """Every test of the paper: people's as printed, then those of each learner.

    Subjects that have not played every trial of a condition are left out of it; the loops of a
    subject are averaged first. Trials are those under the conditions that people had.

    Returns:
        A row for each test of the paper's conditions that a learner played, in the paper's order
        (nothing at all if none did):

        - ``learner``, ``family``, ``test``; ``subjects``: in all groups together.
        - ``difference``: of means, in attempts: the first minus the second of ``test``; of trials
          the first minus the last; of the interaction what training with the structure of the
          test saves, the mean over both structures.
        - ``statistic`` (t or F), ``df`` (such as ``1, 78``), ``value`` and ``p``.
        - ``effect`` (``d`` or ``ηp²``), ``effect_size`` and, of d, ``hedges_g``; these numbers are
          NaN where a test is not defined.
    """
    means = by_subject(trials, ["phase", "trial"])
    whole: dict[tuple[str, ...], FloatArray] = {}
    for group, own in means.groupby(["learner", "phase", "condition"], observed=True):
        attempts, _ = at_places(own, ["trial"])
        if len(complete := attempts[~np.isnan(attempts).any(axis=1)]):
            whole[tuple(map(str, group))] = complete
    rows = []
    for learner, test in product(learners, TESTS):
        keys = {name: (learner, test.phase, name) for name in test.conditions}
        groups = {name: whole[key] for name, key in keys.items() if key in whole}
        same_trials = len({attempts.shape[1] for attempts in groups.values()}) == 1
        if groups.keys() == keys.keys() and same_trials:
            rows.append(_row(learner, test, sum(map(len, groups.values())), test.run(groups)))
    people = printed_tests()
    return pd.concat([people, pd.DataFrame(rows)], ignore_index=True) if rows else people[:0]


def _row(
    learner: str, test: PaperTest, subjects: int, outcome: SignificanceTest
) -> dict[str, object]:
    is_t = outcome.statistic == "t"
    return {
        "learner": learner,
        "family": test.family,
        "test": test.name,
        "subjects": subjects,
        "difference": outcome.difference + 0.0,  # no minus zero
        "statistic": outcome.statistic,
        "df": ", ".join(map(str, outcome.df)),
        "value": outcome.value,
        "p": outcome.p,
        "effect": "d" if is_t else "ηp²",
        "effect_size": outcome.effect,
        "hedges_g": hedges_g(outcome.effect, outcome.df[0]) if is_t else np.nan,
    }


def section(material: Material) -> Section | None:
    """The paper's tests of every learner that did what people did; None if there is none."""
    played = material.trials[people_beside(material).stands(material.trials)]
    tests = paper_tests(played, material.learners)
    if tests.empty:
        return None
    by_test = dict(iter(tests.groupby(["family", "test"], sort=False)))
    rows = [(test, by_test[test.family, test.name]) for test in TESTS]
    asked = [(test, own) for test, own in rows if len(own) > 1]  # not of people alone
    frame = pd.DataFrame([finding(test, own.iloc[0], own.iloc[1:]) for test, own in asked])
    caption = (
        "Printed: the paper's statistic. Not defined: subjects do not differ, or no trial was "
        "solved within the limit."
    )
    title = "What people do, and which learners"
    summary = Table("paper_tests_found", title, frame, caption=caption)
    caption = (
        "Of people statistics are as printed; p and sizes of effects follow from them, and t of "
        "training has no sign. Test: the first minus the second; t is negative where the second "
        "needed more attempts. Of trials: multivariate test of repeated measures; of the "
        "interaction: 2 × 2 analysis of variance; F of two groups: one-way analysis of variance; "
        "t: two independent groups, two-sided. Differences of means of all trials, or of the last "
        "alone, in attempts; of trials the first less the last, of the interaction what training "
        "with the structure of the test saves, the mean over both. d: Cohen's; ηp²: partial eta "
        "squared. Subjects: in all groups together."
    )
    title = "Every test, as numbers"
    by_test = pd.concat([own for _, own in asked])
    numbers = Table("paper_tests_all", title, by_test, _FORMATS, caption)
    text = (
        "The paper's tests, in the paper's order, on the trials of every learner that did what "
        f"people did. Each is a question of its own, judged at p < {ALPHA} for people and learners "
        "alike; of tests on learners that show nothing, about one in twenty would come out "
        "significant. A test that is not significant may miss an effect that is too small for its "
        "number of subjects."
    )
    return Section("paper_tests", "The paper's tests", (text,), (summary, numbers))


def finding(test: PaperTest, people: pd.Series, learners: pd.DataFrame) -> dict[str, str]:
    """Say what came of a test, from its rows of :func:`paper_tests`.

    Returns:
        What ``people`` do (or not), the ``printed`` statistic, and the learners in which the effect
        is ``significant``, its ``opposite`` is, neither is, or the test is ``not defined``.
    """
    defined = learners[learners["value"].notna()]
    significant = defined["p"] < ALPHA
    with_sign = (defined["difference"] > 0) | (not test.directed)
    statistic = f"{people['statistic']}({people['df']}) = {people['value']:.2f}"
    return {
        "people": f"{FAMILIES[test.family]}: they {test.claim}",
        "printed": f"{statistic}, p {'<' if people['p'] < ALPHA else '>'} {ALPHA:g}",
        "significant in": _listed(defined[significant & with_sign]),
        "opposite significant in": _listed(defined[significant & ~with_sign]),
        "not significant in": _listed(defined[~significant]),
        "not defined for": _listed(learners[learners["value"].isna()]),
    }


def _listed(rows: pd.DataFrame) -> str:
    return ", ".join(rows["learner"]) or "–"


TOPIC = Topic("paper_tests", 70, section)
