"""Playing sessions: learners that do what a test needs, and records as data frames."""

from functools import cache

import numpy as np

from causal_openlock.contract.learner import Learner, Step
from causal_openlock.experiment.condition import Condition, Trials, find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.world.randomness import Streams
from causal_openlock.world.room import Layout

SCHEMAS = bundled_schemas()
HUMAN, RL = PROTOCOLS["human"], PROTOCOLS["rl"]


@cache
def named(name):
    """A condition of the bundled schemas by its name."""
    return find_condition(name)


def play(player, condition, protocol=HUMAN, subjects=10, **arguments):
    """The record of a session that the learner played."""
    condition = named(condition) if isinstance(condition, str) else condition
    return Session(condition, protocol, subjects, **arguments).play(player).to_pandas()


def one_room(schema, layout, trials=1):
    """A baseline of trials in one room."""
    schema = SCHEMAS[schema] if isinstance(schema, str) else schema
    group = Trials(schema, (Layout.of(schema, layout),))
    return Condition("room", (group,) * trials)


def trials_of(record):
    """One row for each trial: how many attempts it took, what was found."""
    keys = ["subject", "phase", "loop", "trial"]
    return record.groupby(keys, observed=True).agg(
        attempts=("attempt", "max"),
        rows=("attempt", "size"),
        found=("solutions_found", "max"),
        solutions=("solutions", "max"),
        schema=("schema", "first"),
        layout=("layout", "first"),
    )


class Scripted(Learner):
    """Does what is written, a list of actions for each subject, and then nothing valid."""

    def __init__(self, *scripts, afterwards=-1):
        super().__init__()
        self.scripts, self.afterwards = scripts, afterwards
        self.steps: list[Step] = []

    def begin(self, brief):
        self.moment = 0

    def act(self, view):
        chosen = [
            script[self.moment] if self.moment < len(script) else self.afterwards
            for script in self.scripts
        ]
        self.moment += 1
        return np.array(chosen)

    def learn(self, step):
        self.steps.append(step)


class Curious(Learner):
    """Draws among the grey levers and the door, and so finds solutions now and then."""

    def begin(self, brief):
        self.positions, self.streams = brief.positions, Streams(brief.generators)
        self.steps: list[Step] = []

    def act(self, view):
        p = self.positions
        grey = view.observation[:, p : 2 * p]
        # Pushes of grey levers and, as often as any of them, the door.
        could = np.cumsum(np.column_stack([grey, np.ones(len(grey))]), axis=1)
        which = (could > (self.streams.uniform() * could[:, -1])[:, None]).argmax(axis=1)
        return np.where(which == p, 2 * p, which)

    def learn(self, step):
        self.steps.append(step)
