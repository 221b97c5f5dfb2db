"""What training was worth, in people and in learners."""

from __future__ import annotations

from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, ordered
from causal_openlock.analysis.plots.comparisons import (
    CONGRUENCY_TESTS,
    draw_congruency,
    draw_savings,
)
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Material, Section, SectionPlot, SectionTable
from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL, paper_conditions
from causal_openlock.analysis.results.people.published import did_what_people_did, model, people
from causal_openlock.analysis.results.scores import (
    CONGRUENCY,
    SAVINGS,
    published_transfer_scores,
    transfer_scores,
)
from causal_openlock.wording import file_names

PEOPLE, MODEL = "People", "Published model"
_PROSE = Prose("transfer")


def section(material: Material) -> Section | None:
    """What training was worth; None if no transfer condition and its counterpart were played."""
    found = scores_of(material)
    findings: list[dict[str, Any]] = []
    tables: list[SectionTable] = []
    plots: list[SectionPlot] = []
    for protocol, part in file_names(found).items():
        scores = found[protocol]
        of = {kind: scores[scores["score"] == kind] for kind in (CONGRUENCY, SAVINGS)}
        about: dict[str, Any] = {"protocol": protocol if len(found) > 1 else ""}
        for kind, found_in, frame, drawn in (
            (CONGRUENCY, _helped, _congruency, draw_congruency),
            (SAVINGS, _saved, _savings, draw_savings),
        ):
            rows = of[kind]
            if rows["learner"].isin([PEOPLE, MODEL]).all():
                continue
            findings.append({**about, "kind": kind, **found_in(rows)})
            name = f"transfer_{kind}_{part}"
            published = bool((rows["learner"] == PEOPLE).any())
            tables.append(_PROSE.table(f"transfer_{kind}", frame(rows), _FORMATS, name, **about))
            plots.append(_PROSE.plot(drawn(rows), name, published=published, **about))
        every = scores.drop(columns="protocol")
        tables.append(
            _PROSE.table("transfer_scores", every, _FORMATS, f"transfer_scores_{part}", **about)
        )
    if not findings:
        return None
    return _PROSE.section("transfer_scores", tables, plots, findings=findings)


_FORMATS = {
    **dict.fromkeys(("attempts", "against", "value", "ci_low", "ci_high"), ".2f"),
    **{f"{tested}{end}": "+.2f" for tested in BASELINES for end in ("", " low", " high")},
    **dict.fromkeys((f"{tested} untrained" for tested in BASELINES), ".2f"),
    **dict.fromkeys(TRANSFERS, ".1%"),
}


def scores_of(material: Material) -> dict[str, pd.DataFrame]:
    """The scores that are shown, by protocol.

    Returns:
        Tables as :func:`~causal_openlock.analysis.results.scores.transfer_scores` has them,
        learners in the order of the material; published results come first where learners did what
        people did.
    """
    trials = material.trials
    rooms = paper_conditions(material.experiment)
    if rooms is not None:
        trials = trials[trials["condition"].isin(list(rooms))]
    own = transfer_scores(trials)
    place = {name: number for number, name in enumerate(material.learners)}
    own = own.iloc[own["learner"].map(place).argsort(kind="stable")]
    found = {
        protocol: own[own["protocol"] == protocol]
        for protocol in ordered(own["protocol"], (HUMAN_PROTOCOL,))
    }
    beside = did_what_people_did(trials, material.pairs) & trials["condition"].isin(TRANSFERS)
    if beside.any() and HUMAN_PROTOCOL in found:
        published = [
            published_transfer_scores(PEOPLE, people()),
            published_transfer_scores(MODEL, model()),
        ]
        found[HUMAN_PROTOCOL] = pd.concat([*published, found[HUMAN_PROTOCOL]], ignore_index=True)
    return found


def _helped(scores: pd.DataFrame) -> dict[str, Any]:
    """By structure that is tested, what it saved people, and which learners it helps or harms."""
    own = scores[~scores["learner"].isin([PEOPLE, MODEL])]
    published = scores[scores["learner"] == PEOPLE].set_index("condition")["value"]
    tests = []
    for condition in CONGRUENCY_TESTS:
        rows = own[own["condition"] == condition]
        tests.append(
            {
                "tested": condition.split("-")[1],
                "played": len(rows),
                "helped": rows[rows["ci_high"] < 0].to_dict("records"),
                "harmed": rows[rows["ci_low"] > 0].to_dict("records"),
                "people": published.get(condition),
            }
        )
    return {"tests": tests}


def _saved(scores: pd.DataFrame) -> dict[str, Any]:
    """By learner, the least and the most that training saves."""
    values = (scores["value"] + 0.0).groupby(scores["learner"], sort=False, observed=True)
    return {"saved": values.agg(["min", "max"]).itertuples()}


def _congruency(scores: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for name in dict.fromkeys(scores["learner"]):
        own = scores[scores["learner"] == name].set_index("condition").reindex(CONGRUENCY_TESTS)
        row: dict[str, Any] = {"learner": name}
        for condition in CONGRUENCY_TESTS:
            for column, end in (("value", ""), ("ci_low", " low"), ("ci_high", " high")):
                row[f"{condition.split('-')[1]}{end}"] = own[column][condition]
        rows.append(row)
    return pd.DataFrame(rows)


def _savings(scores: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for name in dict.fromkeys(scores["learner"]):
        own = scores[scores["learner"] == name].set_index("condition").reindex(TRANSFERS)
        row: dict[str, Any] = {"learner": name}
        for tested in BASELINES:
            against = own.loc[[one for one in TRANSFERS if one.endswith(tested)], "against"]
            row[f"{tested} untrained"] = against.dropna().iloc[0] if against.notna().any() else None
        rows.append(row | own["value"].to_dict())
    return pd.DataFrame(rows)
