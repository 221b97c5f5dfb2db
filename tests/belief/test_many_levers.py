"""Rooms of many levers: what is looked at is counted and bounded, and said before it is done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from causal_openlock import Condition, Session
from causal_openlock.belief import sampling
from causal_openlock.belief.catalogue import TABLE_BYTES, catalogue, distance, fits
from causal_openlock.belief.hypotheses import RoomSight
from causal_openlock.belief.sampling import Sampler, metropolis, sampled
from causal_openlock.belief.structures import Structures, behaviour_bytes
from causal_openlock.cli import main
from causal_openlock.contract.expected_cost import Cost, expected_cost
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.running.expected_cost import cost_warnings
from causal_openlock.schemas.schema import Schema
from openlock_learners.bayes import Bayes, BayesParameters

pytestmark = pytest.mark.slow

SIMPLICITY = float(np.log(2.0))
SIGHT = RoomSight(positions=12, grey=12, solutions=8, action_limit=3)


def pairs(levers: int, roots: int) -> Schema:
    """Each root enables some of the other levers, and each of these unlocks the door."""
    names = [f"L{index}" for index in range(levers)]
    edges: dict[str, list[str]] = {name: ["door"] for name in names[roots:]}
    for index, leaf in enumerate(names[roots:]):
        edges.setdefault(names[index % roots], []).append(leaf)
    return Schema(f"pairs{levers}", names, edges)


TWELVE = pairs(12, 4)
assert len(TWELVE.solutions) == 8


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How many structures each look was at."""
    counts: list[int] = []

    def counted(structures: Structures, *promise: int) -> Any:
        counts.append(len(structures))
        return distance(structures, *promise)

    monkeypatch.setattr(sampling, "distance", counted)
    return counts


def by_definition(structures: Structures) -> list[set[int]]:
    """The solutions, set by set: every set of levers is tried, the small ones first."""
    n = structures.levers
    found: list[set[int]] = [set() for _ in range(len(structures))]
    for pushed in sorted(range(1 << n), key=int.bit_count):
        holds = structures.holds(pushed)
        bits = [lever for lever in range(n) if pushed >> lever & 1]
        for index in np.flatnonzero(holds[:, [*bits, n]].all(axis=1)).tolist():
            if not any(smaller & pushed == smaller for smaller in found[index]):
                found[index].add(pushed)
    return found


@pytest.mark.parametrize("levers", [1, 3, 5, 6, 7, 9, 12])
def test_solutions_of_many_levers_are_what_trying_every_set_finds(levers: int) -> None:
    generator = np.random.default_rng(levers)
    structures = Sampler(levers, SIMPLICITY, 1.0).draw(25, generator)[0]
    plain = by_definition(structures)
    found = structures.solutions()
    assert [set(np.flatnonzero(row).tolist()) for row in found] == plain
    for solutions, limit in ((1, 3), (2, 4), (3, 20)):
        assert fits(structures, solutions, limit).tolist() == [
            len(own) == solutions and all(one.bit_count() < limit for one in own) for own in plain
        ]


@pytest.mark.parametrize("effort", [500, 4000])
def test_no_more_structures_are_looked_at_than_the_effort_says(
    looked_at: list[int], effort: int
) -> None:
    sampler = Sampler(12, SIMPLICITY, 1.0)
    own = sampled(sampler, SIGHT, 500, np.random.default_rng(0), effort)
    assert effort / 4 <= sum(looked_at) <= effort
    assert fits(own.members, SIGHT.solutions, SIGHT.action_limit).all()


def test_steps_find_more_than_as_many_draws() -> None:
    sampler, effort = Sampler(12, SIMPLICITY, 1.0), 8000
    drawn = stepped = 0
    for seed in range(3):
        generator = np.random.default_rng(seed)
        drawn += int(fits(sampler.draw(effort, generator)[0], 8, 3).sum())
        stepped += len(sampled(sampler, SIGHT, 500, generator, effort))
    assert stepped > 2 * drawn


def shares(structures: Structures, n: int) -> Any:
    """How often each arrow is there, and how often each lever is free."""
    arrows = structures.causes[:, :, None] >> np.arange(n) & 1
    return np.concatenate([arrows.mean(axis=0).ravel(), (structures.causes == 0).mean(axis=0)])


