"""Rewards by name and by list of terms."""

from __future__ import annotations

import pytest

from causal_openlock.errors import RewardError
from causal_openlock.world.rewards import TERMS, Reward, find_reward


def test_a_list_of_terms_is_their_sum() -> None:
    reward = find_reward(["basic", "negative_repeat"])
    assert isinstance(reward, Reward)
    assert (reward.name, reward.terms) == ("basic+negative_repeat", ("basic", "negative_repeat"))
    assert find_reward(reward) is reward
    single = find_reward(["state_change"])
    assert isinstance(single, Reward)
    assert single.terms == ("state_change",)


def test_every_term_alone_is_a_preset_that_builds_on_the_basic_reward() -> None:
    for term in TERMS:
        preset = find_reward(term)
        assert isinstance(preset, Reward)
        assert {"basic", term} <= set(preset.terms)
    assert find_reward("paper") == Reward(
        "paper", ("basic", "negative_immovable", "partial_sequence", "solution_multiplier")
    )


@pytest.mark.parametrize(
    ("reward", "message"),
    [
        ("basik", "there is no reward 'basik'; did you mean basic[?] known: "),
        ("authors2018", "did you mean authors_2018[?]"),
        (["basic", "state_chang"], "there is no reward term 'state_chang'; did you mean state_cha"),
        (["paper"], "there is no reward term 'paper'"),
        (["basic", 3], "there is no reward term 3"),
        (["basic", "basic"], "the reward term basic is listed twice; remove one of them"),
        ([], "a reward needs at least one term; known: basic, "),
    ],
)
def test_a_reward_that_does_not_exist_is_told_in_a_sentence(reward: object, message: str) -> None:
    with pytest.raises(RewardError, match=message) as caught:
        find_reward(reward)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
