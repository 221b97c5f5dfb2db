"""Rewards of actions told by role, and of many actions at once."""

import numpy as np

from causal_openlock.envs import OpenLockEnv
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR
from causal_openlock.world.batch import RoomBatch
from causal_openlock.world.room import Layout

SCHEMAS = bundled_schemas()
# One of the published rooms of each schema.
LAYOUTS = {"CC3": "trial3", "CE3": "trial1", "CC4": "trial7", "CE4": "trial10"}


class Play:
    """A trial in one room, acted out by role; ``white`` is an inactive lever."""

    def __init__(self, reward, schema="CC4", action_limit=None):
        schema = SCHEMAS[schema]
        self.places = {lever: place for place, lever in enumerate(schema.levers)} | {"white": 6}
        layout = Layout(tuple(range(len(schema.levers))))
        self.env = OpenLockEnv(schema, layout, reward, action_limit=action_limit)
        self.env.reset(seed=0)

    def attempt(self, words):
        """The rewards of actions such as ``L0 -L0 door``: push L0, pull it back, push the door."""
        self.env.reset()
        return [float(self.env.step(self.action(word))[1]) for word in words.split()]

    def action(self, word):
        if word == DOOR:
            return 14
        return self.places[word.removeprefix("-")] + 7 * word.startswith("-")


def pay(table, row, action, previous, found):
    """The rows after some actions, all of which take effect, and the rewards for them.

    Args:
        table: The table of the reward.
        row: ``[N]`` where each room is.
        action: ``[N]`` the actions.
        previous: ``[N]`` the actions before them, -1 for none.
        found: ``[N, K]`` which solutions are found before.
    """
    batch = RoomBatch(table.tables, [table.reward], len(row), attempt_limit=2, put_back=False)
    batch.begin_trials(slice(None), table.tables.room[row])
    batch.row = row.copy()
    batch.previous[:] = previous
    batch.found[:] = found
    batch.found_count[:] = found.sum(axis=1)
    taken = batch.step(np.array(action), np.zeros(len(row)))
    return taken.after, taken.reward
