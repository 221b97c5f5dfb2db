"""JSON of which a key is there twice is refused by whatever reads it."""

import pytest

from causal_openlock.files.checksums import BLANK, IN_JSON, fill_in
from causal_openlock.files.json_text import DoubledKeyError, parse_json
from causal_openlock.render.words import Wording
from openlock_learners.language.offered_actions import read_structure

DOUBLED = fill_in(b'{"a": 1, "a": 2, "sha256": "%b"}' % BLANK, IN_JSON)


def test_a_doubled_key_is_named():
    with pytest.raises(DoubledKeyError, match="the key 'b' is there twice"):
        parse_json('{"a": {"b": 1, "b": 1}}')
    many = ",".join(f'"a{number}":0' for number in range(50_000))
    with pytest.raises(DoubledKeyError, match="'b' is there twice"):  # in no time
        parse_json(f'{{{many},"b":1,"b":2}}')
    with pytest.raises(ValueError, match="NaN is not JSON"):
        parse_json("[NaN]")


def test_a_structure_that_is_answered_twice_is_none():
    words = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
    said = '{"enables": [], "enables": [{"cause": "oak", "effect": "the door"}]}'
    assert read_structure({"content": said}, words, ("P0", "P1", "P2", "door")) is None
