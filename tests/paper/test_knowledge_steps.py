"""What each piece of knowledge saves: by enumeration, as stored, and next to people's rooms."""

from itertools import product

import pandas as pd
import pytest
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.paper.knowledge import SEARCHES, peoples_rooms
from support.places import ROOT

STORED = ROOT / "evidence" / "worth"


def solves(schema, sequence):
    """Whether some moves open the door: a lever moves if enough of its causes are pushed."""
    pushed = set()
    for verb, lever in sequence:
        if lever == "door":
            return pushed in [{*solution} for solution in schema.solutions]
        if lever not in schema.levers:
            continue
        causes = schema.causes(lever)
        if not causes or sum(one in pushed for one in causes) >= schema.threshold(lever):
            pushed = pushed | {lever} if verb == "push" else pushed - {lever}
    return False


@pytest.mark.parametrize("name", ["CC3", "CE3", "CC4", "CE4"])
def test_sequences_of_three_actions_are_counted_right(name):
    schema = ol.schema(name)
    white = [f"white{number}" for number in range(7 - len(schema.levers))]
    moves = [(verb, lever) for verb in ("push", "pull") for lever in (*schema.levers, *white)]
    every = [*product([*moves, ("push", "door")], repeat=3)]
    pushes = [one for one in every if all(verb == "push" for verb, _ in one)]
    door = ("push", "door")
    last = [one for one in pushes if one[2] == door and door not in one[:2] and one[0] != one[1]]
    active = [one for one in last if {one[0][1], one[1][1]} <= {*schema.levers}]
    counts = [find(len(schema.levers)) for find in SEARCHES.values()]
    assert counts == [len(every), len(pushes), len(last), len(active)]
    good = [one for one in every if solves(schema, one)]
    assert len(good) == len(schema.solutions)
    assert {*good} <= {*active}


def test_the_stored_steps_are_those_that_are_computed():
    stored = pd.read_csv(STORED / "steps.csv")
    own = ol.knowledge_steps(["CC3", "CE3", "CE3"])  # a condition counts once
    again = stored[stored["condition"].isin(["CC3", "CE3"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(again, own, atol=1e-9)
    pd.testing.assert_frame_equal(pd.read_csv(STORED / "people.csv"), peoples_rooms())


def test_the_figure_has_peoples_rooms_as_a_band():
    drawn = ol.plot_knowledge_steps(pd.read_csv(STORED / "steps.csv"), ax=Figure())
    assert [axes.get_title(loc="left") for axes in drawn][:2] == ["CC4", "CE4"]
    band = drawn[0].patches[-1]
    assert (band.get_x(), band.get_x() + band.get_width()) == pytest.approx((6.45, 19.375))
    names = [label.get_text() for label in drawn[0].get_yticklabels()]
    assert (names[0], names[-1]) == ("nothing", "schema")
