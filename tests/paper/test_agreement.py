"""Learners next to the paper's counts: shares and intervals of records that are made up."""

import numpy as np
import pyarrow as pa
import pytest
from scipy import stats

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, attempts_to_solve
from causal_openlock.analysis.topics.learning import FINDS_ALL, OPENS, shares
from causal_openlock.paper.agreement import TOPIC, beside_paper, published_shares, share_text
from causal_openlock.world import facts
from support.fabricated_courses import around, course, described
from support.made_up_experiments import material_of
from support.topics import section_on

CASES = {"CC3-CC4": 0.284, "CE3-CC4": 0.301, "CC3-CE4": 0.166, "CE3-CE4": 0.430}
ALL_SIX = "conditions: [CC4, CE4, CC3-CC4, CE3-CC4, CC3-CE4, CE3-CE4]\n"
BOTH = "learners: [random, {learner: ddqn, name: a}]\n"


def played(means, subjects=10, **names):
    """A test phase of five visits in each transfer case, subjects around these means."""
    own = {"phase": "test", "attempts": 100, **names}
    return pa.concat_tables(
        course(around([mean] * 5, subjects, seed=k), condition=case, schema=case[-3:], **own)
        for k, (case, mean) in enumerate(means.items())
    )


def baseline(condition, other, loops=1, **names):
    """Ten subjects in five visits a loop, ``else`` as told in each fifth, half of the rest open."""
    rest = around(np.repeat(1 - np.array(other), loops), spread=0.01)
    opens = np.rint(rest * 50) / 100
    own = {"condition": condition, "schema": condition, "attempts": 100, **names}
    return course(opens, other=np.clip((1 - rest) / (1 - opens), 0, 1), **own)


def test_the_papers_shares_are_those_of_its_counts():
    counts = facts.results()["cogsci2018"]["ddqn"]["transfer_counts"]
    known = published_shares()
    for case, share in CASES.items():
        own = known.loc[case, "test"].iloc[0]
        assert own[OPENS] == pytest.approx(share, abs=5e-4)
        assert own["else"] == pytest.approx(counts[case]["else"] / 18000)
    assert own[FINDS_ALL] == pytest.approx(32 / 60)
    first, *_, last = known.loc["CE4", "train"].to_dict("records")
    assert (first["else"], last["else"]) == pytest.approx((0.187, 0.971), abs=1e-3)
    assert first[FINDS_ALL] == pytest.approx(0.72, abs=1e-3)


def test_the_second_interval_covers_one_more_subject_as_often_as_it_says():
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(1000):
        *subjects, one_more = rng.normal(0.5, 0.08, 11)
        bounds = share_text(np.array(subjects)).split("\n")[2].split()
        low, high = (float(word.rstrip("%")) / 100 for word in (bounds[2], bounds[4]))
        held += low <= one_more <= high
    assert stats.binomtest(held, 1000, 0.95).pvalue > 0.01


def test_few_subjects_and_subjects_that_are_alike_have_no_interval():
    assert share_text(np.array([0.1, 0.2, 0.3, 0.4])) == "25.0%"
    assert share_text(np.zeros(10)) == "0.0%"
    assert share_text(np.array([0.0, 0.0, 0.1, 0.3, 0.5])).endswith("one subject 0% to 84%")


@pytest.mark.parametrize("loops", [1, 3])
def test_five_blocks_stand_below_the_papers_whatever_the_length(loops):
    other = [0.19, 0.39, 0.91, 0.97, 0.97]
    parts = shares(attempts_to_solve(baseline("CE4", other, loops)))
    rows = beside_paper(parts, "train", BASELINES)
    assert rows["condition"].unique().tolist() == ["CE4"]  # nobody played CC4
    rows = rows[rows["measure"] == "else"].set_index("learner")
    blocks = [f"block {block}" for block in range(1, 6)]
    means = [float(text.split("%")[0]) / 100 for text in rows.loc["a", blocks]]
    assert means == pytest.approx(other, abs=0.02)
    assert rows.loc["paper", blocks].tolist() == ["18.7%", "38.8%", "91.4%", "97.3%", "97.1%"]
    assert rows["attempts"].to_dict() == {"paper": 150_000, "a": 500 * loops}


def test_a_learner_with_fewer_blocks_than_the_paper_is_not_shown():
    parts = shares(attempts_to_solve(baseline("CE4", [0.2, 0.4, 0.9, 0.97])))
    assert beside_paper(parts, "train", BASELINES).empty


def test_the_section_has_a_table_for_each_figure(tmp_path):
    record = pa.concat_tables(
        [
            played(CASES),
            baseline("CE4", [0.2, 0.4, 0.9, 0.97, 0.97]),
            played(CASES, learner="random"),
        ]
    )
    made = section_on(TOPIC, material_of(record, described(tmp_path, ALL_SIX + BOTH)))
    tables = {one.name: one.frame for one in made.tables}
    assert list(tables) == ["figure6", "figure7"]
    for frame in tables.values():
        assert frame["learner"].tolist() == ["paper", "a"] * 3  # nothing is said of random
    opens = tables["figure7"].set_index(["measure", "learner"])[[*TRANSFERS]].loc[OPENS]
    assert opens.loc["paper"].tolist() == ["28.4%", "30.1%", "16.6%", "43.0%"]
    assert [float(text.split("%")[0]) for text in opens.loc["a"]] == pytest.approx(
        [100 * share for share in CASES.values()], abs=3
    )


def test_baselines_under_another_protocol_have_no_section(tmp_path):
    text = "protocols: {brief: {based_on: rl, baseline_loops: 1}}\n" + ALL_SIX + BOTH
    text = text.replace("name: a", "name: a, protocol: brief")
    record = baseline("CC4", [0.43, 0.4, 0.6, 0.7, 0.77], protocol="brief")
    held = described(tmp_path, text)
    assert section_on(TOPIC, material_of(record, held)) is None
    both = pa.concat_tables([record, played(CASES, protocol="brief")])
    made = section_on(TOPIC, material_of(both, held))
    assert [one.name for one in made.tables] == ["figure6", "figure7"]
    assert "brief" in made.text[0]
    human = baseline("CC4", [0.43, 0.4, 0.6, 0.7, 0.77], protocol="human")
    assert section_on(TOPIC, material_of(human, described(tmp_path, ALL_SIX + BOTH))) is None
