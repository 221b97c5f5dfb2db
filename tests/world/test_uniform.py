"""The numbers by which actions of many rooms fail: Philox4x32-10, a stream for each room."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from causal_openlock.world.kernel import uniform

WORD = 0xFFFFFFFF


def philox(counter: tuple[int, ...], key: tuple[int, ...]) -> list[int]:
    """Four words of Philox4x32-10, as Salmon et al. (2011) define it."""
    words, keys = list(counter), list(key)
    for _ in range(10):
        left, right = words[0] * 0xD2511F53, words[2] * 0xCD9E8D57
        words = [
            (right >> 32) ^ words[1] ^ keys[0],
            right & WORD,
            (left >> 32) ^ words[3] ^ keys[1],
            left & WORD,
        ]
        keys = [(keys[0] + 0x9E3779B9) & WORD, (keys[1] + 0xBB67AE85) & WORD]
    return words


def drawn(rooms: int, moments: int, key: tuple[int, int] = (1, 2)) -> np.ndarray:
    """``[moments, rooms]`` numbers."""
    numbers = np.empty((moments, rooms))
    for moment, own in enumerate(numbers):
        uniform(own, moment, *key)
    return numbers


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ("00000000 " * 4, "00000000 " * 2, "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
        ("ffffffff " * 4, "ffffffff " * 2, "408f276d 41c83b0e a20bc7c6 6d5451fd"),
        (
            "243f6a88 85a308d3 13198a2e 03707344",
            "a4093822 299f31d0",
            "d16cfe09 94fdcceb 5001e420 24126ea1",
        ),
    ],
)
def test_the_twin_gives_the_known_answers_of_its_authors(
    counter: str, key: str, words: str
) -> None:
    one, other, expected = (
        tuple(int(word, 16) for word in given.split()) for given in (counter, key, words)
    )
    assert philox(one, other) == list(expected)


@pytest.mark.parametrize("moment", [0, 1, 2**32 - 1, 2**32 + 5])
@pytest.mark.parametrize("key", [(0, 0), (WORD, 7), (0xA4093822, 0x299F31D0)])
def test_numbers_are_those_of_the_plain_twin(moment: int, key: tuple[int, int]) -> None:
    numbers = np.empty(40)
    uniform(numbers, moment, *key)
    later = (moment & WORD, moment >> 32)
    expected = [word / 2**32 for block in range(10) for word in philox((block, 0, *later), key)]
    assert numbers.tolist() == expected


def test_a_room_has_the_same_numbers_whatever_the_number_of_rooms() -> None:
    few, many = drawn(8, 20), drawn(4000, 20)
    np.testing.assert_array_equal(few, many[:, :8])


def test_numbers_are_uniform_and_independent_between_rooms_moments_and_seeds() -> None:
    rooms, moments = 256, 1024
    numbers = drawn(rooms, moments)
    assert 0 <= numbers.min() < numbers.max() < 1
    assert stats.kstest(numbers.ravel(), "uniform").pvalue > 1e-4
    each = [stats.kstest(own, "uniform").pvalue for own in numbers.T]
    assert stats.kstest(each, "uniform").pvalue > 1e-4, "in every room"
    # Pairs fall into 16 * 16 cells equally often: of neighbours, of rooms in different blocks and
    # of the same place in theirs, of a room and itself a moment later, and of two seeds.
    cells = (numbers * 16).astype(int)
    other_seed = (drawn(rooms, moments, key=(2, 2)) * 16).astype(int)
    for one, two in (
        (cells[:, 0::2], cells[:, 1::2]),
        (cells[:, :-4], cells[:, 4:]),
        (cells[:, :128], cells[:, 128:]),
        (cells[:-1], cells[1:]),
        (cells, other_seed),
    ):
        counts = np.bincount((16 * one + two).ravel(), minlength=256)
        assert stats.chisquare(counts).pvalue > 1e-4
    # No two rooms go together: correlations are as large as 32,640 pairs give by chance.
    correlations = np.corrcoef(numbers.T)[np.triu_indices(rooms, 1)] * np.sqrt(moments)
    assert stats.kstest(correlations, "norm").pvalue > 1e-4
    assert abs(correlations).max() < 6
