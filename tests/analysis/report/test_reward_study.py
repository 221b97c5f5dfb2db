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


def made(
    experiment: StoredExperiment,
    shares: dict[str, tuple[float, float]],
    finds_all: tuple[str, ...] = (),
) -> Section | None:
    record = pa.concat_tables(
        [
            course(
                around([share] * 5, spread=0.02 if share > 0.2 else 0),
                finds_all=learner in finds_all,
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
        finds_all=("best",),
    )
    assert found is not None
    visits, doors, best, _ = found.text
    for unique in (visits, doors):
        assert ": the same, in every condition. Does not learn: unique (CC4, CE4); u" in unique
    assert "best in CC4 finds every solution in 100.0% of the last part's visits, and" in best
    assert best.count("none of the others finds every solution more often") == 2
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
    found = made(described(tmp_path, LEARNERS), shares, finds_all=("unique", "unique18"))
    assert found is not None
    visits, doors, best, _ = found.text
    for unique in (visits, doors):
        assert ": otherwise, in every condition something is learned. " in unique
    assert best.count("Surely more often finds every solution unique (100.0%), unique18 (") == 2
    assert "basic" not in best  # it opens the door more often, which is not asked for
    assert found.tables[0].frame.loc[0, "learner"] == "unique"


def test_a_door_that_is_seldom_opened_in_visits_that_find_all_is_learning(tmp_path: Path) -> None:
    """Three in twenty attempts: what an agent optimal for unique solutions alone would do."""
    shares = {"unique": (0.15, 0.15), "best": (0.6, 0.6)}
    experiment = described(tmp_path, LEARNERS.replace("  - {learner: ddqn, name: unique18", "  #"))
    found = made(experiment, shares, finds_all=("unique",))
    assert found is not None
    assert ": otherwise, in every condition something is learned. " in found.text[0]
    assert "Surely more often finds every solution unique (100.0%)." in found.text[2]


def test_part_of_the_conditions_is_a_part(tmp_path: Path) -> None:
    found = made(described(tmp_path, LEARNERS), {"unique": (0.5, 0.0), "unique18": (0.0, 0.0)})
    assert found is not None
    assert ": the same, in every condition. " in found.text[0]
    assert ": otherwise in part. Learns: unique (CC4). Does not learn: " in found.text[1]
    assert len(found.text) == 3  # nobody got the paper's best


def test_two_rewards_are_no_study(tmp_path: Path) -> None:
    text = (
        "conditions: [CC4]\nlearners: [{learner: random, reward: [basic]}, {learner: ddqn,"
        " name: basic, reward: basic}, {learner: ddqn, name: best, reward: paper}]\n"
    )
    assert made(described(tmp_path, text), {"basic": (0.5, 0.5), "best": (0.5, 0.5)}) is None
