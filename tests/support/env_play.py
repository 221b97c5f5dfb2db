"""Acting in environments, some actions at a time."""

from causal_openlock.envs import OpenLockEnv

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
