"""The numbers by which actions of many rooms fail: Philox4x32-10, a stream for each room."""

import numpy as np
import pytest
from scipy import stats

from causal_openlock.world.kernel import uniform

WORD = 0xFFFFFFFF


def philox(counter, key):
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


def test_the_twin_gives_the_known_answers_of_its_authors():
    counter = (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344)
    answer = philox(counter, (0xA4093822, 0x299F31D0))
    assert answer == [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1]
    assert philox((0,) * 4, (0, 0)) == [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]


@pytest.mark.parametrize("moment", [0, 1, 2**32 + 5])
@pytest.mark.parametrize("key", [(0, 0), (WORD, 7), (0xA4093822, 0x299F31D0)])
def test_numbers_are_those_of_the_plain_twin_for_any_number_of_rooms(moment, key):
    few, many = np.empty(40), np.empty(4000)
    uniform(few, moment, *key)
    uniform(many, moment, *key)
    later = (moment & WORD, moment >> 32)
    expected = [word / 2**32 for block in range(10) for word in philox((block, 0, *later), key)]
    assert few.tolist() == many[:40].tolist() == expected


def test_numbers_are_uniform_and_independent_between_rooms_and_moments():
    numbers = np.empty((1024, 256))
    for moment, own in enumerate(numbers):
        uniform(own, moment, 1, 2)
    assert 0 <= numbers.min() < numbers.max() < 1
    assert stats.kstest(numbers.ravel(), "uniform").pvalue > 1e-4
    cells = (numbers * 16).astype(int)  # pairs fall into 16 * 16 cells equally often
    for first, second in ((cells[:, 0::2], cells[:, 1::2]), (cells[:-1], cells[1:])):
        counts = np.bincount((16 * first + second).ravel(), minlength=256)
        assert stats.chisquare(counts).pvalue > 1e-4
