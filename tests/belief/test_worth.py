"""What knowing the schema is worth, against a plain search over policies that shares no code."""

from __future__ import annotations

from functools import cache
from itertools import combinations, permutations

import pytest

import causal_openlock as ol
from causal_openlock.belief.optimal import OneAttemptAhead, Optimum
from causal_openlock.belief.placements import mixture
from causal_openlock.belief.possible_schemas import possible_schemas
from causal_openlock.errors import OpenLockError
from support.command import at_once

BRANCHES = "A -> B; B -> door; C -> door"


# -- an independent way ----------------------------------------------------------------------------


def rooms_of(name, positions):
    """Every placement of a schema, each lever and the door as a function of the pushed levers."""
    schema = ol.schema(name)
    found = []
    for slots in combinations(range(positions), len(schema.levers)):
        for order in permutations(slots):
            place = dict(zip(schema.levers, order, strict=True))
            rules = [(frozenset([lever]), 1) for lever in range(positions)]  # never: itself
            for node in (*schema.levers, "door"):
                causes = frozenset(place[cause] for cause in schema.causes(node))
                rule = (causes, schema.threshold(node)) if causes else (causes, 0)
                if node == "door":
                    rules.append(rule)
                else:
                    rules[place[node]] = rule
            solutions = frozenset(frozenset(place[a] for a in one) for one in schema.solutions)
            inert = frozenset(place[lever] for lever in schema.inert)
            found.append((tuple(rules), solutions, inert))
    return found


def least_attempts(weights, limit, positions=3, find=None, lock_seen=True):
    """Least expected attempts, by every push, every pull and the door; no symmetry and no bound.

    A belief is a tuple of rooms with their probabilities.
    """
    start = []
    for name, weight in weights.items():
        rooms = rooms_of(name, positions)
        start += [(room, weight / len(rooms) / sum(weights.values())) for room in rooms]
    find = find or len(start[0][0][1])

    def live(room, node, pushed):
        causes, enough = room[0][node]
        return len(causes & pushed) >= enough

    def split(belief, seen_in):
        parts = {}
        for room, weight in belief:
            parts.setdefault(seen_in(room), []).append((room, weight))
        return [(seen, tuple(part)) for seen, part in parts.items()]

    @cache
    def attempts(belief, found):
        if len(found) >= find:
            return 0.0
        return sum(weight for _, weight in belief) + rest(belief, found, frozenset(), limit, True)

    @cache
    def rest(belief, found, pushed, left, nothing_new):
        """Attempts after this one; an attempt that shows nothing is never the best."""
        if not left:
            return float("inf") if nothing_new else attempts(belief, found)

        def push(lever):
            def seen_in(room):
                after = pushed ^ {lever} if live(room, lever, pushed) else pushed
                return after, lock_seen and live(room, -1, after)

            return sum(
                rest(part, found, after, left - 1, nothing_new and part == belief)
                for (after, _), part in split(belief, seen_in)
            )

        def door():
            def seen_in(room):
                solutions = room[1] - {levers - room[2] for levers in found}
                return live(room, -1, pushed) and 1 + (pushed - room[2] in solutions)

            value = 0.0
            for seen, part in split(belief, seen_in):
                same = nothing_new and part == belief and seen != 2
                now = found | {pushed} if seen == 2 else found
                value += rest(part, now, pushed, 0 if seen else left - 1, same)
            return value

        return min(door(), *map(push, range(positions)))

    return attempts(tuple(start), frozenset())


