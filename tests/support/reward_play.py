"""Rewards of actions told by role."""

from causal_openlock.envs import OpenLockEnv
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR
from causal_openlock.world.room import Layout

SCHEMAS = bundled_schemas()
# One of the published rooms of each schema.
LAYOUTS = {"CC3": "trial3", "CE3": "trial1", "CC4": "trial7", "CE4": "trial10"}


class Play:
    """A trial in one room, acted out by role; ``white`` is an inactive lever."""

    def __init__(self, reward):
        schema = SCHEMAS["CC4"]
        self.places = {lever: place for place, lever in enumerate(schema.levers)} | {"white": 6}
        layout = Layout(tuple(range(len(schema.levers))))
        self.env = OpenLockEnv(schema, layout, reward)
        self.env.reset(seed=0)

    def attempt(self, words):
        """The rewards of actions such as ``L0 -L0 door``: push L0, pull it back, push the door."""
        self.env.reset()
        return [float(self.env.step(self.action(word))[1]) for word in words.split()]

    def action(self, word):
        if word == DOOR:
            return 14
        return self.places[word.removeprefix("-")] + 7 * word.startswith("-")
