"""The paper's rewards and the authors', against worked examples and plain Python."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain, combinations, permutations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from strategies import schemas

from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import RewardError
from causal_openlock.reward_table import RewardTable
from causal_openlock.rewards import PRESETS, TERMS, Events, Reward, find_reward
from causal_openlock.room import PAPER_POSITIONS, Layout
from causal_openlock.schema import DOOR, Schema
from causal_openlock.schema_file import bundled_schemas
from causal_openlock.tables import RoomTables

SCHEMAS = bundled_schemas()
LAYOUTS = {"CC3": "trial3", "CE3": "trial1", "CC4": "trial7", "CE4": "trial10"}


class Play:
    """A trial in one room, acted out by role; ``white`` is an inactive lever."""

    def __init__(
        self,
        reward: str | Iterable[str],
        schema: str | Schema = "CC4",
        action_limit: int | None = None,
    ) -> None:
        schema = SCHEMAS[schema] if isinstance(schema, str) else schema
        self.places = dict(zip(schema.levers, range(len(schema.levers)), strict=True))
        self.places["white"] = 6
        self.env = OpenLockEnv(
            schema,
            Layout(tuple(range(len(schema.levers)))),
            reward,
            action_limit=action_limit,
        )
        self.env.reset(seed=0)

    def attempt(self, words: str) -> list[float]:
        """The rewards of actions such as ``L0 -L0 door``: push L0, pull it back, push the door."""
        self.env.reset()
        return [float(self.env.step(self.action(word))[1]) for word in words.split()]

    def action(self, word: str) -> int:
        if word == DOOR:
            return 14
        return self.places[word.removeprefix("-")] + 7 * word.startswith("-")


# -- each term ------------------------------------------------------------------------------------


def test_basic_pays_10_for_unlocking_and_50_for_opening() -> None:
    assert Play("basic").attempt("L0 L1 door") == [0, 10, 50]
    assert Play("basic", "CE4").attempt("L3 L0 door") == [0, 10, 50]


def test_unlocking_pays_once_while_the_door_stays_unlocked() -> None:
    assert Play("basic").attempt("L0 L1 white") == [0, 10, 0]
    assert Play("basic").attempt("L0 L1 L2") == [0, 10, 0]
    assert Play("basic").attempt("L0 L1 -L0") == [0, 10, 0], "pulling L0 back does not lock"
    # Locked again and unlocked again is unlocked twice.
    play = Play("basic", action_limit=5)
    assert play.attempt("L0 L1 -L1 L1 door") == [0, 10, 0, 10, 50]


def test_basic_pays_a_repeated_solution_in_full() -> None:
    play = Play("basic")
    assert [play.attempt("L0 L1 door") for _ in range(2)] == [[0, 10, 50]] * 2


def test_unique_solutions_pays_a_solution_only_once_in_a_trial() -> None:
    play = Play("unique_solutions")
    assert play.attempt("L0 L1 door") == [0, 10, 50]
    assert play.attempt("L0 L1 door") == [0, 0, 0]
    assert play.attempt("L0 L2 door") == [0, 10, 50]
    assert play.attempt("L0 L1 white") == [0, 0, 0]
    play.env.reset(options={"new_trial": True})
    assert play.attempt("L0 L1 door") == [0, 10, 50]


def test_unlocking_without_opening_finds_nothing_and_so_stays_unique() -> None:
    play = Play("unique_solutions")
    assert [play.attempt("L0 L1 white") for _ in range(2)] == [[0, 10, 0]] * 2


def test_state_change_adds_a_half_to_whatever_changed_the_observation() -> None:
    play = Play("state_change")
    assert play.attempt("L0 L1 door") == [0.5, 10.5, 50.5]
    assert play.attempt("L1 L0 L0") == [0, 0.5, 0], "locked, free, pushed already"
    assert play.attempt("L0 -L0 door") == [0.5, 0.5, 0]


def test_negative_immovable_takes_a_half_where_nothing_moved_levers_and_door_alike() -> None:
    play = Play("negative_immovable")
    assert play.attempt("white L1 door") == [-0.5, -0.5, -0.5]
    assert play.attempt("-L0 L0 L0") == [-0.5, 0, -0.5]
    assert play.attempt("L0 L1 door") == [0, 10, 50]


def test_negative_repeat_takes_a_quarter_for_the_same_action_twice_in_a_row() -> None:
    play = Play("negative_repeat")
    assert play.attempt("L0 L0 L0") == [0, -0.25, -0.25]
    assert play.attempt("L0 white L0") == [0, 0, 0], "the attempt before does not count"
    assert play.attempt("door L0 -L0") == [0, 0, 0]


def test_partial_sequence_pays_1_for_a_first_action_that_begins_a_solution() -> None:
    terms = ["basic", "partial_sequence"]
    assert Play(terms).attempt("L0 L1 door") == [1, 10, 50]
    assert Play(terms).attempt("L1 L0 L1") == [0, 0, 10], "L1 is no first action"
    assert Play(terms).attempt("white L0 L1") == [0, 0, 10], "and L0 comes second here"
    assert Play(terms, "CE4").attempt("L2 L1 L0") == [1, 0, 10]


def test_partial_sequence_takes_the_place_of_state_change_on_a_first_move_and_only_there() -> None:
    # L2 of two_keys is a decoy: it moves and begins no solution.
    play = Play("partial_sequence", "two_keys")
    assert play.attempt("L0 L2 L1") == [1, 0.5, 10.5]
    assert play.attempt("L2 L0 L1") == [0.5, 0.5, 10.5]
    assert play.attempt("white L0 L1") == [0, 0.5, 10.5]


@pytest.mark.parametrize("name", ["CC3", "CE3", "CC4", "CE4"])
def test_exactly_one_of_partial_sequence_and_state_change_pays_for_a_first_move(name: str) -> None:
    for reward in ("partial_sequence", ["state_change", "partial_sequence"]):
        env = OpenLockEnv(name, LAYOUTS[name], reward)
        for action in range(15):
            before, _ = env.reset(seed=0)
            after, paid, *_ = env.step(action)
            assert paid == (1 if (after != before).any() else 0)


@pytest.mark.parametrize(("schema", "paths"), [("CC4", "L0 {}"), ("CE4", "{} L0")])
def test_solution_multiplier_pays_60_90_135_and_plain_60_for_a_repeat(
    schema: str, paths: str
) -> None:
    play = Play("solution_multiplier", schema)
    totals = [
        sum(play.attempt(f"{paths.format(lever)} door")) for lever in ("L2", "L2", "L1", "L2")
    ]
    assert totals == [60, 60, 90, 60]
    assert sum(play.attempt(f"{paths.format('L3')} door")) == 135


def test_solution_multiplier_raises_the_unlocking_and_the_opening_alike() -> None:
    play = Play("solution_multiplier")
    assert play.attempt("L0 L3 door") == [0, 10, 50]
    assert play.attempt("L0 L1 white") == [0, 15, 0]
    assert play.attempt("L0 L1 door") == [0, 15, 75]
    assert play.attempt("L0 L3 door") == [0, 10, 50]
    assert play.attempt("L0 L2 door") == [0, 22.5, 112.5]


def test_a_door_opened_with_more_levers_than_needed_is_no_new_solution() -> None:
    play = Play("solution_multiplier", action_limit=4)
    assert play.attempt("L0 L1 door") == [0, 10, 50]
    assert play.attempt("L0 L2 L3 door") == [0, 15, 0, 50]
    assert Play("unique_solutions", action_limit=4).attempt("L0 L2 L3 door") == [0, 10, 0, 0]


def test_the_papers_best_combination_on_worked_attempts() -> None:
    play = Play("paper")
    assert play.attempt("white L1 door") == [-0.5, -0.5, -0.5]
    assert play.attempt("L0 L1 white") == [1, 10, -0.5]
    assert play.attempt("L0 L1 door") == [1, 10, 50]
    assert play.attempt("L0 L1 door") == [1, 10, 50]
    assert play.attempt("L0 L2 door") == [1, 15, 75]
    assert play.attempt("L0 L0 L3") == [1, -0.5, 22.5]
    assert play.attempt("L0 L3 door") == [1, 22.5, 112.5]


def test_a_noisy_room_that_does_not_obey_pays_as_for_nothing_moved() -> None:
    env = OpenLockEnv("noisy_CC3", "trial1", "negative_immovable", action_limit=10)
    root, leaf = 0, 4
    rewards = []
    for seed in range(20):
        env.reset(seed=seed)
        env.step(root)
        pushed = False
        while not pushed:
            seen, paid, *_ = env.step(leaf)
            pushed = bool(seen[leaf])
            assert paid == (10 if pushed else -0.5)
            rewards.append(paid)
    assert rewards.count(-0.5) > 0


# -- the paper's terms, written once more in plain Python -----------------------------------------


def plain_paper_rewards(
    schema: Schema, terms: Sequence[str], words: Sequence[str], found: frozenset[frozenset[str]]
) -> list[float]:
    """Rewards of one attempt in a room that leaves nothing to chance, until it is over."""

    def holds(node: str, pushed: set[str]) -> bool:
        causes = schema.causes(node)
        return not causes or sum(c in pushed for c in causes) >= schema.threshold(node)

    def pushable_first(lever: str) -> bool:
        for solution in schema.solutions:
            for order in permutations(solution):
                done: set[str] = set()
                for step in order:
                    if not holds(step, done):
                        break
                    done.add(step)
                else:
                    if order[0] == lever:
                        return True
        return False

    solutions = [frozenset(solution) for solution in schema.solutions]
    pushed: set[str] = set()
    rewards = []
    for moment, word in enumerate(words):
        locked = not holds(DOOR, pushed)
        lever, pull = word.removeprefix("-"), word.startswith("-")
        opens = word == DOOR and not locked
        changed = opens
        if lever in schema.levers and holds(lever, pushed) and pull == (lever in pushed):
            pushed ^= {lever}
            changed = True
        unlocks = locked and holds(DOOR, pushed)
        stands = frozenset(pushed - set(schema.inert))
        new = (unlocks or opens) and stands in solutions and stands not in found
        begins = moment == 0 and changed and not pull and pushable_first(lever)
        paid = 10.0 * unlocks + 50.0 * opens
        total = 0.0
        for term in terms:
            if term == "basic":
                total += paid
            elif term == "unique_solutions":
                total -= 0 if new else paid
            elif term == "state_change":
                if changed and not (begins and "partial_sequence" in terms):
                    total += 0.5
            elif term == "negative_immovable":
                total -= 0 if changed else 0.5
            elif term == "negative_repeat":
                total -= 0.25 if moment and word == words[moment - 1] else 0
            elif term == "partial_sequence":
                total += 1 if begins else 0
            elif term == "solution_multiplier":
                total += paid * (1.5 ** len(found) - 1) if new else 0
            else:
                raise AssertionError(term)
        rewards.append(total)
        if opens:
            break
    return rewards


@given(
    schema=schemas(max_levers=5),
    terms=st.lists(st.sampled_from(sorted(TERMS)), min_size=1, unique=True),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=60, deadline=None)
def test_terms_pay_what_plain_python_pays_in_any_schema_after_any_history(
    schema: Schema, terms: list[str], seed: int
) -> None:
    generator = np.random.default_rng(seed)
    tables = RoomTables(7)
    limit = schema.least_action_limit + 1
    layout = Layout.random(schema, generator)
    tables.add([(schema, layout, limit)])
    table = RewardTable(find_reward(terms), tables)
    word_of = [
        *(f"{sign}{place}" for sign in ("", "-") for place in range(7)),
        DOOR,
    ]
    for lever, place in zip(schema.levers, layout.places, strict=True):
        word_of[place], word_of[7 + place] = lever, f"-{lever}"
    # Active levers, pushes and the door more often than chance would have them.
    useful = [*layout.places, *layout.places, 14, *(7 + place for place in layout.places)]
    for _ in range(10):
        found = generator.random(len(schema.solutions)) < 0.4
        row, previous = tables.start[:1], -1
        actions, paid = [], []
        for _ in range(limit):
            action = int(generator.choice(useful if generator.random() < 0.8 else 15))
            if generator.random() < 0.1 and actions:
                action = actions[-1]
            row, reward = pay(table, row, [action], [previous], found[None])
            previous = action
            actions.append(action)
            paid.append(float(reward[0]))
            if tables.over[row[0]]:
                break
        expected = plain_paper_rewards(
            schema,
            terms,
            [word_of[action] for action in actions],
            frozenset(
                frozenset(solution)
                for solution, known in zip(schema.solutions, found, strict=True)
                if known
            ),
        )
        assert paid == pytest.approx(expected)


def pay(
    table: RewardTable,
    row: np.ndarray,
    action: Sequence[int] | np.ndarray,
    previous: Sequence[int] | np.ndarray,
    found: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """The rows after some actions that take effect, and the rewards for them."""
    tables = table.tables
    choice = tables.choice(row, np.asarray(action))
    after, _ = tables.step(choice, np.zeros(len(choice)))
    experienced = np.flatnonzero(tables.unlocked[after] & found.any(axis=1))
    return after, table.pay(choice, after, np.asarray(previous), found, experienced)


# -- the authors' program, written once more in plain Python --------------------------------------

AUTHORS_MODES = [
    "basic",
    "change_state",
    "unique_solutions",
    "change_state_unique_solutions",
    "negative_immovable",
    "negative_immovable_unique_solutions",
    "negative_immovable_negative_repeat",
    "negative_immovable_partial_action_seq",
    "negative_immovable_solution_multiplier",
    "negative_immovable_partial_action_seq_solution_multiplier",
]


@dataclass(frozen=True)
class Happened:
    """What one action of the authors' program led to; names of actions are positions."""

    so_far: tuple[str, ...]
    white: bool
    changed: bool
    unlocked: bool


