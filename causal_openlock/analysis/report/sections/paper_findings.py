"""The paper's tests: what people show, and which learners show it."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import (
    ALPHA,
    POWER,
    contrast_subjects_needed,
    power_of_contrast,
    power_of_t,
    subjects_needed,
)
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionTable
from causal_openlock.analysis.results.decisions import Decisions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.people.paper_tests import (
    PEOPLE,
    TESTS,
    PaperTest,
    outcome_text,
    paper_tests,
    printed_tests,
)
from causal_openlock.analysis.results.people.published import did_what_people_did

FAMILIES = {
    "baseline": "Baseline trials",
    "training": "Training trials",
    "transfer": "Transfer test",
}
_SUBJECTS_OF_PEOPLE = 40
_PROSE = Prose("paper_findings")


def compute(material: Material) -> pd.DataFrame:
    """All tests of the paper, of people and of learners."""
    chosen = material.trials[did_what_people_did(material.trials, material.like_people)]
    return paper_tests(chosen, material.learners)


def tests(computed: pd.DataFrame) -> dict[Hashable, float]:
    """The p of every test of a learner, by learner, family and test."""
    own = computed[computed["learner"] != PEOPLE]
    return {(row.learner, row.family, row.test): row.p for row in own.itertuples()}


def section(material: Material, decisions: Decisions) -> Section | None:
    """The paper's tests of every learner that did what people did; None if there is none."""
    tests: pd.DataFrame = decisions.computed("paper_findings").copy()
    if tests.empty:
        return None
    corrected = [
        np.nan
        if row.learner == PEOPLE
        else decisions.p("paper_findings", (row.learner, row.family, row.test))
        for row in tests.itertuples()
    ]
    tests.insert(tests.columns.get_loc("p") + 1, "p_corrected", corrected)
    own = tests[tests["learner"] != PEOPLE]
    undefined, defined = _split(own)
    families, tables = [], []
    for family, title in FAMILIES.items():
        if not (own["family"] == family).any():
            continue
        asked = [test for test in TESTS if test.family == family]
        without, rows = _split(defined[defined["family"] == family])
        found = [finding(test, rows[rows["test"] == test.name]) for test in asked]
        families.append(
            {
                "title": title,
                "tests": [one for one in found if one["total"]],
                "undefined": _reasons(without),
            }
        )
        tables.append(_family_table(family, tests[tests["family"] == family], asked, material))
    conditions = {(test.family, test.name): len(test.conditions) for test in TESTS}
    played = own[["family", "test", "subjects"]].itertuples(index=False)
    subjects = max(2, round(min(n / conditions[family, name] for family, name, n in played)))
    power = power_table(subjects)
    tables += [_power_table(power, subjects), _PROSE.table("paper_tests_all", tests, _NUMBERS)]
    return _PROSE.section(
        "paper_tests",
        tables,
        families=families,
        undefined=_reasons(undefined),
        alpha=ALPHA,
        subjects=subjects,
        weak=int((power["power_here"] < POWER).sum()),
        effects=len(power),
        power=POWER,
    )


_NUMBERS = {
    **dict.fromkeys(("p", "p_corrected"), ".2g"),
    **dict.fromkeys(("value", "hedges_g", "effect_size"), ".2f"),
    **{"difference": "+.2f", "subjects": ","},
}


