"""What training was worth, in people and in learners."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import BASELINES, TRANSFERS
from causal_openlock.analysis.plots.comparisons import (
    CONGRUENCY_TESTS,
    plot_congruency,
    plot_savings,
)
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionPlot, SectionTable
from causal_openlock.analysis.results.decisions import Decisions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.scores import (
    CONGRUENCY,
    MODEL,
    PEOPLE,
    SAVINGS,
    scores_of,
)
from causal_openlock.wording import file_names

_PROSE = Prose("transfer")


def compute(material: Material) -> dict[str, pd.DataFrame]:
    """The scores of transfer, by protocol."""
    return scores_of(material)


def tests(computed: Mapping[str, pd.DataFrame]) -> dict[Hashable, float]:
    """The p of every learner's congruency, by protocol, learner and condition."""
    return {
        (protocol, row.learner, row.condition): row.p
        for protocol, scores in computed.items()
        for row in scores.itertuples()
        if row.score == CONGRUENCY and row.learner not in (PEOPLE, MODEL)
    }


def section(material: Material, decisions: Decisions) -> Section | None:
    """What training was worth; None if no transfer condition and its counterpart were played."""
    found: dict[str, pd.DataFrame] = decisions.computed("transfer")
    findings: list[dict[str, Any]] = []
    tables: list[SectionTable] = []
    plots: list[SectionPlot] = []
    for protocol, part in file_names(found).items():
        scores = found[protocol]
        of = {kind: scores[scores["score"] == kind] for kind in (CONGRUENCY, SAVINGS)}
        about: dict[str, Any] = {"protocol": protocol if len(found) > 1 else ""}
        for kind, found_in, frame, plot in (
            (CONGRUENCY, partial(_helped, protocol, decisions), _congruency, plot_congruency),
            (SAVINGS, _saved, _savings, plot_savings),
        ):
            rows = of[kind]
            if rows["learner"].isin([PEOPLE, MODEL]).all():
                continue
            findings.append({**about, "kind": kind, **found_in(rows)})
            name = f"transfer_{kind}_{part}"
            published = bool((rows["learner"] == PEOPLE).any())
            tables.append(_PROSE.table(f"transfer_{kind}", frame(rows), _FORMATS, name, **about))
            options = {"protocol": protocol}
            drawn = _PROSE.plot(
                f"transfer_{kind}", plot, material, options, name, published=published, **about
            )
            plots.append(replace(drawn, folded=kind == SAVINGS))
        every = scores.drop(columns="protocol")
        tables.append(
            _PROSE.table("transfer_scores", every, _FORMATS, f"transfer_scores_{part}", **about)
        )
    if not findings:
        return None
    return _PROSE.section("transfer_scores", tables, plots, findings=findings)


_FORMATS = {
    **dict.fromkeys(("attempts", "against", "value", "ci_low", "ci_high"), ".2f"),
    "p": ".2g",
    **{f"{tested}{end}": "+.2f" for tested in BASELINES for end in ("", " low", " high")},
    **dict.fromkeys((f"{tested} untrained" for tested in BASELINES), ".2f"),
    **dict.fromkeys(TRANSFERS, ".1%"),
}


def _helped(protocol: str, decisions: Decisions, scores: pd.DataFrame) -> dict[str, Any]:
    """By structure that is tested, what it saved people, and which learners it helps or harms."""
    own = scores[~scores["learner"].isin([PEOPLE, MODEL])]
    published = scores[scores["learner"] == PEOPLE].set_index("condition")["value"]
    tests = []
    for condition in CONGRUENCY_TESTS:
        rows = own[own["condition"] == condition]
        found = [
            decisions.found("transfer", (protocol, learner, condition))
            for learner in rows["learner"]
        ]
        beyond = rows[np.array(found, bool)]
        tests.append(
            {
                "tested": condition.split("-")[1],
                "played": len(rows),
                "helped": beyond[beyond["value"] < 0].to_dict("records"),
                "harmed": beyond[beyond["value"] > 0].to_dict("records"),
                "people": published.get(condition),
            }
        )
    return {"tests": tests}


def _saved(scores: pd.DataFrame) -> dict[str, Any]:
    """By learner, the least and the most that training saves."""
    values = (scores["value"] + 0.0).groupby(scores["learner"], sort=False, observed=True)
    return {"saved": values.agg(["min", "max"]).itertuples()}


def _congruency(scores: pd.DataFrame) -> pd.DataFrame:
    ends = {"value": "", "ci_low": " low", "ci_high": " high"}
    wide = _wide(scores, list(CONGRUENCY_TESTS), list(ends))
    columns = {
        f"{condition.split('-')[1]}{end}": wide[column, condition]
        for condition in CONGRUENCY_TESTS
        for column, end in ends.items()
    }
    return pd.DataFrame(columns).reset_index()


def _savings(scores: pd.DataFrame) -> pd.DataFrame:
    wide = _wide(scores, TRANSFERS, ["against", "value"])
    untrained = {
        f"{tested} untrained": wide["against"].filter(like=f"-{tested}").bfill(axis=1).iloc[:, 0]
        for tested in BASELINES
    }
    return pd.DataFrame({**untrained, **wide["value"]}).reset_index()


def _wide(scores: pd.DataFrame, conditions: Sequence[str], values: list[str]) -> pd.DataFrame:
    """A row for each learner, in their order, with the values in each of the conditions."""
    wide = scores.pivot(index="learner", columns="condition", values=values)
    columns = pd.MultiIndex.from_product([values, conditions])
    return wide.reindex(index=list(dict.fromkeys(scores["learner"])), columns=columns)