def authors_room(name: str) -> tuple[list[list[Happened]], list[tuple[str, ...]]]:
    """Every sequence of three actions in a room of the authors, and the room's solutions."""
    common_cause = name.startswith("CC")
    roles = Layout.of(SCHEMAS[name], LAYOUTS[name]).as_mapping(SCHEMAS[name])
    place_of = [roles[role] for role in sorted(roles)]
    root, others = place_of[0], place_of[1:]
    # As the program's: every push, then every pull, then the door.
    names = [f"{verb} {place}" for verb in ("push", "pull") for place in PAPER_POSITIONS]
    names.append("push door")
    sequences = []
    for sequence in product(names, repeat=3):
        out: set[str] = set()
        steps = []
        for moment, action in enumerate(sequence):
            verb, place = action.split()
            if common_cause:
                free = place == root or (place in others and root in out)
            else:
                free = place in others or (place == root and bool(out & set(others)))
            moves = free and (verb == "push") == (place not in out)
            if moves:
                out ^= {place}
            unlocked = bool(out & set(others)) if common_cause else root in out
            steps.append(
                Happened(
                    so_far=sequence[: moment + 1],
                    white=place != DOOR and place not in place_of,
                    changed=moves or (place == DOOR and unlocked),
                    unlocked=unlocked,
                )
            )
        sequences.append(steps)
    solutions = [
        (f"push {root}", f"push {other}", "push door")
        if common_cause
        else (f"push {other}", f"push {root}", "push door")
        for other in others
    ]
    return sequences, solutions


