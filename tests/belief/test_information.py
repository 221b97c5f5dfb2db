"""Bits that actions told, from traces of trials."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from causal_openlock.analysis.results.information import information_per_action, mean_information
from causal_openlock.belief.trace import Trace, trace_trial
from causal_openlock.contract.registry import create
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.schemas.finding import find_schema


@pytest.fixture(scope="module")
def traces() -> list[Trace]:
    condition = Condition.named("CC4", find_schema)
    return [
        trace_trial(
            create("openlock_learners.bayes:Bayes"), condition, PROTOCOLS["human"],
            trial=1, subject=subject, seed=1, label="bayes",
        )
        for subject in (0, 1)
    ]  # fmt: skip


def test_information_of_a_trial_sums_to_what_it_cleared_up(traces: list[Trace]) -> None:
    actions = information_per_action(traces)
    assert len(actions) == sum(len(trace.actions) for trace in traces)
    for trace in traces:
        own = actions[actions["subject"] == trace.subject]
        told = trace.entropies[0] - trace.entropies[-1]
        assert own["obtained"].sum() == pytest.approx(told)
        assert own["entropy_before"].tolist() == pytest.approx(trace.entropies[:-1].tolist())
        assert own["predicted"].tolist() == trace.table()["gain_predicted"].tolist()


def test_what_hypotheses_drawn_anew_tell_is_not_information(traces: list[Trace]) -> None:
    first, *rest = traces[0].actions
    renewed = replace(traces[0], actions=(replace(first, renewed="sampled"), *rest))
    actions = information_per_action([renewed])
    assert np.isnan(actions["obtained"][0])
    assert actions["obtained"][1:].notna().all()


def test_every_subject_counts_once(traces: list[Trace]) -> None:
    actions = information_per_action(traces)
    means = mean_information(actions, ["learner"])
    by_hand = [trace.table()["gain_obtained"].mean() for trace in traces]
    assert means["subjects"].tolist() == [2]
    assert means["actions"].tolist() == [len(actions)]
    assert means["obtained"].tolist() == pytest.approx([np.mean(by_hand)])
    by_attempt = mean_information(actions)
    assert by_attempt["attempt"].min() == 1
    assert by_attempt["actions"].sum() == len(actions)


def test_no_traces_have_no_information() -> None:
    assert mean_information(information_per_action([])).empty