def test_what_steps_reach_is_as_probable_as_what_is_drawn() -> None:
    """From draws far from the promise, long runs come to what rejection would have kept."""
    n, promise, generator = 5, (2, 3), np.random.default_rng(3)
    sampler = Sampler(n, SIMPLICITY, 1.0, [((0, 0, True, False), 1)])
    drawn, order = sampler.draw(60_000, generator)
    kept = distance(drawn, *promise) == 0
    away = np.flatnonzero(~kept)[:1500]
    reached = metropolis(sampler, drawn[away], order[away], promise, 300, generator)
    assert len(reached) > 1000
    assert (distance(reached, *promise) == 0).all()
    assert np.abs(shares(reached, n) - shares(drawn[kept], n)).max() < 0.05


def test_a_room_of_twelve_levers_is_played_to_its_end_with_counted_work(
    looked_at: list[int],
) -> None:
    effort = 1000
    small = BayesParameters(effort=effort, particles=50, hypothesis_limit=500)
    condition = Condition.named("pairs12", {"pairs12": TWELVE}.__getitem__)
    protocol = replace(PROTOCOLS["human"], baseline_trials=1, attempt_limit=4)

    def play() -> list[list[Any]]:
        session = Session(condition, protocol, 1, seed=3)
        table = session.play(Bayes(small))
        return [table[name].to_pylist() for name in ("actions", "new_solution")]

    first = play()
    work = sum(looked_at)
    # An attempt has three actions, and each may make the learner think again at most four times.
    assert 0 < work <= (1 + 4 * 3 * 4) * effort
    assert (play(), sum(looked_at)) == (first, 2 * work)


def test_few_structures_are_listed_where_attempts_are_long() -> None:
    listed = catalogue(10, 1, 11, False, SIMPLICITY, 20_000)
    most = TABLE_BYTES // behaviour_bytes(10, 11)
    assert 0 < len(listed.members) <= most < 20_000
    assert TABLE_BYTES // behaviour_bytes(7, 8) > 20_000  # never in rooms of seven


# -- what is said beforehand ----------------------------------------------------------------------


def cost(learner: str, schema: Schema, **parameters: object) -> Cost | None:
    return expected_cost(learner, dict(parameters), schema, schema.least_action_limit)


def test_costs_grow_with_the_counted_work() -> None:
    eight, twelve = cost("bayes", pairs(8, 3)), cost("bayes", TWELVE)
    assert eight is not None
    assert twelve is not None
    assert eight.seconds < twelve.seconds
    doubled = cost("bayes", TWELVE, effort=2 * BayesParameters().effort)
    assert doubled is not None
    assert doubled.seconds == pytest.approx(2 * twelve.seconds)
    assert "an estimate: about 20 times 8,000 structures of 12 levers" in str(twelve)
    assert cost("bayes", pairs(4, 1)) is None
    assert cost("random", TWELVE) is None


def test_it_is_said_that_the_ideal_observer_cannot_list_what_it_would_have_to() -> None:
    said = cost("ideal", TWELVE)
    assert said is not None
    assert str(said).startswith("cannot play it: its levers can be placed in 29,937,600 ways")
    assert cost("ideal", pairs(4, 1)) is None


def test_compare_says_what_will_be_dear(tmp_path: Any) -> None:
    (tmp_path / "pairs12.yaml").write_text(TWELVE.to_yaml(), encoding="utf-8")
    file = tmp_path / "mine.yaml"
    file.write_text(
        "name: mine\nseed: 1\nsubjects: 1\nprotocol: human\n"
        "conditions: [pairs12.yaml, CC3]\nlearners: [bayes, random]\n",
        encoding="utf-8",
    )
    (caution,) = cost_warnings(read_experiment(file))
    assert caution.startswith("in pairs12, bayes takes about 4 s a trial and subject on one core (")


def test_schema_check_says_what_learners_will_cost(
    tmp_path: Any, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "pairs12.yaml"
    path.write_text(TWELVE.to_yaml(), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["causal-openlock", "schema", "check", str(path), "CC4"])
    run: Callable[[], None] = main
    with pytest.raises(SystemExit) as ended:
        run()
    assert not ended.value.code
    said = capsys.readouterr().out
    assert said.count("the learner bayes takes about 4 s") == 1
    assert said.count("the learner ideal cannot play it") == 1
