"""The section of the report on the paper's tests: what people show, and which learners show it."""

from __future__ import annotations

from collections.abc import Sequence

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
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.results.people.paper_tests import (
    PEOPLE,
    TESTS,
    PaperTest,
    outcome_text,
    paper_tests,
    printed_tests,
)
from causal_openlock.analysis.results.people.published import did_what_people_did
from causal_openlock.wording import counted, joined

FAMILIES = {
    "baseline": "Baseline trials",
    "training": "Training trials",
    "transfer": "Transfer test",
}
_DIFFERENCES = {
    "baseline": "CE4 − CC4: means of all trials; last: of the last trial.",
    "training": "CE3 − CC3: means of all trials; CC3, last: last trial of CC3 training, of those "
    "to be tested in CC4 and in CE4.",
    "transfer": "CC4: CE3 − CC3: the test of CC4, after training with CE3 and with CC3; CE4 − CC4: "
    "the tests, whatever the training was.",
}
_SUBJECTS_OF_PEOPLE = 40


def section(material: Material) -> Section | None:
    """The paper's tests of every learner that did what people did; None if there is none."""
    chosen = material.trials[did_what_people_did(material.trials, material.pairs)]
    tests = paper_tests(chosen, material.learners)
    if tests.empty:
        return None
    sizes = _sizes(tests)
    text = [
        "The paper's tests, in the paper's order, on the trials of every learner that did what "
        "people did. An effect counts as found where p, corrected after Holm for the tests of its "
        f"family, is below {ALPHA:g}; where none is found there may be one that is too small for "
        "so few subjects."
    ]
    own = tests[tests["learner"] != PEOPLE]
    silent, telling = _split(own)
    if len(silent):
        text[0] += (
            f" No test is defined for {_on_silent(silent)}, so nothing more is said of them here."
        )
    tables = []
    for family, title in FAMILIES.items():
        rows = tests[tests["family"] == family]
        if not (own["family"] == family).any():
            continue
        asked = [test for test in TESTS if test.family == family]
        silent, of_family = _split(telling[telling["family"] == family])
        found = [_finding(test, of_family[of_family["test"] == test.name]) for test in asked]
        if len(silent):
            found.append(f"Not defined for {_on_silent(silent)}.")
        if any(found):
            text.append(f"{title}. {' '.join(filter(None, found))}")
        tables.append(_family_table(family, title, rows, asked, material.learners))
    tables += [_power_table(min(sizes)), _numbers(tests)]
    text.append(_on_holm() + " " + _on_power(min(sizes)))
    return Section("paper_tests", "The paper's tests", tuple(text), tuple(tables))


def power_table(subjects: int) -> pd.DataFrame:
    """How likely the paper's tests are to find in a learner what they find in people.

    Args:
        subjects: Of the learner in each condition, at least 2.

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


def _sizes(tests: pd.DataFrame) -> list[int]:
    """How many subjects each learner has in each condition, roughly where these differ."""
    conditions = {(test.family, test.name): len(test.conditions) for test in TESTS}
    own = tests[tests["learner"] != PEOPLE]
    return [
        max(2, round(subjects / conditions[family, name]))
        for family, name, subjects in zip(own["family"], own["test"], own["subjects"], strict=True)
    ]


def _family_table(
    family: str,
    title: str,
    rows: pd.DataFrame,
    asked: Sequence[PaperTest],
    learners: Sequence[str],
) -> Table:
    shown = []
    for name in (PEOPLE, *learners):
        cells = {row["test"]: row for row in rows[rows["learner"] == name].to_dict("records")}
        if cells:
            n = sorted({round(cells[t.name]["subjects"] / len(t.conditions)) for t in asked
                        if t.name in cells})  # fmt: skip
            shown.append(
                {
                    "learner": f"{PEOPLE} (printed)" if name == PEOPLE else name,
                    "n": " to ".join(dict.fromkeys(map(str, (n[0], n[-1])))),
                    **{t.name: outcome_text(cells[t.name]) if t.name in cells else "not played"
                       for t in asked},
                }
            )  # fmt: skip
    return Table(
        f"paper_tests_{family}",
        f"{title}: tests",
        pd.DataFrame(shown),
        caption=(
            "n: subjects in each condition. Of trials: multivariate test of repeated measures, "
            if family != "transfer"
            else "n: subjects in each condition. Of the interaction: 2 × 2 analysis of variance, "
        )
        + "F of two groups: one-way analysis of variance; t: two independent groups, two-sided. "
        f"{_DIFFERENCES[family]} A difference is the first minus the second, and t is negative "
        "where the second needed more attempts. Holm: p corrected for the tests in the row. d: "
        "Cohen's; ηp²: partial eta squared. Of people statistics are as printed, p and the size of "
        "the effect follow from them" + (", t has no sign." if family == "training" else "."),
    )


def _numbers(tests: pd.DataFrame) -> Table:
    formats = dict.fromkeys(("p", "p_holm"), ".2g") | dict.fromkeys(("value", "hedges_g"), ".2f")
    return Table(
        "paper_tests_all",
        "Every test, as numbers",
        tests,
        {**formats, "difference": "+.2f", "effect_size": ".2f", "subjects": ","},
        caption="Difference: of means, in attempts; of trials the first less the last, of the "
        "interaction what training with the structure of the test saves, the mean over both. "
        "p holm: corrected within the family. Paper: what it prints of people.",
    )


def _finding(test: PaperTest, rows: pd.DataFrame) -> str:
    """What came of a test in people and in learners, as a sentence."""
    if rows.empty:
        return ""
    defined = rows[rows["note"] == ""]
    significant = defined["p_holm"] < ALPHA
    with_sign = (defined["difference"] > 0) | (not test.directed)
    shown = list(defined.loc[significant & with_sign, "learner"])
    opposite = list(defined.loc[significant & ~with_sign, "learner"])
    none = list(defined.loc[~significant, "learner"])
    undefined = list(rows.loc[rows["note"] != "", "learner"])
    people = printed_tests().set_index(["family", "test"]).loc[(test.family, test.name)]
    printed = _statistic(people["paper"])
    if people["p"] < ALPHA:
        parts = [f"People {test.claim}, {printed}"]
        parts += [f"so {_do(shown)} {_all(shown, rows)}"] if shown else []
        nothing = "no such effect is found in"
    else:
        parts = [f"It is not shown that people {test.claim}, {printed}"]
        parts += [f"it is shown of {_all(shown, rows)}"] if shown else []
        nothing = "nor is it found in"
    parts += [f"the opposite is found in {joined(opposite)}"] if opposite else []
    parts += [f"the test is not defined for {joined(undefined)}"] if undefined else []
    if len(none) == len(rows):
        parts += [f"{nothing} {'any learner' if len(none) > 2 else ' or '.join(none)}"]
    elif none:
        parts += [f"no such effect is found in {joined(none) if len(none) < 5 else 'the others'}"]
    return "; ".join(parts) + "."


def _split(rows: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The rows of learners for whom no test among them is defined, and those of the others."""
    silent = (rows["note"] != "").groupby(rows["learner"]).transform("all").astype(bool)
    return rows[silent], rows[~silent]


