"""What sentences of the paper come to, computed from schemas and from its printed figures."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import permutations

import numpy as np
import pytest
from scipy import stats

from causal_openlock import PROTOCOLS, Condition, Session, create, find_schema
from causal_openlock.paper.significance import GroupSummary, contrast_test
from causal_openlock.world import facts

TRANSFER = facts.results()["cogsci2018"]["human"]["transfer"]
BASELINE = facts.results()["cogsci2018"]["human"]["baseline"]
FIGURE_6 = facts.results()["cogsci2018"]["ddqn"]["baseline_counts"]
FIGURE_7 = facts.results()["cogsci2018"]["ddqn"]["transfer_counts"]


def opened(counts: dict[str, int]) -> float:
    return sum(counts[name] for name in ("open1", "open2", "open3")) / sum(counts.values())


# -- "Why is CE more difficult than CC?" ---------------------------------------------------------


@pytest.mark.parametrize(("name", "moves", "unlocks"), [("CC4", "1/4", "1"), ("CE4", "3/4", "1/3")])
def test_the_first_two_pushes_are_as_likely_to_unlock_in_both_schemas(
    name: str, moves: str, unlocks: str
) -> None:
    # Two different grey levers are pushed at random.
    schema = find_schema(name)
    pairs = list(permutations(schema.levers, 2))
    works = [order for solution in schema.solutions for order in schema.orders(solution)]
    first = [pair for pair in pairs if not schema.causes(pair[0])]
    assert Fraction(len(first), len(pairs)) == Fraction(moves)
    assert Fraction(len([pair for pair in first if pair in works]), len(first)) == Fraction(unlocks)
    assert Fraction(moves) * Fraction(unlocks) == Fraction(1, 4)


# -- people --------------------------------------------------------------------------------------


def test_the_common_effect_did_not_take_more_attempts_in_all_cases() -> None:
    # "Human results show that the CE condition required a greater number of attempts in all cases",
    # and CE3-CE4 "was the second hardest transfer case for humans": in Figure 4 it was the third.
    hardest = sorted(TRANSFER, key=lambda name: -TRANSFER[name]["mean"])
    assert hardest == ["CC3-CE4", "CE3-CC4", "CE3-CE4", "CC3-CC4"]
    assert TRANSFER["CE3-CC4"]["mean"] == 8.175 > TRANSFER["CE3-CE4"]["mean"] == 7.725
    assert np.all(np.array(BASELINE["CE4"]["mean"]) > BASELINE["CC4"]["mean"])


def test_the_main_effect_of_the_tests_structure_is_printed_of_a_one_way_analysis() -> None:
    groups = [
        GroupSummary.published(TRANSFER[name]["mean"], TRANSFER[name]["se"], 40)
        for name in ("CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4")
    ]
    two_way = contrast_test(groups, (-1, -1, 1, 1))
    assert two_way.df == (1, 156)
    assert two_way.value == pytest.approx(20.04, abs=0.015)
    means = np.array([group.mean for group in groups])
    within = sum(group.variance * (group.size - 1) for group in groups)
    sides = means.reshape(2, 2).mean(axis=1)
    between = 40 * ((means - np.repeat(sides, 2)) ** 2).sum()  # what a one-way analysis adds to it
    one_way = 80 * ((sides - means.mean()) ** 2).sum() / ((within + between) / 158)
    assert one_way == pytest.approx(17.14, abs=0.02)


def test_with_three_levers_people_find_both_structures_as_hard() -> None:
    # Means of the same people, in a later paper: CC3 4.11, CE3 4.44 in the last of six rooms.
    human = facts.results()["cogsci2019"]["human"]["all"]
    gap = human["CE3"]["mean"][-1] - human["CC3"]["mean"][-1]
    error = np.hypot(human["CE3"]["se"][-1], human["CC3"]["se"][-1])
    assert gap == pytest.approx(0.33)
    assert abs(gap / error) < 0.5
    assert stats.norm.interval(0.9, gap, error)[1] < 2  # and surely by less than two attempts


def test_people_need_fewer_attempts_for_the_second_solution_than_for_the_first() -> None:
    # A policy without memory would need more: one of the two is found already.
    for condition in ("CC3", "CE3"):
        first, second = (
            facts.results()["cogsci2019"]["human"][name][condition]["mean"]
            for name in ("first", "second")
        )
        for trial in (0, 5):
            assert second[trial] < first[trial]


# -- the paper's DDQN ----------------------------------------------------------------------------


def test_that_third_solutions_are_rarer_than_second_ones_holds_of_any_agent() -> None:
    # open2 and open3 are new solutions of a visit: none has a third without a second, whatever plays.
    session = Session(Condition.named("CC4", find_schema), PROTOCOLS["human"], 40, seed=1)
    record = session.play(create("random")).to_pandas()
    counts = record["category"].value_counts()
    assert counts["open3"] <= counts["open2"] <= counts["open1"]
    for blocks in FIGURE_6.values():
        for block in blocks.values():
            assert block["open3"] <= block["open2"] <= block["open1"]


def test_the_papers_else_does_not_grow_monotonically() -> None:
    common_cause, common_effect = (
        [block["else"] for block in FIGURE_6[name].values()] for name in ("CC4", "CE4")
    )
    assert common_cause[:2] == [12962, 11658]  # falls
    assert common_effect[-2:] == [29185, 29140]  # ends flat
    assert common_cause[-1] > common_cause[0]
    assert common_effect[-1] > common_effect[0]


def test_figure_7_has_sixty_visits_where_the_text_has_fifty() -> None:
    assert {sum(counts.values()) for counts in FIGURE_7.values()} == {60 * 300}
    protocol = PROTOCOLS["rl"]
    assert protocol.test_loops * protocol.baseline_trials == 50


def test_whether_the_asymmetry_is_less_pronounced_in_the_model_depends_on_the_scale() -> None:
    shares = {name: opened(counts) for name, counts in FIGURE_7.items()}
    assert {name: round(share, 2) for name, share in shares.items()} == {
        "CC3-CC4": 0.28, "CE3-CC4": 0.30, "CC3-CE4": 0.17, "CE3-CE4": 0.43,
    }  # fmt: skip
    # As a ratio of the hardest case to the easiest, it is no smaller: 2.6 against people's 2.5.
    people = [values["mean"] for values in TRANSFER.values()]
    assert max(people) / min(people) == pytest.approx(2.49, abs=0.01)
    assert max(shares.values()) / min(shares.values()) == pytest.approx(2.59, abs=0.01)
    # As shares of the attempts that there are, it is: 13 points (CE4) and 2 (CC4) against 20 and 9.
    assert pytest.approx(0.20, abs=0.005) == (13.75 - 7.725) / 30
    assert shares["CE3-CE4"] - shares["CC3-CE4"] == pytest.approx(0.26, abs=0.01)


@pytest.mark.parametrize(
    ("learner", "reward", "differs"),
    [
        ("ddqn", "unique_solutions", True),
        ("semi_markov_ddqn", "unique_solutions", False),  # within one trial, the bits tell
        ("ddqn", "basic", False),
    ],
)
def test_the_same_state_and_action_can_be_rewarded_differently(
    learner: str, reward: str, differs: bool
) -> None:
    """In replay buffers of subjects that repeat a solution."""
    share = [conflicting(rings) for rings in replays(learner, reward)]
    assert (max(share) > 0) == differs


def replays(learner: str, reward: str) -> list[np.ndarray]:
    protocol = replace(PROTOCOLS["rl"], name="short", baseline_trials=1, baseline_loops=1)
    condition = Condition.named("CC3", find_schema)
    session = Session(condition, protocol, 8, seed=3, reward=reward)
    playing = create(learner, {"epsilon_decay": 0.999})
    session.play(playing)
    buffer = playing._replay  # type: ignore[attr-defined]
    return [buffer.rings[:, who, :length].numpy() for who, length in enumerate(buffer.length)]


def conflicting(rings: np.ndarray) -> float:
    """The share of pairs of state and action that are held with more than one reward."""
    rewards: dict[tuple[float, float], set[float]] = {}
    for before, action, _, reward, _ in rings.T.tolist():
        rewards.setdefault((before, action), set()).add(reward)
    return float(np.mean([len(found) > 1 for found in rewards.values()]))