def authors_reward(
    mode: str,
    happened: Happened,
    solutions: list[tuple[str, ...]],
    found: list[tuple[str, ...]],
) -> float:
    """The ladder of section 3.1 of the notes on the authors' environment: the first rung pays."""
    so_far = happened.so_far
    if len(so_far) == 3:
        unique = so_far in solutions and so_far not in found
    else:
        unique = all(solution[: len(so_far)] != so_far for solution in found)
    partial = any(solution[: len(so_far)] == so_far for solution in solutions)
    repeat = len(so_far) > 1 and so_far[-1] == so_far[-2]
    opened = happened.unlocked and so_far[-1] == "push door"
    factor = max(1, 1.5 * len(found))
    if mode.endswith("solution_multiplier"):
        if opened:
            return 50 * factor if unique else 50
        if happened.unlocked:
            return 10 * factor if unique else 10
    elif mode.endswith("unique_solutions"):
        if opened and unique:
            return 50
        if happened.unlocked and unique:
            return 10
    elif opened:
        return 50
    elif happened.unlocked:
        return 10
    if "partial_action_seq" in mode and partial:
        return 1
    if mode.startswith("change_state") and happened.changed:
        return 0.5
    if mode.endswith("negative_repeat") and repeat:
        return -0.25
    if mode.startswith("negative_immovable") and happened.white:
        return -0.5
    return 0


