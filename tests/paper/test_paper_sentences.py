"""Sentences of the paper that its own numbers give, or contradict, and the page that lists all."""

import itertools
import re
from fractions import Fraction

import numpy as np
import pytest

from causal_openlock.analysis.effects import Group
from causal_openlock.paper.significance import contrast_test
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world import facts
from causal_openlock.world.room import Layout, Room
from support.places import ROOT

HUMAN = facts.results()["cogsci2018"]["human"]


def in_test(condition):
    """People in a test, as Figure 4 has them."""
    return Group.published(**HUMAN["transfer"][condition], size=40)


def test_the_effect_of_the_test_structure_has_another_f_in_the_two_way_analysis():
    cells = [in_test(name) for name in ("CE3-CE4", "CC3-CE4", "CE3-CC4", "CC3-CC4")]
    two_way = contrast_test(cells, (0.5, 0.5, -0.5, -0.5))
    assert (two_way.df, round(two_way.value, 2)) == ((1, 156), 20.03)
    # The one-way test counts what training and the interaction explain as error.
    grand = np.mean([cell.mean for cell in cells])
    within = sum(39 * cell.variance for cell in cells)
    between = sum(40 * (cell.mean - grand) ** 2 for cell in cells)
    structure = 40 * two_way.difference**2
    one_way = structure / ((within + between - structure) / 158)
    assert one_way == pytest.approx(17.14, abs=0.01)


@pytest.mark.parametrize(
    ("name", "moves", "unlocks"),
    [
        ("CC4", Fraction(1, 4), Fraction(1)),
        ("CE4", Fraction(3, 4), Fraction(1, 3)),
        ("CC3", Fraction(1, 3), Fraction(1)),
        ("CE3", Fraction(2, 3), Fraction(1, 2)),
    ],
)
def test_both_structures_are_as_likely_to_be_unlocked_by_two_random_pushes(name, moves, unlocks):
    """Of two active levers one after the other: the first moves, then the second unlocks."""
    schema = find_schema(name)
    levers = range(len(schema.levers))
    room = Room.of(schema, Layout(tuple(levers)))
    first = [room.next_state[0, lever] for lever in levers]
    moving = [lever for lever in levers if first[lever] != 0]
    assert Fraction(len(moving), len(levers)) == moves
    after = [
        bool(room.fsm.unlocked[room.next_state[first[one], other]])
        for one, other in itertools.permutations(levers, 2)
        if one in moving
    ]
    assert Fraction(sum(after), len(after)) == unlocks
    assert moves * unlocks == Fraction(1, len(levers))


def test_every_sentence_has_a_row_with_a_verdict():
    text = (ROOT / "docs" / "reproduction.md").read_text(encoding="utf-8")
    tables = re.findall(r"^\| the paper says .*\n\|[-| ]+\n((?:\|.*\n)+)", text, re.MULTILINE)
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for table in tables for line in table.splitlines()]
    assert len(rows) > 80
    verdict = re.compile(r"\*\*\w|verdict\"\)|\]\(#")  # of its own, of a claim, of another row
    for row in rows:
        assert len(row) == 3, row
        assert verdict.search(row[1]), row
        assert row[2].strip(), row
