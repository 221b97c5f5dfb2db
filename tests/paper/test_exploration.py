"""How fast attempts and exploration shrink: fits of known curves, epsilon's course, the section."""

import math

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.analysis.results.references import references_beside
from causal_openlock.paper.exploration import (
    PAPER_MEAN,
    PAPER_MEDIAN,
    TOPIC,
    exponential_fit,
    fitted,
    log_linear_fit,
    offset_fit,
    people_over_trials,
    schedules,
    steps_until,
)
from support.fabricated_courses import around, course, described
from support.made_up_experiments import material_of
from support.topics import section_on


@settings(max_examples=30, deadline=None)
@given(st.floats(1, 100), st.floats(0.1, 0.95), st.floats(0, 20), st.integers(5, 12))
def test_exact_curves_are_recovered(scale, decay, offset, n):
    falling = scale * decay ** np.arange(n)
    for fit in (exponential_fit, log_linear_fit):
        found = fit(falling)
        assert (found.scale, found.decay) == pytest.approx((scale, decay), rel=1e-5)
        assert found.error == pytest.approx(0, abs=1e-5 * scale)
    found = offset_fit(falling + offset)
    assert found.error < 1e-4 * scale
    if 0.2 < decay < 0.8:
        assert found.decay == pytest.approx(decay, abs=1e-3)
        assert found.offset == pytest.approx(offset, abs=0.01 * scale + 1e-6)


def test_people_in_training_decay_near_the_papers_rate_by_one_form_alone():
    curves = people_over_trials()
    assert curves["CC4 baseline"] == [19.375, 12.825, 8.525, 7.225, 6.45]
    found = fitted(curves)
    both = found[found["curve"] == "CC3 and CE3 training"].set_index("form")
    decays = {"exponential": 0.70, "log-linear": 0.76, "with offset": 0.50}
    assert both["decay"].round(2).to_dict() == decays
    assert both.index[both["near"]].tolist() == ["log-linear"]
    assert found["trials"].tolist() == [6] * 9 + [5] * 6


def test_the_section_tells_fast_exploration_from_a_usual_decay(tmp_path):
    experiment = described(
        tmp_path,
        "conditions: [CC4, CE4]\nlearners:\n  - {learner: ddqn, name: usual}\n"
        "  - {learner: ddqn, name: fast, parameters: {epsilon_decay: 0.743}}\n",
    )
    own = schedules(experiment).set_index("learner")
    assert own["steps"].to_dict() == {"usual": 919, "fast": 16}
    assert [steps_until(decay) for decay in (PAPER_MEAN, PAPER_MEDIAN)] == [16, 8]
    # .743 ** k adds up to 3.86 down to .01, which the rest of 900 actions then keep.
    geometric = math.fsum(0.743**k for k in range(16)) + 884 * 0.01
    assert own.loc["fast", "first_trial"] == pytest.approx(geometric)
    record = pa.concat_tables(
        course(
            around([share] * 5, spread=0.02 if share else 0),
            learner=learner,
            condition=condition,
            schema=condition,
        )
        for condition, learner, share in (
            ("CC4", "usual", 0.6),
            ("CC4", "fast", 0.0),
            ("CE4", "usual", 0.6),
            ("CE4", "fast", 0.1),  # learns, and less than half as well
        )
    )
    references = references_beside(experiment)
    found = section_on(TOPIC, material_of(record, experiment, references=references))
    table = found.tables[0].frame
    assert table["learner"].tolist() == ["usual"] * 2 + ["fast"] * 2
    assert table["verdict"].tolist() == ["learns", "learns", "does not learn", "learns"]
    alike = described(tmp_path, "conditions: [CC4]\nlearners: [{learner: ddqn, name: a}, random]\n")
    assert section_on(TOPIC, material_of(course(around([0.5] * 5)), alike)) is None