@cache
def all_sequences(name: str) -> tuple[np.ndarray, list[list[Happened]], list[tuple[str, ...]]]:
    return np.array(list(product(range(15), repeat=3))), *authors_room(name)


def some_sets(solutions: int) -> list[tuple[int, ...]]:
    """Every set of solutions found before, the empty and the full one included."""
    return list(
        chain.from_iterable(combinations(range(solutions), k) for k in range(solutions + 1))
    )


def table_rewards(name: str, reward: str, found: Sequence[int]) -> np.ndarray:
    """``[3375, 3]`` what every sequence of three actions is paid."""
    tables = RoomTables(7)
    schema = SCHEMAS[name]
    tables.add([(schema, Layout.of(schema, LAYOUTS[name]), 3)])
    table = RewardTable(find_reward(reward), tables)
    sequences, *_ = all_sequences(name)
    known = np.zeros((len(sequences), len(schema.solutions)), dtype=bool)
    known[:, list(found)] = True
    row = np.repeat(tables.start, len(sequences))
    previous = np.full(len(sequences), -1)
    paid = []
    for action in sequences.T:
        row, reward_then = pay(table, row, action, previous, known)
        previous = action
        paid.append(reward_then)
    return np.stack(paid, axis=1)


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("mode", AUTHORS_MODES)
def test_the_authors_presets_pay_what_their_program_paid_for_every_sequence(
    name: str, mode: str
) -> None:
    _, happened, solutions = all_sequences(name)
    # Solution k of the schema is the one with the k-th other lever, as here.
    for which in some_sets(len(solutions)):
        found = [solutions[index] for index in which]
        expected = [
            [authors_reward(mode, step, solutions, found) for step in steps] for steps in happened
        ]
        paid = table_rewards(name, f"authors_2018_{mode}", which)
        np.testing.assert_array_equal(paid, expected, err_msg=f"found before: {which}")


