"""What each piece of knowledge saves: by enumeration, as stored, and next to people's rooms."""

from itertools import product

import pandas as pd
import pytest
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.paper.knowledge import SEARCHES
from oracle import Room, Rules
from support.places import ROOT

STORED = ROOT / "evidence" / "worth"


@pytest.mark.parametrize("name", ["CC3", "CE3", "CC4", "CE4"])
def test_sequences_of_three_actions_are_counted_right(name):
    schema = ol.schema(name)
    levers = range(len(schema.levers))
    rules, opening = Rules.of(schema).at(dict(zip(schema.levers, levers, strict=True))), set()
    every = [*product(range(15), repeat=3)]  # pushes of seven levers, pulls of these, the door
    for actions in every:
        room = Room(rules)
        for action in actions:
            room.step(action)
        opening |= {actions} if room.opened else set()
    pushes = [one for one in every if not {*one} & {*range(7, 14)}]
    last = [one for one in pushes if one[2] == 14 and 14 not in one[:2] and one[0] != one[1]]
    active = [one for one in last if {*one[:2]} <= {*levers}]
    counts = [find(len(levers)) for find in SEARCHES.values()]
    assert counts == [len(every), len(pushes), len(last), len(active)]
    assert len(opening) == len(schema.solutions)
    assert opening <= {*active}


def test_the_stored_steps_are_those_that_are_computed():
    stored = pd.read_csv(STORED / "steps.csv")
    own = ol.knowledge_steps(["CC3", "CE3", "CE3"])  # a condition counts once
    again = stored[stored["condition"].isin(["CC3", "CE3"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(again, own, atol=1e-9)


def test_the_figure_has_peoples_rooms_as_a_band():
    drawn = ol.plot_knowledge_steps(pd.read_csv(STORED / "steps.csv"), ax=Figure())
    assert [axes.get_title(loc="left") for axes in drawn][:2] == ["CC4", "CE4"]
    band = drawn[0].patches[-1]
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((6.45, 19.375))
    names = [label.get_text() for label in drawn[0].get_yticklabels()]
    assert (names[0], names[-1]) == ("nothing", "schema")
