"""Forms that what is asked for may have: a name or a list, and settings as a mapping."""

import causal_openlock as ol


def test_a_condition_and_a_learner_need_no_list_and_count_once():
    made = ol.make_experiment("CC3", "random")
    assert made.identity == ol.make_experiment(["CC3"], ["random"]).identity
    steps = ol.knowledge_steps
    assert len(steps(["CC3", "CC3"])) == len(steps(["CC3"]))


def test_many_settings_of_a_protocol_still_have_a_name():
    settings = {"attempt_limit": 10, "baseline_trials": 2, "training_trials": 3, "action_limit": 5}
    made = ol.make_experiment(["CC3"], ["random"], protocol={**settings, "train_loops": 2})
    again = ol.make_experiment(["CC3"], ["random"], protocol={**settings, "train_loops": 3})
    names = [one.learners[0].protocol.name for one in (made, again)]
    assert all(name.startswith("human_") and len(name) <= 64 for name in names)
    assert names[0] != names[1]
