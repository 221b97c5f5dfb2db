"""Rewards: names, weights, worked examples, and every event against the oracle."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracle
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.world.kernel import IDLE
from causal_openlock.world.rewards import PRESETS, TERMS, Events, Weights, find_reward
from causal_openlock.world.room import Layout

PUSH = {"L0": 0, "L1": 1, "L2": 2, "L3": 3, "white": 6, "door": 14}


@pytest.mark.parametrize(
    ("form", "attempts"),
    [
        # Of each attempt in CC4: what is done, and what each action pays; L0 enables the others.
        ("basic", [("L0 L1 door", [0, 10, 50]), ("L0 L1 white", [0, 10, 0]),
                   ("L0 L1 -L0", [0, 10, 0]), ("L0 L1 door", [0, 10, 50])]),
        ("unique_solutions", [("L0 L1 white", [0, 10, 0]), ("L0 L1 door", [0, 10, 50]),
                              ("L0 L1 door", [0, 0, 0]), ("L0 L2 door", [0, 10, 50])]),
        ("state_change", [("L0 L1 door", [0.5, 10.5, 50.5]), ("L1 L0 L0", [0, 0.5, 0]),
                          ("L0 -L0 door", [0.5, 0.5, 0])]),
        ("negative_immovable", [("white L1 door", [-0.5, -0.5, -0.5]),
                                ("-L0 L0 L0", [-0.5, 0, -0.5]), ("L0 L1 door", [0, 10, 50])]),
        ("negative_repeat", [("L0 L0 L0", [0, -0.25, -0.25]), ("L0 white L0", [0, 0, 0])]),
        (["basic", "partial_sequence"], [("L0 L1 door", [1, 10, 50]), ("L1 L0 L1", [0, 0, 10]),
                                         ("white L0 L1", [0, 0, 10])]),
        ("solution_multiplier", [("L0 L3 door", [0, 10, 50]), ("L0 L1 white", [0, 15, 0]),
                                 ("L0 L1 door", [0, 15, 75]), ("L0 L3 door", [0, 10, 50]),
                                 ("L0 L2 door", [0, 22.5, 112.5])]),
        ("paper", [("white L1 door", [-0.5, -0.5, -0.5]), ("L0 L1 door", [1, 10, 50]),
                   ("L0 L2 door", [1, 15, 75]), ("L0 L0 L3", [1, -0.5, 22.5])]),
        # Weights.
        ({"solution_multiplier": 2.0}, [("L0 L1 door", [1, 10, 50]), ("L0 L2 door", [1, 20, 100])]),
        ({"preset": "basic", "open": 100}, [("L0 L1 door", [0, 10, 100])]),
        ({"terms": ["basic", "state_change"], "state_change": 2}, [("L0 L1 L2", [2, 12, 2])]),
        ({"terms": ["negative_repeat"], "negative_repeat": -3}, [("L0 L0 L0", [0, -3, -3])]),
    ],
)  # fmt: skip
def test_worked_examples(form, attempts):
    env = OpenLockEnv("CC4", Layout((0, 1, 2, 3)), form)
    env.reset(seed=0)
    for words, paid in attempts:
        env.reset()
        actions = [
            PUSH[word.removeprefix("-")] + 7 * word.startswith("-") for word in words.split()
        ]
        assert [env.step(action)[1] for action in actions] == pytest.approx(paid)


NUMBERS = st.floats(-100, 100, allow_nan=False).map(lambda x: round(x, 6))
FORMS = st.builds(
    lambda base, weights: {**base, **weights},
    st.sampled_from([{}, *({"preset": name} for name in PRESETS if "authors" not in name)])
    | st.lists(st.sampled_from(sorted(TERMS)), min_size=1, unique=True).map(
        lambda terms: {"terms": terms}
    ),
    st.dictionaries(st.sampled_from(sorted(Weights.model_fields)), NUMBERS),
)


@settings(max_examples=40, deadline=None)
@given(form=FORMS)
def test_a_reward_pays_what_the_oracle_does_and_comes_back_from_every_form(form):
    whole = find_reward(form)
    assert find_reward(whole.written()) == whole
    words = np.arange(IDLE)
    events = Events.of(words, words % 4)
    fields = (events.first, events.repeated, events.first & events.on_path, events.changed,
              events.unlocks, events.opens, events.new, events.found)  # fmt: skip
    happened = map(oracle.Event, *(field.tolist() for field in fields))
    weights = whole.weights.model_dump()
    expected = [oracle.reward(event, whole.terms, weights) for event in happened]
    assert whole.pay(events) == pytest.approx(expected)


def every_field(events):
    """A digit for each field of the events."""
    return sum(getattr(events, name) * 2.0**power for power, name in enumerate(vars(events)))


def test_a_function_of_ones_own_pays_the_same_in_one_room_and_in_many():
    arguments = ("CC4", "trial7", f"{__name__}:every_field", "trial")
    single, many = OpenLockEnv(*arguments), OpenLockVectorEnv(1, *arguments)
    single.reset(seed=0)
    many.reset(seed=0)
    paid = set()
    for action in np.random.default_rng(0).choice([4, 0, 6, 14, 14, 1], 80):  # L0, L1, L2, door
        _, reward, *_ = single.step(int(action))
        assert many.step(np.array([action]))[1] == reward
        paid.add(reward)
    assert len(paid) > 10


def test_a_reward_without_changes_is_the_preset_and_changes_are_in_its_name():
    assert find_reward({}) is find_reward({"preset": "paper", "open": 50}) is PRESETS["paper"]
    assert set(PRESETS["paper"].as_dict()) == {"name", "terms"}
    changed = find_reward({"solution_multiplier": 2.0, "state_change": 0.5})
    assert changed.name == "paper(state_change=0.5, solution_multiplier=2)"
    assert changed.as_dict()["weights"] == {"solution_multiplier": 2.0}
    assert changed.terms == (*PRESETS["paper"].terms, "state_change")
    assert changed.weights == Weights(solution_multiplier=2.0)
