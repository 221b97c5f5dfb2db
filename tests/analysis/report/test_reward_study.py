"""The reward study's sentences and table, on records whose truth is known."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pytest

from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topics.reward_study import TOPIC, reward_terms, rewards_of
from causal_openlock.storage.stored import StoredExperiment
from support.fabricated_courses import around, course, described
from support.made_up_experiments import material_of
from support.topics import section_on

LEARNERS = (
    "conditions: [CC4, CE4]\n"
    "learners:\n"
    "  - random\n"
    "  - {learner: ddqn, name: basic, reward: basic}\n"
    "  - {learner: ddqn, name: unique, reward: unique_solutions}\n"
    "  - {learner: ddqn, name: unique18, reward: authors_2018_change_state_unique_solutions}\n"
    "  - {learner: ddqn, name: best, reward: paper}\n"
)


def made(experiment: StoredExperiment, shares: dict[str, tuple[float, float]]) -> Section | None:
    record = pa.concat_tables(
        [
            course(
                around([share] * 5, spread=0.02 if share else 0),
                learner=learner,
                condition=condition,
                schema=condition,
            )
            for learner, both in shares.items()
            for condition, share in zip(("CC4", "CE4"), both, strict=True)
        ]
    )
    return section_on(TOPIC, material_of(record, experiment))


def test_terms_of_sums_and_of_ladders(tmp_path: Path) -> None:
    rewards = rewards_of(described(tmp_path, LEARNERS))
    assert {name: sorted(reward_terms(one)) for name, one in rewards.items()} == {
        "basic": [],
        "unique": ["unique_solutions"],
        "unique18": ["state_change", "unique_solutions"],
        "best": ["negative_immovable", "partial_sequence", "solution_multiplier"],
    }


def test_what_the_paper_says_is_recognised(tmp_path: Path) -> None:
    found = made(
        described(tmp_path, LEARNERS),
        {
            "random": (0.0, 0.0),
            "basic": (0.3, 0.0),
            "unique": (0.0, 0.0),
            "unique18": (0.0, 0.0),
            "best": (0.6, 0.6),
        },
    )
    assert found is not None
    unique, best, _ = found.text
    assert "Here: the same, in every condition. Does not learn: unique (CC4, CE4); u" in unique
    assert "best in CC4 opens the door in " in best
    assert best.count("none of the others more often") == 2
    (told,) = found.tables
    assert told.frame["learner"].tolist() == ["best", "basic", "unique", "unique18"]
    assert told.frame["door CC4"].tolist()[:2] == ["learns"] * 2
    assert told.frame["door CE4"].tolist()[:2] == ["learns", "does not learn"]
    assert told.frame.loc[0, "door"] == pytest.approx(0.6, abs=0.03)
    assert told.frame.loc[2, "terms"] == "unique_solutions"
    for column, how in told.formats.items():
        assert all(format(value, how) for value in told.frame[column])


def test_the_contrary_is_recognised(tmp_path: Path) -> None:
    shares = {
        "basic": (0.5, 0.31),
        "unique": (0.8, 0.8),
        "unique18": (0.5, 0.5),
        "best": (0.3, 0.3),
    }
    found = made(described(tmp_path, LEARNERS), shares)
    assert found is not None
    unique, best, _ = found.text
    assert "Here: otherwise, in every condition the door comes to be opened. Learns:" in unique
    assert best.count("surely less often than") == 2
    assert "basic (5" in best.split("best in CE4")[0]
    assert "basic" not in best.split("best in CE4")[1]  # .31 is not surely more than .3
    assert found.tables[0].frame.loc[0, "learner"] == "unique"


def test_part_of_the_conditions_is_a_part(tmp_path: Path) -> None:
    found = made(described(tmp_path, LEARNERS), {"unique": (0.5, 0.0), "unique18": (0.0, 0.0)})
    assert found is not None
    assert "Here: otherwise in part. Learns: unique (CC4). Does not learn: " in found.text[0]
    assert len(found.text) == 2  # nobody got the paper's best


def test_two_rewards_are_no_study(tmp_path: Path) -> None:
    text = (
        "conditions: [CC4]\nlearners: [{learner: random, reward: [basic]}, {learner: ddqn,"
        " name: basic, reward: basic}, {learner: ddqn, name: best, reward: paper}]\n"
    )
    assert made(described(tmp_path, text), {"basic": (0.5, 0.5), "best": (0.5, 0.5)}) is None