@pytest.mark.parametrize(
    ("first", "among", "options"),
    [
        ("CC3", "CE3", {}),
        ("CC3", "CE3", {"lock_seen": False}),
        ("CC3", "CE3", {"action_limit": 4}),
        ("CC3", "A -> door; B -> C; C -> door", {"action_limit": 4, "lock_seen": False}),
        (BRANCHES, {"CC3": 2.0, "A -> B; C -> B; B -> door; A -> door": 0.5}, {}),
        ("A -> door; B -> C; C -> door", "A -> B; B -> door; C -> door", {"action_limit": 5}),
        ("A -> B; B -> door", "A & B -> door", {"levers_known": False, "lock_seen": False}),
    ],
)
def test_a_plain_search_over_policies_agrees(monkeypatch, first, among, options):
    monkeypatch.setattr("causal_openlock.belief.worth.POSITIONS", 3)
    found = ol.schema_worth(first, among, **options)
    weights = dict(found.among)
    limit, seen = found.action_limit, found.lock_seen
    positions = len(found.schema.levers) if found.levers_known else 3
    for find, least in enumerate(found.unknown.until, 1):
        own = {name: least_attempts({name: 1.0}, limit, positions, find, seen) for name in weights}
        known = sum(chance * own[name] for name, chance in weights.items())
        unknown = least_attempts(weights, limit, positions, find, seen)
        assert found.known.until[find - 1] == pytest.approx(known, abs=1e-9)
        assert least == pytest.approx(unknown, abs=1e-9)
    assert found.worth == pytest.approx(unknown - known, abs=1e-9)


@pytest.mark.parametrize("limit", [3, 4])
def test_every_schema_of_three_levers_agrees(limit):
    found = ol.schema_worth("CC3", "all", action_limit=limit)
    unknown = least_attempts(dict(found.among), limit)
    known = sum(chance * least_attempts({one: 1.0}, limit) for one, chance in found.among)
    assert (found.known.upper, found.unknown.upper) == pytest.approx((known, unknown), abs=1e-9)


# -- figures, bounds and options -------------------------------------------------------------------


def test_the_schema_of_the_paper_is_worth_an_eighth_of_an_attempt():
    found = ol.schema_worth("CC4", "CE4")
    assert (found.known.upper, found.unknown.upper, found.worth) == (3.75, 3.875, 0.125)
    assert found.known.each == found.here_least == (1.75, 1, 1)
    assert found.unknown.each == (1.75, 1.125, 1)  # nothing at the first solution
    assert found.here_most == (1.75, 1.25, 1)
    assert found.unknown.until == (1.75, 2.875, 3.875)
    assert found.states == found.known.states + found.unknown.states > 50
    assert ol.schema_worth("CC3", "CE3").worth == pytest.approx(1 / 6)


def test_means_over_schemas_are_the_whole():
    found = ol.schema_worth("CC4", {"CE4": 3.0}, lock_seen=False)
    assert [chance for _, chance in found.among] == [0.25, 0.75]
    assert sum(found.unknown.each) == pytest.approx(found.unknown.upper)
    other = ol.schema_worth("CE4", {"CC4": 1.0, "CE4": 3.0}, lock_seen=False)
    assert other.worth == pytest.approx(found.worth)
    whole = 0.25 * sum(found.here_least) + 0.75 * sum(other.here_most)
    assert whole == pytest.approx(found.unknown.upper)


@pytest.mark.parametrize(
    ("name", "among", "positions"),
    [("CC3", "all", None), ("CC3", "CE3", 7), ("CC4", "CE4", 7), ("two_keys", "all", None)],
)
@pytest.mark.parametrize("lock_seen", [True, False])
def test_bounds_hold_where_the_optimum_is_known(name, among, positions, lock_seen):
    schemas = possible_schemas(ol.schema(name), among, 3)
    hypotheses, weight = mixture(schemas, 3, positions)
    options = {"lock_seen": lock_seen, "node_limit": 100_000}
    exact = Optimum(hypotheses, weight, 3, **options).attempts()
    ahead = OneAttemptAhead(hypotheses, weight, 3, **options)
    assert ahead.attempts() <= exact + 1e-9
    for bit in (0.0, 0.3):
        policy = OneAttemptAhead(hypotheses, weight, 3, **options)
        policy.worth_of_a_bit = bit
        everyone = Optimum(hypotheses, weight, 3, **options)
        mean = policy.split(lambda possible, _, all=everyone: (all._weight(possible),))
        assert exact - 1e-9 <= mean[0] < exact + 1.0


