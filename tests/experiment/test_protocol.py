"""Conditions and protocols: which rooms a subject visits, in which order, how often."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causal_openlock.errors import FileError, OpenLockError, ProtocolError
from causal_openlock.experiment.building import Changes, learner, make_experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import (
    PAPER_CONDITIONS,
    PROTOCOLS,
    Condition,
    Protocol,
    Trials,
    Visit,
    find_protocol,
    plan,
)
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.graphs import write_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout

SCHEMAS = bundled_schemas()
HUMAN, RL = PROTOCOLS["human"], PROTOCOLS["rl"]
THREE = {f"trial{number}" for number in range(1, 7)}
FOUR = {f"trial{number}" for number in range(7, 12)}
ONE = Schema("one", ["A"], {"A": ["door"]})


@cache
def named(name: str) -> Condition:
    return Condition.named(name, find_schema)


def visits_of(condition: str | Condition, protocol: Protocol, subject: int = 0) -> list[Visit]:
    condition = named(condition) if isinstance(condition, str) else condition
    return plan(condition, protocol, np.random.default_rng(subject))


def loops_of(visits: list[Visit]) -> dict[tuple[str, int], list[Visit]]:
    """The visits of each loop of each phase, in order."""
    loops: dict[tuple[str, int], list[Visit]] = {}
    for visit in visits:
        loops.setdefault((visit.phase, visit.loop), []).append(visit)
    return loops


# -- the paper's protocols ------------------------------------------------------------------------


def test_people_have_30_attempts_and_stop_when_everything_is_found() -> None:
    assert (HUMAN.attempt_limit, HUMAN.stop_when_solved) == (30, True)
    for name in ("CC4", "CE4"):
        visits = visits_of(name, HUMAN)
        assert [visit.phase for visit in visits] == ["train"] * 5
        assert [visit.trial for visit in visits] == [1, 2, 3, 4, 5]
        assert {visit.loop for visit in visits} == {1}
    for name in PAPER_CONDITIONS[2:]:
        visits = visits_of(name, HUMAN)
        assert [visit.phase for visit in visits] == ["train"] * 6 + ["test"]
        assert [visit.trial for visit in visits] == [1, 2, 3, 4, 5, 6, 1]
        assert [visit.schema.name for visit in visits] == [name[:3]] * 6 + [name[4:]]


def test_the_protocol_of_2020_has_700_attempts_and_200_loops_over_the_rooms() -> None:
    protocol = PROTOCOLS["rl_2020"]
    assert (protocol.attempt_limit, protocol.stop_when_solved) == (700, True)
    assert len(visits_of("CC4", protocol)) == 200 * 5
    loops = loops_of(visits_of("CC3-CC4", protocol))
    assert {phase: len(visits) for (phase, _), visits in loops.items()} == {"train": 6, "test": 5}
    assert len(loops) == 400


def test_reinforcement_learners_have_300_attempts_in_every_trial_and_many_loops() -> None:
    assert (RL.attempt_limit, RL.stop_when_solved) == (300, False)
    loops = loops_of(visits_of("CE4", RL))
    assert list(loops) == [("train", loop) for loop in range(1, 11)]
    assert all(len(visits) == 5 for visits in loops.values())
    loops = loops_of(visits_of("CC3-CE4", RL))
    assert list(loops) == [
        *(("train", loop) for loop in range(1, 101)),
        *(("test", loop) for loop in range(1, 11)),
    ]
    for (phase, _), visits in loops.items():
        assert [visit.trial for visit in visits] == list(range(1, 7 if phase == "train" else 6))
        assert {visit.schema.name for visit in visits} == {"CC3" if phase == "train" else "CE4"}
    # 300 attempts in each: 15,000 of a baseline, 180,000 and 15,000 of a transfer.
    assert 300 * len(visits_of("CC4", RL)) == 15_000


@pytest.mark.parametrize("condition", PAPER_CONDITIONS)
def test_every_loop_uses_each_published_layout_at_most_once(condition: str) -> None:
    for visits in loops_of(visits_of(condition, RL)).values():
        names = [visit.layout.name for visit in visits]
        assert len(set(names)) == len(names)
        assert set(names) == (THREE if len(visits[0].schema.levers) == 3 else FOUR)


def test_the_transfer_trial_of_people_is_any_of_the_four_lever_rooms() -> None:
    tests = [visits_of("CE3-CC4", HUMAN, subject)[-1].layout.name for subject in range(60)]
    assert set(tests) == FOUR


def test_each_subject_and_each_loop_has_an_order_of_its_own() -> None:
    orders = {
        tuple(visit.layout.name for visit in visits_of("CC4", HUMAN, subject))
        for subject in range(30)
    }
    assert len(orders) > 15
    loops = loops_of(visits_of("CC4", RL)).values()
    assert len({tuple(visit.layout.name for visit in loop) for loop in loops}) > 5
    # Each layout is as likely to come first as any other.
    firsts = Counter(visits_of("CC4", HUMAN, subject)[0].layout.name for subject in range(500))
    assert all(70 < count < 130 for count in firsts.values())


def test_the_same_generator_gives_the_same_plan() -> None:
    assert visits_of("CC3-CC4", RL, 3) == visits_of("CC3-CC4", RL, 3)


def test_fewer_trials_than_layouts_draw_some_of_them() -> None:
    drawn = [visits_of("CC4", replace(HUMAN, baseline_trials=2), seed) for seed in range(30)]
    assert all(len({visit.layout.name for visit in visits}) == 2 for visits in drawn)
    assert {visit.layout.name for visits in drawn for visit in visits} == FOUR


def test_more_trials_than_published_layouts_use_each_once() -> None:
    visits = visits_of("CC4", replace(HUMAN, baseline_trials=9))
    assert Counter(visit.layout.name for visit in visits) == Counter(FOUR)


def test_loops_are_parameters() -> None:
    protocol = replace(RL, train_loops=2, test_loops=3, training_trials=4, test_trials=1)
    sizes = {key: len(visits) for key, visits in loops_of(visits_of("CC3-CC4", protocol)).items()}
    assert sizes == {
        ("train", 1): 4,
        ("train", 2): 4,
        ("test", 1): 1,
        ("test", 2): 1,
        ("test", 3): 1,
    }


# -- where layouts come from ----------------------------------------------------------------------


def test_a_layout_may_be_fixed_for_the_test_and_only_for_it() -> None:
    protocol = replace(HUMAN, test_layout="trial7")
    for subject in range(10):
        visits = visits_of("CC3-CE4", protocol, subject)
        assert {visit.layout.name for visit in visits[:6]} == THREE
        assert [visit.layout.name for visit in visits[6:]] == ["trial7"]
    tests = visits_of("CC3-CE4", replace(RL, test_layout="trial7"))[600:]
    assert [(visit.loop, visit.layout.name) for visit in tests] == [
        (loop, "trial7") for loop in range(1, 11)
    ]
    assert {visit.layout.name for visit in visits_of("CC4", protocol)} == FOUR


def test_random_layouts_differ_within_a_loop_and_leave_the_published_ones_behind() -> None:
    protocol = replace(HUMAN, layouts="random", baseline_trials=40, baseline_loops=3)
    visits = visits_of("CC4", protocol)
    assert len(visits) == 120
    for loop in loops_of(visits).values():
        assert len({visit.layout.places for visit in loop}) == len(loop) == 40
    assert len({visit.layout.places for visit in visits}) > 60
    assert visits[0].layout.name == " ".join(
        Layout(visits[0].layout.places).as_mapping(SCHEMAS["CC4"]).values()
    )


@pytest.mark.parametrize("schema", ["seven", "one"])
def test_a_schema_without_published_layouts_has_random_ones(schema: str) -> None:
    condition = Condition("own", (Trials(SCHEMAS.get(schema, ONE)),))
    visits = visits_of(condition, HUMAN)
    assert len({visit.layout.places for visit in visits}) == len(visits) == 5
    assert visits_of(condition, HUMAN, 1) != visits


def test_a_published_layout_fits_every_schema_with_as_many_levers() -> None:
    assert {visit.layout.name for visit in visits_of("two_keys-two_of_four", RL)} == THREE | FOUR


def test_all_layouts_of_a_schema_can_be_asked_for_and_not_one_more() -> None:
    condition = Condition("all", (Trials(ONE, "random", 7),))
    assert sorted(visit.layout.places for visit in visits_of(condition, HUMAN)) == [
        (place,) for place in range(7)
    ]
    with pytest.raises(ProtocolError, match="one has 7 layouts, too few for 8 trials"):
        visits_of(Condition("more", (Trials(ONE, "random", 8),)), HUMAN)


@pytest.mark.parametrize("source", [None, "published"])
def test_a_number_of_trials_that_is_declared_is_kept_or_refused(source: Any) -> None:
    cc4 = SCHEMAS["CC4"]
    eight = Condition("eight", (Trials(SCHEMAS["CC3"]),), (Trials(cc4, source, 8),))
    with pytest.raises(
        ProtocolError,
        match=r"8 trials of CC4 .* 5 layouts of 4 levers .* at most 5 trials, or for layouts: rand",
    ):
        visits_of(eight, HUMAN)
    five = Condition("five", (Trials(cc4, source, 5),))
    assert len(visits_of(five, HUMAN)) == 5
    many = Condition("many", (Trials(cc4, "random", 8),))
    assert len(visits_of(many, HUMAN)) == 8
    if source is None:  # the protocol may have random ones
        assert len(visits_of(eight, replace(HUMAN, layouts="random"))) == 6 + 8


def test_training_with_four_levers_has_the_five_published_layouts() -> None:
    visits = visits_of("CC4-CC3", HUMAN)
    assert [visit.phase for visit in visits] == ["train"] * 5 + ["test"]
    assert {visit.layout.name for visit in visits[:5]} == FOUR


# -- conditions of one's own ----------------------------------------------------------------------


def layouts(schema: str, *names: str) -> tuple[Layout, ...]:
    return tuple(Layout.of(SCHEMAS[schema], name) for name in names)


def test_groups_of_trials_come_in_the_order_in_which_they_are_declared() -> None:
    condition = Condition(
        "own",
        train=(
            Trials(SCHEMAS["CE3"], layouts("CE3", "trial5", "trial2"), shuffle=False),
            Trials(SCHEMAS["CC4"], number=2),
            Trials(SCHEMAS["chain3"], "random", 3),
        ),
        test=(Trials(SCHEMAS["CC3"], layouts("CC3", "trial1")), Trials(SCHEMAS["CE4"])),
    )
    for subject in range(5):
        visits = visits_of(condition, replace(HUMAN, train_loops=2), subject)
        assert [visit.schema.name for visit in visits] == [
            *(["CE3"] * 2 + ["CC4"] * 2 + ["chain3"] * 3) * 2,
            "CC3",
            "CE4",
        ]
        assert [visit.phase for visit in visits] == ["train"] * 14 + ["test"] * 2
        assert [visit.trial for visit in visits] == [1, 2, 3, 4, 5, 6, 7] * 2 + [1, 2]
        assert [visit.layout.name for visit in visits[:2]] == ["trial5", "trial2"]
        assert visits[14].layout.name == "trial1"
    assert [schema.name for schema in condition.schemas] == ["CE3", "CC4", "chain3", "CC3", "CE4"]


def test_given_layouts_are_all_used_in_random_order_unless_the_order_is_kept() -> None:
    given = layouts("CC3", "trial6", "trial1", "trial3", "trial2")
    shuffled = Condition("own", (Trials(SCHEMAS["CC3"], given),))
    orders = [tuple(v.layout for v in visits_of(shuffled, HUMAN, seed)) for seed in range(20)]
    assert len(set(orders)) > 5
    assert all(set(order) == set(given) for order in orders)
    kept = Condition("own", (Trials(SCHEMAS["CC3"], given, shuffle=False),))
    assert all(
        [visit.layout for visit in visits_of(kept, HUMAN, seed)] == list(given) for seed in range(9)
    )
    some = Condition("own", (Trials(SCHEMAS["CC3"], given, 2, shuffle=False),))
    assert [visit.layout for visit in visits_of(some, HUMAN)] == list(given[:2])


def test_a_condition_is_one_schema_or_two_by_name_or_a_path(tmp_path: Path) -> None:
    baseline = named("chain3")
    assert [group.schema.name for group in baseline.train] == ["chain3"]
    assert not baseline.test
    transfer = named("chain3-seven")
    assert [group.schema.name for group in (*transfer.train, *transfer.test)] == ["chain3", "seven"]
    path = tmp_path / "my-own.yaml"
    write_schema(ONE, path)
    by_path = named(str(path))
    assert by_path == Condition("one", (Trials(ONE),))


def test_a_transfer_may_name_files_by_their_paths(tmp_path: Path) -> None:
    folder = tmp_path / "my-own-schemas"
    folder.mkdir()
    write_schema(ONE, folder / "with-dashes.yaml")
    path = f"{folder}/with-dashes.yaml"
    for name, expected, schemas in (
        (path, "one", ["one"]),
        (f"CC3-{path}", "CC3-one", ["CC3", "one"]),
        (f"{path}-CC3", "one-CC3", ["one", "CC3"]),
        (f"{path}-{path}", "one-one", ["one", "one"]),
    ):
        condition = named(name)
        assert condition.name == expected
        assert [group.schema.name for group in (*condition.train, *condition.test)] == schemas
    # A file of the whole name comes first.
    write_schema(find_schema("CE4"), folder / "CC3-CC4.yaml")
    assert named(f"{folder}/CC3-CC4.yaml").name == "CE4"
    with pytest.raises(OpenLockError, match=r"^\S*/nothing.yaml: cannot be read"):
        named(f"CC3-{folder}/nothing.yaml")
    with pytest.raises(OpenLockError, match=r"cannot be read"):
        named(f"CC33-{path}")
    (folder / "bad.yaml").write_text("name: [", encoding="utf-8")
    with pytest.raises(FileError, match=r"bad\.yaml:1:"):
        named(f"CC3-{folder}/bad.yaml")


# -- errors ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["CC3-CC4-CE4", "", "CC3-", "C C", "-CC4"])
def test_what_is_no_condition_is_told_what_one_looks_like(name: str) -> None:
    with pytest.raises(
        ProtocolError, match=r"is not a condition; write one schema .* or two .*my/vault.yaml"
    ):
        named(name)


def test_unknown_names_are_told_their_nearest() -> None:
    with pytest.raises(OpenLockError, match=r"no schema 'CC5'; did you mean CC[34]\?"):
        named("CC3-CC5")
    with pytest.raises(ProtocolError, match="is not a condition: 100,000 characters"):
        Condition.named("-" * 100_000, find_schema)
    with pytest.raises(ProtocolError, match=r"no protocol 'humans'; did you mean human\?"):
        find_protocol("humans")
    mine = Protocol("mine", attempt_limit=3, stop_when_solved=True)
    assert find_protocol("mine", {"mine": mine}) is mine
    assert find_protocol("rl", {"mine": mine}) is RL


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"attempt_limit": 0},
            "attempt_limit of protocol mine must be a whole number of",
        ),
        (
            {"baseline_trials": 0},
            "baseline_trials of protocol mine must be a whole number of",
        ),
        ({"test_loops": -2}, "test_loops of protocol mine must be a whole number of"),
        ({"action_limit": 0}, "action_limit of protocol mine must be a whole number of"),
        ({"attempt_limit": 2.5}, "must be a whole number of at least 1, and this is 2.5"),
        ({"attempt_limit": "3"}, "must be a whole number of at least 1, and this is '3'"),
        ({"stop_when_solved": "yes"}, "stop_when_solved must be true or false"),
        ({"action_limit": 64}, "action_limit of protocol mine must be at most 63"),
        ({"layouts": "own"}, "layouts are published or random, not 'own'"),
    ],
)
def test_a_protocol_that_cannot_be_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        replace(HUMAN, name="mine", **arguments)


def test_a_schema_that_needs_more_actions_is_refused_before_anybody_plays() -> None:
    short = replace(HUMAN, action_limit=3)
    assert visits_of("CC3-CC4", short)
    with pytest.raises(
        ProtocolError, match=r"chain3 needs attempts of 4 actions .* allows 3; raise"
    ):
        visits_of("CC3-chain3", short)


def test_attempts_have_three_actions_or_as_many_as_the_schema_needs() -> None:
    expected = {"CC4": 3, "chain3": 4, "seven": 4, "two_keys": 3}
    assert {name: HUMAN.actions_for(SCHEMAS[name]) for name in expected} == expected
    assert HUMAN.actions_for(ONE) == 3
    assert replace(HUMAN, action_limit=9).actions_for(SCHEMAS["chain3"]) == 9


@pytest.mark.parametrize("layout", ["trial1", "trial77"])
def test_a_test_layout_that_does_not_fit_names_the_protocol(layout: str) -> None:
    with pytest.raises(ProtocolError, match=r"test_layout of protocol human: .*layout"):
        visits_of("CC3-CC4", replace(HUMAN, test_layout=layout))


def test_more_trials_than_given_layouts_are_refused() -> None:
    with pytest.raises(
        ProtocolError, match="3 trials of CC3 need that number of layouts, and 2 are given"
    ):
        Trials(SCHEMAS["CC3"], layouts("CC3", "trial1", "trial2"), 3)


def test_conditions_and_protocols_are_plain_data() -> None:
    condition = Condition(
        "own", (Trials(SCHEMAS["CC3"], layouts("CC3", "trial2")),), (Trials(SCHEMAS["CC4"]),)
    )
    data = condition.as_dict()
    assert data["train"] == [
        {
            "schema": SCHEMAS["CC3"].as_dict(),
            "layouts": [[3, 5, 1]],
            "number": None,
            "shuffle": True,
        }
    ]
    assert data["test"][0]["layouts"] is None
    assert Protocol(**RL.as_dict()) == RL


def test_a_protocol_may_be_settings_as_a_file_has_them(tmp_path: Path) -> None:
    path = tmp_path / "e.yaml"
    path.write_text(
        "name: e\nconditions: [CC3]\nlearners: [random]\nprotocol: short\n"
        "protocols: {short: {based_on: rl, attempt_limit: 9, stop_when_solved: true}}\n"
    )
    settings = {"based_on": "rl", "attempt_limit": 9, "stop_when_solved": True}
    (in_file,) = read_experiment(path).protocols
    given = {**settings, "name": "short"}
    (named,) = make_experiment(["CC3"], ["random"], protocol=given).protocols
    assert named == in_file
    for arguments, name in (
        ({"protocol": settings}, "rl_attempt_limit_9_stop_when_solved_True"),
        ({"attempt_limit": 9}, "human_attempt_limit_9"),
        ({"attempt_limit": 9, "protocol": PROTOCOLS["rl"]}, "rl_attempt_limit_9"),
        (
            {"attempt_limit": 9, "protocol": {"test_trials": 2, "name": "two"}},
            "two_attempt_limit_9",
        ),
    ):
        (made,) = make_experiment(["CC3"], ["random"], **arguments).protocols  # type: ignore[arg-type]
        assert (made.name, made.attempt_limit) == (name, 9)
    changes = Changes(protocol={"based_on": "short", "test_trials": 3})
    (changed,) = read_experiment(path, changes).protocols
    assert (changed.name, changed.attempt_limit, changed.test_trials) == (
        "short_test_trials_3", 9, 3,
    )  # fmt: skip
    own = learner("random", protocol="rl", label="own")  # it has a protocol of its own
    both = make_experiment(["CC3"], ["random", own], attempt_limit=9)
    assert [one.protocol.name for one in both.learners] == ["human_attempt_limit_9", "rl"]


@pytest.mark.parametrize(
    ("protocol", "said"),
    [
        ({"atempt_limit": 3}, "did you mean attempt_limit?"),
        ({"attempt_limit": 0}, "greater than or equal to 1"),
        ({"based_on": "rll"}, "did you mean rl?"),
        ({"attempt_limit": 3, "name": "human"}, "choose another name"),
        ({"attempt_limit": 3, "name": "a b"}, "is not a valid name of a protocol"),
        (3, "3 is not a protocol; give its name, a Protocol, or settings such as {"),
    ],
)  # fmt: skip
def test_settings_that_are_no_protocol_are_refused(protocol: Any, said: str) -> None:
    with pytest.raises(OpenLockError) as caught:
        make_experiment(["CC3"], ["random"], protocol=protocol)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