def test_the_authors_room_behind_this_has_as_many_ways_to_open_as_it_has_solutions() -> None:
    for name in LAYOUTS:
        _, happened, solutions = all_sequences(name)
        opening = [
            steps[-1].so_far
            for steps in happened
            if steps[-1].unlocked and steps[-1].so_far[-1] == "push door"
        ]
        assert sorted(opening) == sorted(solutions)
        assert len(solutions) == int(name[-1]) - 1


def test_every_mode_of_the_authors_is_a_preset_and_their_best_one_has_a_short_name() -> None:
    presets = {name for name in PRESETS if name.startswith("authors_2018_")}
    assert presets == {f"authors_2018_{mode}" for mode in AUTHORS_MODES}
    for which in ((), (0,), (0, 2)):
        np.testing.assert_array_equal(
            table_rewards("CC4", "authors_2018", which),
            table_rewards("CC4", f"authors_2018_{AUTHORS_MODES[-1]}", which),
        )


def test_the_authors_multiplier_pays_60_90_180() -> None:
    play = Play("authors_2018_negative_immovable_solution_multiplier")
    totals = [sum(play.attempt(f"L0 {lever} door")) for lever in ("L1", "L2", "L1", "L3")]
    assert totals == [60, 90, 60, 180]
    play = Play("authors_2018")
    totals = [sum(play.attempt(f"L0 {lever} door")) for lever in ("L1", "L2", "L1", "L3")]
    assert totals == [61, 91, 61, 181]


