"""A linear probe on memories: made ones, and that of rl2."""

from __future__ import annotations

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.analysis.results.probe import Probe, true_edges
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.schemas.fsm import compile_schema
from causal_openlock.world.room import Layout, Room

pytestmark = pytest.mark.slow


def rooms(names: list[str], number: int, seed: int) -> list[Room]:
    generator = np.random.default_rng(seed)
    found = []
    for index in range(number):
        schema = ol.find_schema(names[index % len(names)])
        places = generator.permutation(7)[: len(schema.levers)].tolist()
        found.append(Room(compile_schema(schema), Layout(tuple(places), 7)))
    return found


def test_what_a_memory_holds_linearly_is_read_in_other_rooms() -> None:
    """Memories say how often a lever is a cause and an effect; others say nothing."""
    generator = np.random.default_rng(1)

    def held(room: Room) -> tuple[np.ndarray, np.ndarray]:
        edges = true_edges(room)
        each = np.stack([edges[:, :7].any(axis=1), edges[:, :7].any(axis=0), edges[:, 7]], axis=1)
        return each @ np.array([[1.0, 2.0], [-1.0, 0.5], [0.3, -1.0]]), generator.normal(size=2)

    own, other = rooms(["CC4", "CE4"], 60, 2), rooms(["CC4", "CE4"], 20, 3)
    probe = Probe([held(room) for room in own], own)
    noise = [(generator.normal(size=(7, 2)), np.zeros(0)) for _ in own]
    blind = Probe(noise, own)
    right, guessed = [], []
    for room in other:
        edges = true_edges(room)
        right.append(((probe.structure(held(room)).edges > 0.5) == edges).all())
        said = blind.structure((generator.normal(size=(7, 2)), np.zeros(0))).edges
        guessed.append(((said > 0.5) == edges).all())
        assert np.isnan(probe.structure(held(room)).gates).all()
    assert all(right)
    assert not any(guessed)


def test_the_memory_of_rl2_is_read_beside_its_controls() -> None:
    table = ol.probe_structure("rl2", ["CC3", "CE3"], ["CC4", "CE4"], subjects=6)
    assert len(table) == 4 * 2 * 6 * 5
    shd = table.groupby("probe")["shd"].mean()
    assert shd["memory"] < 0.5 < shd["untrained"] < shd["rates"]
    assert set(table["schema"]) == {"CC4", "CE4"}
    again = ol.probe_structure("rl2", ["CC3", "CE3"], ["CC4", "CE4"], subjects=6)
    assert table.equals(again)


def test_a_memory_without_training_reads_as_well_where_the_documentation_says_so() -> None:
    def mistakes(*schemas: list[str]) -> dict[str, float]:
        table = ol.probe_structure("rl2", *schemas, subjects=10)
        return dict(table.groupby("probe")["shd"].mean())

    same = mistakes(["CC4", "CE4"])
    assert same["memory"] == same["untrained"] == 0
    fewer = mistakes(["CC4", "CE4"], ["CC3", "CE3"])
    assert abs(fewer["memory"] - fewer["untrained"]) < 0.25
    other = mistakes(["CC3"], ["CE3"])
    assert other["memory"] > other["rates"] - 0.25


def test_rooms_that_are_read_are_not_fitted_in() -> None:
    table = ol.probe_structure("rl2", ["CC3"], subjects=4)
    assert 0 < len(table) < 4 * 4 * 5
    with pytest.raises(LearnerError, match="random has no memory that can be probed"):
        ol.probe_structure("random", ["CC3"])
    with pytest.raises(OpenLockError, match="play more"):
        ol.probe_structure("rl2", [], ["CC3"], subjects=1)