def _on_silent(rows: pd.DataFrame) -> str:
    """Who has no test at all, and why."""
    why: dict[str, list[str]] = {}
    for name, notes in rows.groupby("learner", sort=False)["note"]:
        reasons = list(dict.fromkeys(notes.str.removeprefix("not defined: ")))
        alike = all(reason.startswith("every subject needed") for reason in reasons)
        several = "subjects do not differ" if alike else "for reasons given in the tables"
        why.setdefault(reasons[0] if len(reasons) == 1 else several, []).append(str(name))
    return joined([f"{joined(names)} ({reason})" for reason, names in why.items()])


def _statistic(paper: str) -> str:
    """``t(78)=2.00,p<.05`` as ``t(78) = 2.00``."""
    return paper.split(",p")[0].replace("=", " = ").replace(",", ", ")


def _on_holm() -> str:
    people = printed_tests()
    lost = people[(people["p"] < ALPHA) & (people["p_holm"] >= ALPHA)]
    if lost.empty:
        return ""
    names = [
        f"{FAMILIES[row['family']].lower()}, {row['test']}, {_statistic(row['paper'])}"
        for _, row in lost.iterrows()
    ]
    return (
        f"Corrected in the same way, one effect of the paper is no longer below {ALPHA:g}: "
        if len(names) == 1
        else f"Corrected in the same way, effects of the paper no longer below {ALPHA:g} are: "
    ) + f"{joined(names)}. Learners are held to the stricter rule."


def _on_power(subjects: int) -> str:
    table, played = power_table(subjects), counted(subjects, "subject")
    weak = table[table["power_here"] < POWER]
    if weak.empty:
        return (
            f"With {played} in each condition effects as large as people's would be "
            f"found with a probability of {POWER:g} or more, in every test of two groups."
        )
    return (
        f"With {played} in each condition, {len(weak)} of the {len(table)} effects "
        f"below would be found with a probability of less than {POWER:g} if they were as large as "
        "in people."
    )


def _power_table(subjects: int) -> Table:
    table = power_table(subjects).rename(
        columns={
            "effect_size": "size in people",
            "power_here": f"power with n = {subjects}",
            "power_of_paper": f"power of the paper, n = {_SUBJECTS_OF_PEOPLE}",
            "subjects_needed": f"n for a power of {POWER:g}",
        }
    )
    if subjects == _SUBJECTS_OF_PEOPLE:
        table = table.drop(columns=f"power of the paper, n = {_SUBJECTS_OF_PEOPLE}")
    formats = dict.fromkeys([name for name in table if name.startswith("power ")], ".2f")
    return Table(
        "paper_tests_power",
        "Power to find what people show",
        table,
        {**formats, "size in people": ".2f", f"n for a power of {POWER:g}": ",.0f"},
        caption="Probability that a test finds an effect which is as large as the one measured in "
        f"people (p below {ALPHA:g}, not corrected), by how many subjects are in each condition, "
        "and how many it takes. The true effect in people may be smaller than the measured one.",
    )  # fmt: skip


def _all(names: Sequence[str], rows: pd.DataFrame) -> str:
    """Names, or that it is all of more than a few."""
    return f"all {len(names)} learners" if len(names) == len(rows) > 2 else joined(names)


def _do(names: Sequence[str]) -> str:
    return "do" if len(names) > 1 else "does"