def test_the_authors_pay_10_for_every_action_that_leaves_the_door_unlocked() -> None:
    assert Play("authors_2018_basic").attempt("L0 L1 white") == [0, 10, 10]
    assert Play("basic").attempt("L0 L1 white") == [0, 10, 0]


def test_to_the_authors_only_a_white_lever_is_immovable() -> None:
    play = Play("authors_2018_negative_immovable")
    assert play.attempt("white L1 door") == [-0.5, 0, 0]
    assert play.attempt("L0 L0 L0") == [0, 0, 0]
    assert Play("negative_immovable").attempt("white L1 door") == [-0.5, -0.5, -0.5]


def test_a_rung_of_the_authors_ladder_hides_those_below_it() -> None:
    play = Play("authors_2018_negative_immovable_negative_repeat")
    assert play.attempt("white white L0") == [-0.5, -0.25, 0]
    assert Play("authors_2018_change_state").attempt("L0 L1 door") == [0.5, 10, 50]


# -- the table of rewards, and the reward function itself -----------------------------------------


@pytest.mark.parametrize("reward", PRESETS)
@given(data=st.data(), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=6, deadline=None)
def test_the_table_pays_what_the_reward_function_pays(
    reward: str, data: st.DataObject, seed: int
) -> None:
    """In rooms that obey and rooms that do not, with repeats and with every history."""
    generator = np.random.default_rng(seed)
    chosen = [
        SCHEMAS["CC4"],
        SCHEMAS[data.draw(st.sampled_from(sorted(SCHEMAS)))],
        data.draw(schemas(max_levers=5, stochastic=data.draw(st.booleans()))),
    ]
    tables = RoomTables(7)
    table = RewardTable(find_reward(reward), tables)
    many = 300
    # Rooms are added one by one, so the table must take them in while it is in use.
    for schema in chosen:
        limit = schema.least_action_limit + int(generator.integers(2))
        tables.add([(schema, Layout.random(schema, generator), limit)])
        room = generator.integers(len(tables.rooms), size=many)
        found = generator.random((many, tables.begins.shape[1])) < 0.3
        found &= np.arange(found.shape[1]) < tables.solutions[room][:, None]
        row, previous = tables.start[room], np.full(many, -1)
        for _ in range(12):
            action = generator.integers(15, size=many)
            repeat = (generator.random(many) < 0.2) & (previous >= 0)
            action = np.where(repeat, previous, action)
            choice = tables.choice(row, action)
            after, _ = tables.step(choice, generator.random(many))
            experienced = np.flatnonzero(tables.unlocked[after] & found.any(axis=1))
            paid = table.pay(choice, after, previous, found, experienced)
            events = Events.of(tables, row, action, after)
            events = events.with_history(tables, after, action == previous, found)
            expected = np.where(tables.over[row], 0.0, table.reward.pay(events))
            np.testing.assert_array_equal(paid, expected)
            previous = np.where(tables.over[after] | tables.over[row], -1, action)
            row = after


def test_putting_a_room_back_pays_nothing() -> None:
    for reward in PRESETS:
        tables = RoomTables(7)
        tables.add([(SCHEMAS["CC3"], Layout.of(SCHEMAS["CC3"], "trial1"), 3)])
        over = np.repeat(np.flatnonzero(tables.over), 15)
        table = RewardTable(find_reward(reward), tables)
        action = np.tile(np.arange(15), len(over) // 15)
        found = np.ones((len(over), 2), dtype=bool)
        after, paid = pay(table, over, action, action, found)
        assert (after == tables.start[0]).all()
        assert not paid.any()


# -- names ----------------------------------------------------------------------------------------


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


def test_the_terms_of_a_reward_add_up_in_any_order() -> None:
    for terms in (["basic", "state_change", "partial_sequence"], ["negative_repeat", "basic"]):
        plays = [Play(order) for order in permutations(terms)]
        for words in ("L0 L1 door", "L1 L1 L0", "white white L0"):
            rewards = [play.attempt(words) for play in plays]
            assert all(reward == rewards[0] for reward in rewards)


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
