"""Acting in environments, some actions at a time."""

from causal_openlock.envs import OpenLockEnv

# The room CC4 in trial7: the actions that push its levers, by role, and its solutions.
L0, L1, L2, L3, WHITE, DOOR = 4, 0, 6, 2, 1, 14
SOLUTIONS = [(L0, L1, DOOR), (L0, L2, DOOR), (L0, L3, DOOR)]
NOTHING = (WHITE, WHITE, WHITE)
EPISODES = ("attempt", "trial")
# What the console of an environment shows.
CONSOLE = ("solutions_left", "solutions_found", "attempts_left", "actions_left")


def trial7(**arguments):
    """CC4 in trial7, at the start of a trial."""
    env = OpenLockEnv("CC4", "trial7", **arguments)
    env.reset(seed=0)
    return env


def act(env, actions):
    """What the last of these actions leads to."""
    for action in actions:
        result = env.step(action)
    return result
