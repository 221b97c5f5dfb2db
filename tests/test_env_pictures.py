"""What an environment draws."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from cc4_in_trial7 import SOLUTIONS, WHITE
from env_play import trial7


def test_a_room_is_drawn_as_text_or_as_a_picture_that_changes_with_it() -> None:
    frames: dict[str, list[Any]] = {"ansi": [], "rgb_array": []}
    for mode, shown in frames.items():
        env = trial7(render_mode=mode)
        shown.append(env.render())
        for action in SOLUTIONS[0]:
            env.step(action)
            shown.append(env.render())
    assert all(isinstance(text, str) for text in frames["ansi"])
    assert len(set(frames["ansi"])) == 4
    assert "locked" in frames["ansi"][0]
    assert "open" in frames["ansi"][3]
    pictures = frames["rgb_array"]
    assert all(picture.dtype == np.uint8 and picture.shape[2] == 3 for picture in pictures)
    assert all((one != other).any() for one, other in pairwise(pictures))


def test_a_step_that_changes_nothing_is_drawn_as_before() -> None:
    env = trial7(render_mode="rgb_array")
    before = env.render()
    env.step(WHITE)
    np.testing.assert_array_equal(env.render(), before)


def test_render_without_a_mode_says_what_to_do() -> None:
    with pytest.warns(UserWarning, match="render_mode='ansi' or 'rgb_array'"):
        assert trial7().render() is None