def test_too_large_a_search_gives_bounds_by_name():
    exact = ol.schema_worth("CC4", "CE4", levers_known=False)
    found = ol.schema_worth("CC4", "CE4", levers_known=False, most_states=400)
    assert (exact.exact, found.exact) == (True, False)
    low, high = found.bounds
    assert low <= exact.worth <= high < low + 0.5
    assert "0.000 to 0.118 attempts" in str(found)
    assert found.table["attempts"].tolist() == [
        "until all solutions, at least",
        "until all solutions, at most",
    ]
    with pytest.raises(OpenLockError, match=r"between 0\.000 and 0\.118 attempts"):
        _ = found.worth


def test_all_schemas_are_listed_once_and_the_room_s_own_is_first():
    names = [one for one, _ in possible_schemas(ol.schema("CC3"), "all", 3)]
    assert len(names) == 12
    assert names[0] == ol.schema("CC3")
    chances = [chance for _, chance in possible_schemas(ol.schema("CE4"), "grammar", 3)]
    assert len(chances) == 44
    assert sum(chances) == pytest.approx(1)


def test_known_rooms_sharpen_the_grammar():
    own = [
        possible_schemas(ol.schema("CC4"), "grammar", 3, after=before)[0][1]
        for before in ([], ["CC3"], ["CC3"] * 5)
    ]
    assert own == sorted(own)
    stubborn = possible_schemas(ol.schema("CC4"), "grammar", 3, 100.0, ["CC3"])
    assert own[0] < stubborn[0][1] < own[1]
    worth = [ol.schema_worth("CC3", "grammar", after=before).worth for before in ([], ["CC3"] * 5)]
    assert worth[0] > worth[1]


@pytest.mark.parametrize(
    ("schema", "options", "message"),
    [
        ("CC4", {"among": "CE3"}, "CE3 has 3 levers and 2 solutions, CC4 has 4 and 3"),
        ("CC4", {"among": "CEE4"}, "did you mean CE4"),
        ("CC4", {"among": {"CE4": 0.0}}, "the weight of CE4 has to be more than 0"),
        ("seven", {}, "seven has 7 levers"),
        ("noisy_CC3", {}, "noisy_CC3 has strengths below 1"),
        ("CC4", {"action_limit": 2}, "CC4 needs attempts of 3 actions, and the limit is 2"),
        ("CC4", {"among": "CE4", "after": ["CC3"]}, "the prior of the grammar alone"),
        ("CC4", {"among": "grammar", "concentration": 0.0}, "concentration has to be more than 0"),
        ("CC4", {"among": "CE4", "most_states": 10}, "even bounds take more than 10 states"),
        ("CC4", {"among": "CE4", "most_states": 0}, "most_states"),
    ],
)
def test_a_mistake_is_one_sentence(schema, options, message):
    with pytest.raises(OpenLockError, match=message) as error:
        ol.schema_worth(schema, **options)
    assert "\n" not in str(error.value)


def test_the_command_prints_the_table(tmp_path):
    done = at_once("schema", "worth", "CC4", "--among", "CE4=1", cwd=tmp_path)
    assert done.status == 0
    assert [line.split()[-3:] for line in done.stdout.splitlines()[1:5]] == [
        ["3.750", "3.875", "0.125"],
        ["1.750", "1.750", "0.000"],
        ["1.000", "1.125", "0.125"],
        ["1.000", "1.000", "0.000"],
    ]
    assert "0.125 attempts, exact." in done.stdout
    assert "States searched: 94." in done.stdout
    words = ("--lock-unseen", "--action-limit", "3", "--levers-unknown")
    done = at_once("schema", "worth", "CC3", "-a", "CE3", *words, cwd=tmp_path)
    assert "active levers unknown, lock unseen, 3 actions" in done.stdout.replace("\n", " ")
    done = at_once("schema", "worth", "CC4", "-a", "CE3", cwd=tmp_path)
    assert (done.status, len(done.stderr.splitlines())) == (2, 1)
