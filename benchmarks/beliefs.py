"""Beliefs: whole subjects of the Bayesian learner, their posteriors against pgmpy's, single plans.

A subject plays all six conditions of the paper. What is enumerated and planned once serves every
later subject of a process, so that the first subjects pay for all: each measurement is a process of
its own, and more subjects than are measured here only do better. Run as a script, this file is that
process: ``python benchmarks/beliefs.py 1000`` plays the thousand subjects of the target. Their
seconds are those of the processor, which say what one core of one's own would take.

The peer of posteriors is pgmpy: the hypotheses are the states of one variable of a network, what is
seen is its child, and the posterior is asked of ``VariableElimination``. As a learner needs a
posterior after every action, there is a network for each; its tables of likelihoods are given to
the peer and not counted, while ours are.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from statistics import median
from typing import Any

from measure import Measurement, Row, Target, in_turns, stopwatch

CELL = 40  # subjects at once, as in an experiment
SUBJECTS = 3 * CELL
TARGET = Target("at least", 1000 / 180, on="ours")  # 1,000 subjects in three minutes
SEED = 2018
PEER = "pgmpy"
ACTIONS = 12
NEAR = 1e-9
PLANNED = (56, 200, 600)
PLANS = 5


def beliefs(repeats: int) -> Iterator[Row]:
    """Subjects, updates of posteriors, and plans."""
    yield _whole_subjects(repeats)
    yield from _posteriors(repeats)
    yield from _plans(repeats)


# -- whole subjects -------------------------------------------------------------------------------


def _whole_subjects(repeats: int) -> Row:
    told: list[dict[str, Any]] = []

    def measure() -> float:
        command = [sys.executable, __file__, str(SUBJECTS)]
        told.append(json.loads(subprocess.check_output(command)))
        return SUBJECTS / told[-1]["seconds"]

    mine, _ = in_turns(measure, None, repeats, warm_up=False)
    first = median(one["rounds"][0] for one in told)
    later = median(one["rounds"][-1] for one in told)
    trial = median(one["seconds"] / one["trials"] for one in told)
    return Row(
        "beliefs",
        f"bayes, {SUBJECTS} subjects through six conditions",
        "subjects/s",
        mine,
        target=TARGET,
        note=f"{1000 * trial:.2g} ms a trial; the first {CELL} subjects take {first:.1f} s and "
        f"{CELL} more {later:.1f} s: about {first + (1000 / CELL - 1) * later:.0f} s for 1,000",
    )


def _play(subjects: int) -> dict[str, Any]:
    from causal_openlock import Condition, Session, find_schema
    from causal_openlock.experiment.protocol import PAPER_CONDITIONS, PROTOCOLS
    from openlock_learners.bayes import Bayes

    conditions = [Condition.named(name, find_schema) for name in PAPER_CONDITIONS]
    rounds, trials, began = [], 0, time.perf_counter()
    for first in range(0, subjects, CELL):
        numbers = range(first, min(first + CELL, subjects))
        before = time.process_time()
        for condition in conditions:
            session = Session(condition, PROTOCOLS["human"], numbers, seed=SEED, learner="bayes")
            session.play(Bayes())
            trials += session.brief.trials * len(numbers)
        rounds.append(time.process_time() - before)
    return {
        "subjects": subjects,
        "trials": trials,
        "seconds": sum(rounds),
        "seconds_by_the_clock": time.perf_counter() - began,
        "rounds": rounds,
    }


# -- posteriors -----------------------------------------------------------------------------------


def _posteriors(repeats: int) -> Iterator[Row]:
    for subjects, limit in ((CELL, 100), (1, 100), (CELL, 20_000)):
        scene = _Scene(subjects, limit)
        mine, others = in_turns(scene.update, scene.peer, repeats)
        at_once, apart = scene.at_once(), scene.difference()
        yield Row(
            "beliefs",
            f"posteriors, {subjects} subject{'s' * (subjects > 1)}, {scene.many:,} hypotheses",
            "pairs/s",
            mine,
            PEER,
            others,
            broken=f"posteriors differ by {apart:.1g}" if apart > NEAR else "",
            note=f"within {apart:.0e} of {PEER}'s; {PEER} on one network of all {ACTIONS} actions, "
            f"built beforehand and queried once: {at_once / 1e6:.3g} M/s",
        )


class _Scene:
    """Subjects in a noisy room who push levers at random, and believe that levers may fail."""

    def __init__(self, subjects: int, limit: int) -> None:
        import numpy as np

        from causal_openlock import Condition, Protocol, Session, find_schema

        condition = Condition.named("noisy_CC3", find_schema)
        session = Session(condition, Protocol("random", 30, False), subjects, seed=SEED)
        self.limit, self.brief, self.view = limit, session.brief, session.view
        generator = np.random.default_rng(0)
        self.steps = []
        for _ in range(ACTIONS):
            # To push what does not stand pushed always tells something.
            free = session.view.observation[:, : self.brief.positions] == 0
            self.steps.append(session.step((free * generator.random(free.shape)).argmax(axis=1)))
        self.belief = self.fresh().of[0]
        self.many = len(self.belief.which)
        self.chances = [self._chance(step) for step in self.steps]

    def fresh(self) -> Any:
        """What the subjects believe before they act."""
        from causal_openlock.belief.beliefs import Beliefs
        from causal_openlock.belief.knowledge import Prior

        prior = Prior(noise=0.5, hypothesis_limit=self.limit)
        beliefs = Beliefs(self.brief, prior, self.brief.generators)
        beliefs.enter(self.view)
        return beliefs

    def _chance(self, step: Any) -> Any:
        """``[H]`` how probable each hypothesis makes what the first subject saw."""
        from causal_openlock.belief.likelihoods import Event, likelihood
        from causal_openlock.belief.planning import Situation

        belief = self.belief
        lever, before, after = int(step.action[0]), step.view.observation[0], step.outcome[0]
        event = Event(
            slot=int(belief.slots[lever]),
            pushed=Situation.of(step.view, 0, belief.slots).pushed,
            took_effect=bool(before[lever] != after[lever]),
            unlocked=bool(after[-2] == 0),
            new=False,
        )
        return likelihood(belief.space.hypotheses, belief.which, belief.space.strengths, event)

    def update(self) -> float:
        """Ours: pairs in a second, likelihoods included."""
        beliefs, pairs = self.fresh(), 0
        with stopwatch() as seconds:
            for step in self.steps:
                pairs += sum(len(belief.which) for belief in beliefs.of)
                beliefs.update(step)
            took = seconds()
        self.posterior = beliefs.of[0]
        return pairs / took

    def peer(self) -> float:
        """The peer's: a network for each action of the first subject."""
        weight = self.belief.weight
        with stopwatch() as seconds:
            for chance in self.chances:
                weight = _query(_network(weight, [chance]))
            took = seconds()
        self.answer = weight
        return self.many * ACTIONS / took

    def at_once(self) -> float:
        """The peer's if the whole network is at hand and only the last posterior is asked for."""
        network = _network(self.belief.weight, self.chances)
        _query(network)
        with stopwatch() as seconds:
            _query(network)
            return self.many * ACTIONS / seconds()

    def difference(self) -> float:
        """The most by which our posterior of the first subject differs from the peer's."""
        import numpy as np

        own = np.zeros(len(self.belief.space))
        own[self.posterior.which] = self.posterior.weight
        return float(np.abs(own[self.belief.which] - self.answer).max())