def power_table(subjects: int) -> pd.DataFrame:
    """How likely the paper's tests are to find in a learner what they find in people.

    The learner has so many subjects in each condition, at least 2.

    Returns:
        A row for each test of two groups or of the interaction that the paper prints of baseline
        and transfer: ``test``, ``effect``, ``effect_size`` (of people), ``power_here`` (with so
        many subjects), ``power_of_paper`` (with the paper's 40) and ``subjects_needed`` (in each
        condition, for a power of 0.8).
    """
    of_people = printed_tests().set_index(["family", "test"])
    rows = []
    for test in TESTS:
        if test.kind == "trials" or test.family == "training":
            continue
        row = of_people.loc[(test.family, test.name)]
        if test.kind == "interaction":
            each = row["value"] / _SUBJECTS_OF_PEOPLE
            powers = [power_of_contrast(each, n, 4) for n in (subjects, _SUBJECTS_OF_PEOPLE)]
            needed = contrast_subjects_needed(each, 4)
            effect, size = "ηp²", row["effect_size"]
        else:  # two groups of one or more conditions; F of two groups is t squared
            t = row["value"] if test.kind == "t" else np.sqrt(row["value"])
            merged = len(test.sides[0])
            effect, size = "d", float(t * np.sqrt(2 / (merged * _SUBJECTS_OF_PEOPLE)))
            powers = [power_of_t(size, merged * n) for n in (subjects, _SUBJECTS_OF_PEOPLE)]
            both = subjects_needed(size)
            needed = None if both is None else -(-both // merged)
        rows.append((f"{FAMILIES[test.family]}: {test.name}", effect, size, *powers, needed))
    columns = ["test", "effect", "effect_size", "power_here", "power_of_paper", "subjects_needed"]
    return pd.DataFrame(rows, columns=columns)


def _family_table(
    family: str, rows: pd.DataFrame, asked: Sequence[PaperTest], material: Material
) -> SectionTable:
    shown = []
    for name in (PEOPLE, *material.learners):
        cells = {row["test"]: row for row in rows[rows["learner"] == name].to_dict("records")}
        if not cells:
            continue
        played = [test for test in asked if test.name in cells]
        n = sorted({round(cells[test.name]["subjects"] / len(test.conditions)) for test in played})
        outcomes = {test.name: "not played" for test in asked}
        outcomes |= {
            test.name: outcome_text(cells[test.name], cells[test.name]["p_corrected"])
            for test in played
        }
        shown.append(
            {
                "learner": f"{PEOPLE} (printed)" if name == PEOPLE else name,
                "n": " to ".join(dict.fromkeys(map(str, (n[0], n[-1])))),
                **outcomes,
            }
        )
    about = {"family": family, "title": FAMILIES[family]}
    return _PROSE.table("family", pd.DataFrame(shown), {}, f"paper_tests_{family}", **about)


def finding(test: PaperTest, rows: pd.DataFrame) -> dict[str, Any]:
    """What came of a test in people, and in which learners, of which rows are given.

    Returns:
        What the test claims of people (``claim``), what the ``paper`` prints, whether it is found
        ``in_people``, and of the ``total`` of learners those in which it is ``shown``, its
        ``opposite``, or is ``absent`` or ``undefined``.
    """
    defined = rows[rows["note"] == ""]
    significant = defined["p_corrected"] < ALPHA
    with_sign = (defined["difference"] > 0) | (not test.directed)
    people = printed_tests().set_index(["family", "test"]).loc[(test.family, test.name)]
    return {
        "claim": test.claim,
        "paper": people["paper"],
        "in_people": bool(people["p"] < ALPHA),
        "total": len(rows),
        "shown": list(defined.loc[significant & with_sign, "learner"]),
        "opposite": list(defined.loc[significant & ~with_sign, "learner"]),
        "absent": list(defined.loc[~significant, "learner"]),
        "undefined": list(rows.loc[rows["note"] != "", "learner"]),
    }


def _split(rows: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows of learners for which no test among them is defined, and those of the others."""
    silent = (rows["note"] != "").groupby(rows["learner"]).transform("all").astype(bool)
    return rows[silent], rows[~silent]


def _reasons(rows: pd.DataFrame) -> dict[str, list[str]]:
    """By reason, the learners that have no test at all."""
    why: dict[str, list[str]] = {}
    for name, notes in rows.groupby("learner", sort=False)["note"]:
        reasons = list(dict.fromkeys(notes.str.removeprefix("not defined: ")))
        alike = all(reason.startswith("every subject needed") for reason in reasons)
        several = "subjects do not differ" if alike else "for reasons given in the tables"
        why.setdefault(reasons[0] if len(reasons) == 1 else several, []).append(str(name))
    return why


def _power_table(power: pd.DataFrame, subjects: int) -> SectionTable:
    needed = f"n for a power of {POWER:g}"
    names = {
        "effect_size": "size in people",
        "power_here": f"power with n = {subjects}",
        "power_of_paper": f"power of the paper, n = {_SUBJECTS_OF_PEOPLE}",
        "subjects_needed": needed,
    }
    if subjects == _SUBJECTS_OF_PEOPLE:
        power = power.drop(columns="power_of_paper")
    formats = {**dict.fromkeys(names.values(), ".2f"), needed: ",.0f"}
    return _PROSE.table("paper_tests_power", power.rename(columns=names), formats, alpha=ALPHA)
