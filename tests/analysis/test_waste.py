"""What attempts were worth: exact, and the same for whoever made them."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
import pytest

from causal_openlock import Condition, Layout, find_schema
from causal_openlock.analysis.results.bounds import ideal_attempts
from causal_openlock.analysis.topics.regret import regret
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topics.regret import WORTH, regret_by_condition
from causal_openlock.belief.observer import Observer, observer_of
from causal_openlock.belief.placements import TooLargeError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.schemas.schema import Schema
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import spec, stored
from support.played_material import played


@pytest.mark.parametrize("schema", ["CC3", "CE3", "CC4", "CE4"])
def test_regret_is_what_attempts_are_beyond_the_ideal_observers(schema: str) -> None:
    """Over every place of the levers, the attempts of a fixed habit are the least plus its regret.

    The habit pushes two grey levers and the door, each pair in turn: all luck is averaged out, as
    each placement is as likely as any other.
    """
    found = find_schema(schema)
    observer, levers = Observer(found, 3), len(found.levers)
    habit = [[a, b, 14] for a, b in product(range(levers), repeat=2) if a != b]
    total, regrets, seen = 0, 0.0, set()
    for places in permutations(range(levers)):
        layout = Layout(places)
        if (truth := observer._truth(places)) in seen:
            continue
        seen.add(truth)
        worths = observer.trial(layout, habit)
        total += len(worths)
        regrets += sum(worth.regret for worth in worths)
    least = ideal_attempts(found, 3)
    assert least is not None
    assert total / len(seen) == pytest.approx(least + regrets / len(seen), abs=1e-9)
    assert regrets > 0


def test_regret_of_a_trial_that_was_not_solved_counts_what_would_still_have_been_needed() -> None:
    """At most three attempts: on average they and what is still needed, beyond the least."""
    observer = Observer(find_schema("CC3"), 3)
    habit = [[0, 1, 14], [1, 0, 14], [0, 1, 14]]
    total, regrets, seen = 0.0, 0.0, set()
    for places in permutations(range(3)):
        if (truth := observer._truth(places)) in seen:
            continue
        seen.add(truth)
        worths = observer.trial(Layout(places), habit)
        regrets += sum(worth.regret for worth in worths)
        point, slots = observer._optimum.start, observer._slots(Layout(places))
        for actions in habit[: len(worths)]:
            _, point = observer._attempt(truth, point, tuple(slots[one] for one in actions))
        needed = 1 + observer._optimum.value(point) if len(point.found) < 2 else 0
        total += len(worths) + needed
    least = ideal_attempts(find_schema("CC3"), 3)
    assert least is not None
    assert regrets / len(seen) == pytest.approx(total / len(seen) - least, abs=1e-9)


def test_the_ideal_observer_wastes_nothing_and_random_actions_nearly_everything() -> None:
    ideal = regret(played("ideal", "CC3-CE4", "CE4"))
    assert ideal["regret"].max() == 0.0
    trials = ideal.groupby(["condition", "subject", "phase", "trial"], observed=True)
    # What is gained in a trial of the ideal observer is what it did not know, or it had luck.
    assert (trials["gained"].sum() <= 2.0 + 1e-9).all()
    random = regret(played("random", "CC3-CE4"))
    row = regret_by_condition(random).iloc[0]
    assert row["regret"] > 20
    assert row["useless"] > 0.8
    assert row["information"] < row["best"]
    assert (random["useless"] <= random["used"]).all()
    assert (random["expected"] <= random["best"] + 1e-9).all()


def test_information_and_useless_actions_by_hand() -> None:
    """CC3: three levers, one of which frees the two others; log2 3 bits are missing."""
    observer = Observer(find_schema("CC3"), 3)
    layout = Layout((2, 4, 6))
    first, same, pull, rest = observer.trial(layout, [[4, 4, 0], [4, 4, 4], [11, 2, 9], [2, 4, 14]])
    third = np.log2(3) - 1
    # Lever 4 does not move: it is no cause, and one of two is left. Then nothing is to be learned
    # from it, nor from a white lever; but the others could have told which of them it is.
    assert first.gained == pytest.approx(third)
    assert first.expected == pytest.approx(np.log2(3) - 2 / 3)
    assert (first.used, first.useless) == (3, 2)
    assert first.best == pytest.approx(np.log2(3) - 2 / 3 + 2)
    assert (same.gained, same.useless, same.regret) == (0.0, 3, 1.0)
    assert pull.gained == pytest.approx(1.0)
    assert pull.useless >= 1
    assert (rest.useless, rest.gained, rest.regret) == (0, 0.0, 0.0)


def test_what_cannot_be_judged_is_left_out() -> None:
    shaky = Schema("shaky", ["a", "b"], {"a": {"b": 0.5}, "b": ["door"]})
    assert observer_of(shaky, 3) is None
    chain = Schema("long", [f"l{n}" for n in range(9)], {f"l{n}": ["door"] for n in range(9)})
    assert observer_of(chain, 2) is not None
    rows = trial_rows([0, 1, 2, 3], layout="nowhere")
    experiment = Experiment(
        "fabricated", "", 1, 1, (Condition.named("CC4", find_schema),), (spec("a"),)
    )
    material = Material.of(table(rows), stored(experiment))
    assert regret(material).empty
    assert regret_by_condition(regret(material)).empty


def test_a_schema_that_play_leads_out_of_reach_is_left_out_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    material = played("random", "CC3", "CE3")
    whole = regret(material)
    trial, asked = Observer.trial, []

    def out_of_reach(self: Observer, *given: object) -> object:
        asked.append(self)
        if self is observer_of(find_schema("CC3"), 3) and asked.count(self) == 2:
            raise TooLargeError("more than 20,000 states")
        return trial(self, *given)

    monkeypatch.setattr(Observer, "trial", out_of_reach)
    left = regret(material)
    expected = whole[whole["schema"] == "CE3"].reset_index(drop=True)
    assert not left.empty
    assert (left[WORTH] == expected[WORTH]).all(axis=None)
    assert set(left["schema"]) == {"CE3"}
