"""Conditions and protocols: which rooms a subject visits, in which order, how often."""

from collections import Counter
from dataclasses import replace

import numpy as np

from causal_openlock.experiment.condition import PAPER_CONDITIONS, Condition, Trials
from causal_openlock.experiment.making import Changes, learner, make_experiment, read_experiment
from causal_openlock.experiment.plan import plan
from causal_openlock.experiment.protocol import Protocol, find_protocol
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout
from support.session_play import HUMAN, RL, SCHEMAS, named


def visits_of(condition, protocol, subject=0):
    condition = named(condition) if isinstance(condition, str) else condition
    return plan(condition, protocol, np.random.default_rng(subject))


def names(visits):
    return [visit.layout.name for visit in visits]


def layouts(schema, *names):
    return tuple(Layout.of(SCHEMAS[schema], name) for name in names)


def test_people_have_30_attempts_and_stop_when_everything_is_found():
    assert (HUMAN.attempt_limit, HUMAN.stop_when_solved) == (30, True)
    for name in PAPER_CONDITIONS:
        visits = visits_of(name, HUMAN)
        schemas, tested = [name] * 5, []
        if "-" in name:
            schemas, tested = [name[:3]] * 6, [name[4:]]
        assert [(visit.phase, visit.loop, visit.trial) for visit in visits] == [
            *(("train", 1, trial) for trial in range(1, 1 + len(schemas))),
            *(("test", 1, 1) for _ in tested),
        ]
        assert [visit.schema.name for visit in visits] == schemas + tested


def test_a_protocol_has_defaults_and_is_found_by_its_name():
    mine = Protocol("mine", np.int64(3), True)
    assert mine.as_dict() == {
        "name": "mine", "attempt_limit": 3, "stop_when_solved": True, "baseline_trials": 5,
        "training_trials": 6, "test_trials": 1, "baseline_loops": 1, "train_loops": 1,
        "test_loops": 1, "layouts": "published", "test_layout": None, "action_limit": None,
    }  # fmt: skip
    assert Protocol(**RL.as_dict()) == RL
    assert find_protocol("mine", {"mine": mine}) is mine
    assert find_protocol("rl", {"mine": mine}) is RL


def test_attempts_have_three_actions_or_as_many_as_the_schema_needs():
    expected = {"CC4": 3, "chain3": 4, "seven": 4, "two_keys": 3}
    assert {name: HUMAN.actions_for(SCHEMAS[name]) for name in expected} == expected
    assert HUMAN.actions_for(Schema("one", ["A"], {"A": ["door"]})) == 3
    for limit in (4, 9, 63):
        assert replace(HUMAN, action_limit=limit).actions_for(SCHEMAS["chain3"]) == limit


def test_each_subject_and_each_loop_has_an_order_of_its_own():
    orders = [tuple(names(visits_of("CC4", HUMAN, subject))) for subject in range(500)]
    assert len(set(orders[:30])) > 15
    loops = np.reshape(names(visits_of("CC4", RL)), (10, 5))
    assert len({tuple(loop) for loop in loops}) > 5
    # Each layout is as likely to come first as any other.
    assert all(70 < count < 130 for count in Counter(order[0] for order in orders).values())
    assert visits_of("CC3-CC4", RL, 3) == visits_of("CC3-CC4", RL, 3)


def test_random_layouts_differ_within_a_loop_and_leave_the_published_ones_behind():
    protocol = replace(HUMAN, layouts="random", baseline_trials=40, baseline_loops=3)
    loops = np.reshape(names(visits_of("CC4", protocol)), (3, 40))
    assert [len(set(loop)) for loop in loops] == [40, 40, 40]
    assert len(set(loops.ravel())) > 60


def test_numbers_and_layouts_that_are_declared_are_kept():
    for source, number in ((None, 5), ("published", 5), ("random", 8)):
        condition = Condition("mine", (Trials(SCHEMAS["CC4"], source, number),))
        assert len(visits_of(condition, HUMAN)) == number
    eight = Condition("eight", (Trials(SCHEMAS["CC3"]),), (Trials(SCHEMAS["CC4"], None, 8),))
    assert len(visits_of(eight, replace(HUMAN, layouts="random"))) == 6 + 8
    both = layouts("CE3", "trial5", "trial2")
    for shuffle, orders in ((False, 1), (True, 2)):
        condition = Condition("both", (Trials(SCHEMAS["CE3"], both, shuffle=shuffle),))
        played = {tuple(names(visits_of(condition, HUMAN, subject))) for subject in range(20)}
        assert ("trial5", "trial2") in played
        assert len(played) == orders


def test_results_of_0_2_may_have_fixed_the_layout_of_the_test():
    visits = visits_of("CC3-CE4", replace(RL, train_loops=1, test_layout="trial7"))
    assert names(visits[6:]) == ["trial7"] * 10


def test_a_subject_on_record_has_the_rooms_that_are_on_record():
    rooms = {3: layouts("CC3", "trial6", "trial6")}
    condition = Condition("CC3", named("CC3").train, rooms=rooms)
    drawn = plan(condition, HUMAN, np.random.default_rng(3))
    known = plan(condition, HUMAN, np.random.default_rng(3), subject=3)
    assert names(known) == ["trial6", "trial6", *names(drawn)[2:]]
    assert condition.as_dict()["rooms"] == {"3": [list(rooms[3][0].places)] * 2}


def test_a_protocol_may_be_settings_as_a_file_has_them(tmp_path):
    path = tmp_path / "e.yaml"
    path.write_text(
        "name: e\nconditions: [CC3]\nlearners: [random]\nprotocol: short\n"
        "protocols: {short: {based_on: rl, attempt_limit: 9, stop_when_solved: true}}\n"
    )
    settings = {"based_on": "rl", "attempt_limit": 9, "stop_when_solved": True}
    every = {"test_trials": 3, "train_loops": 2, "baseline_loops": 4, "test_loops": 5}
    for options, name in (
        ({"protocol": settings}, "rl_attempt_limit_9_stop_when_solved_True"),
        ({"protocol": RL, "attempt_limit": 9}, "rl_attempt_limit_9"),
        ({"attempt_limit": 9, "protocol": {"test_trials": 2, "name": "a"}}, "a_attempt_limit_9"),
        ({"protocol": {**settings, **every}}, "rl_9431237b"),  # too many settings for a name
    ):
        (made,) = make_experiment(["CC3"], ["random"], **options).protocols
        assert (made.name, made.attempt_limit) == (name, 9)
    short = replace(RL, name="short", attempt_limit=9, stop_when_solved=True)
    named_so = {**settings, "name": "short"}
    assert make_experiment(["CC3"], ["random"], protocol=named_so).protocols == (short,)
    assert read_experiment(path).protocols == (short,)
    changes = Changes(protocol={"based_on": "short", "test_trials": 3})
    (changed,) = read_experiment(path, changes).protocols
    assert changed == replace(short, name="short_test_trials_3", test_trials=3)
    own = learner("random", protocol="rl", label="own")  # it has a protocol of its own
    both = make_experiment(["CC3"], ["random", own], attempt_limit=9)
    assert [spec.protocol.name for spec in both.learners] == ["human_attempt_limit_9", "rl"]
