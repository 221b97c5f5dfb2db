"""Multiplicity: how many of all verdicts chance alone would bring about.

An end of a 95% interval lies wrongly beyond the margin in at most 2.5% of studies; of *the same*
within a margin, the 90% interval lies wrongly within it in at most 5%, and the 95% interval wrongly
outside, to one side or the other, in as many. Expected numbers add up, however contrasts depend on
each other:

- If no claim were true, each would have a contrast that is not, and would hold no more often than
  that one does.
- If all were true, a claim would be refuted no more often than its contrasts are together.

These are bounds for true differences right at their margins, and as good as the intervals are.
Nothing can be counted in this way for claims that were stated once results were known.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import get_args

from causal_openlock.analysis.table import markdown
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.study import Contrast
from causal_openlock.evidence.verdicts import EQUIVALENCE, LEVEL, Verdict


def chance(contrast: Contrast) -> float:
    """The probability with which a contrast holds, or is refuted, wrongly: at most this."""
    return (1 - (EQUIVALENCE if contrast.expected == "same" else LEVEL)) / 2


def multiplicity(studies: Iterable[Evidence]) -> str:
    """The Markdown of a table of all claims and contrasts: verdicts, and what chance explains.

    Verdicts of studies that are still being run are not counted.
    """
    stated = [(study, name) for study in studies for name in study.study.file.claims]
    measured = [(study, name) for study, name in stated if study.was_run and study.run["complete"]]
    late = [(study, name) for study, name in measured if study.late(name)]
    said = [study.verdict(name) for study, name in measured]
    by_contrast = [one for study, name in measured for one in study.verdicts_of(name)]
    rates = [
        [chance(one) for one in study.study.file.claims[name].contrasts.values()]
        for study, name in measured
    ]
    held, refuted = sum(map(max, rates)), sum(map(sum, rates))
    rows: list[list[object]] = [
        [what, len(chosen), sum(len(study.verdicts_of(name)) for study, name in chosen)]
        for what, chosen in (
            ("stated", stated),
            ("of studies that were run to their end", measured),
            ("of these stated or changed after the run", late),
        )
    ]
    rows += [[one, said.count(one), by_contrast.count(one)] for one in get_args(Verdict)]
    rows += [
        ["would hold by chance if none were true, at most", f"{held:.1f}", f"{refuted:.1f}"],
        ["would be refuted by chance if all were true, at most", *[f"{refuted:.1f}"] * 2],
    ]
    cells = [[str(cell) for cell in row] for row in rows]
    return f"{markdown(['', 'claims', 'contrasts'], cells)}\n"