def _network(weight: Any, chances: list[Any]) -> Any:
    """Hypotheses as states of a variable, and what was seen as its children."""
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # pgmpy's, about its own modules
        from pgmpy.factors.discrete import TabularCPD
        from pgmpy.inference import VariableElimination
        from pgmpy.models import DiscreteBayesianNetwork

    many = len(weight)
    network = DiscreteBayesianNetwork([("hypothesis", f"seen_{i}") for i in range(len(chances))])
    network.add_cpds(TabularCPD("hypothesis", many, weight[:, None]))
    for index, chance in enumerate(chances):
        table = [1.0 - chance, chance]
        network.add_cpds(TabularCPD(f"seen_{index}", 2, table, ["hypothesis"], [many]))
    return VariableElimination(network)


def _query(inference: Any) -> Any:
    seen = [node for node in inference.model.nodes if node != "hypothesis"]
    return inference.query(["hypothesis"], dict.fromkeys(seen, 1), show_progress=False).values


# -- plans ----------------------------------------------------------------------------------------


def _plans(repeats: int) -> Iterator[Row]:
    import numpy as np

    from causal_openlock import Condition, Session, find_schema
    from causal_openlock.belief.planning import Objective, Planner, Situation
    from causal_openlock.experiment.protocol import PROTOCOLS
    from openlock_learners.bayes import Bayes

    session = Session(Condition.named("CC4", find_schema), PROTOCOLS["human"], 1, seed=SEED)
    learner = Bayes()
    learner.begin(session.brief)
    learner.beliefs.enter(session.view)
    belief = learner.belief(0)
    situation = Situation.of(session.view, 0, belief.slots, belief.found)

    def measurement(many: int) -> Measurement:
        likely = np.sort(np.argsort(-belief.weight, kind="stable")[:many])
        hypotheses = belief.space.hypotheses[belief.which[likely]]
        planner = Planner(hypotheses, belief.space.strengths, Objective())

        def measure() -> float:
            with stopwatch() as seconds:
                for _ in range(PLANS):
                    planner.values(belief.weight[likely], situation)
                return seconds() / PLANS

        return measure

    for many in PLANNED:
        mine, _ = in_turns(measurement(many), None, repeats)
        yield Row("beliefs", f"plan of 3 actions, {many} hypotheses", "s", mine)


def main() -> None:
    parser = argparse.ArgumentParser(
        description="Play subjects of bayes through all six conditions and tell the seconds."
    )
    parser.add_argument("subjects", type=int, nargs="?", default=1000)
    chosen = parser.parse_args()
    from run import ONE_THREAD

    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # before NumPy is loaded
    print(json.dumps(_play(chosen.subjects)))


if __name__ == "__main__":
    main()
