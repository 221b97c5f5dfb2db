"""OpenLock in one file: the room, the ideal observer, a Bayesian learner, and a table.

This is causal_openlock in miniature, to be read from top to bottom; it needs NumPy alone, and runs
in seconds. A room has seven levers. White ones never move. Grey ones follow a hidden causal
*schema*: what has to be pushed before a lever moves or the door unlocks. A player has 30 attempts
of three actions to find every way to open the door. What helps in the next room is not where the
levers were, but which schema to expect. A test holds this file equal to the package.
"""

from functools import cache
from itertools import permutations, product

import numpy as np

# -- 1. Schemas -----------------------------------------------------------------------------------
# A schema turns levers, in the order of their roles, into a *structure*: the causes of each lever
# and of the door. A solution is the first lever and one of the others, then the door.
DOOR, PUSH, PULL, OPEN = 7, 0, 1, 2
SCHEMAS = {
    # Common cause: the first lever frees the others, and any of these unlocks the door.
    "CC": lambda first, *others: {first: set(), DOOR: set(others)} | {o: {first} for o in others},
    # Common effect: any of the others frees the first, and the first unlocks the door.
    "CE": lambda first, *others: {first: set(others), DOOR: {first}} | {o: set() for o in others},
}


def happens(structure, pushed, verb, lever):
    """Return which levers are pushed after an action, if the door is unlocked, and if it opens."""

    def enabled(node):  # always if it has no causes, otherwise while any of them is pushed
        return node in structure and (not structure[node] or bool(structure[node] & pushed))

    # An action that cannot do anything is legal: it costs an action, and changes nothing.
    if verb != OPEN and (lever in pushed) == (verb == PULL) and enabled(lever):
        pushed = pushed ^ {lever}
    unlocked = enabled(DOOR)  # it has no memory: it locks again when its last cause is pulled
    return pushed, unlocked, unlocked and verb == OPEN


# -- 2. The room ----------------------------------------------------------------------------------
POSITIONS, ACTIONS, ATTEMPTS, NOTHING = 7, 3, 30, frozenset()


class Room:
    """A schema with its levers at positions, ``places[role]``."""

    def __init__(self, schema, places):
        self.structure, self.found = SCHEMAS[schema](*places), NOTHING
        self.reset()

    def reset(self):
        """Begin an attempt: all levers pulled back, the door locked and closed."""
        self.pushed, self.unlocked, self.opened = NOTHING, False, False

    def step(self, action):
        """Push the lever at a position (0 to 6), pull it (7 to 13), or open the door (14)."""
        now = happens(self.structure, self.pushed, *divmod(action, POSITIONS))
        self.pushed, self.unlocked, self.opened = now
        self.found = self.found | {self.pushed} if self.opened else self.found

    def observation(self):
        """Return all that a player sees: levers pushed (7), grey (7), door locked, door open."""
        levers = [at in those for those in (self.pushed, self.structure) for at in range(POSITIONS)]
        return np.array([*levers, not self.unlocked, self.opened], int)


# -- 3. Beliefs, and the best plan under them -----------------------------------------------------
# A hypothesis is a schema with its roles assigned to the grey levers. These are numbered by *slot*,
# from the first position to the last, so that rooms share plans. An event has probability 1 or 0
# under a hypothesis: Bayes' rule strikes hypotheses out, and what is left keeps its prior odds.
@cache
class Beliefs:
    """Hypotheses about rooms with ``levers`` grey levers, and a plan for any set of hypotheses."""

    def __init__(self, prior, levers):
        self.hypotheses, self.odds, self.levers = [], [], levers
        for schema, probability in prior:
            # Exchanging levers of one role makes no difference: that is the same hypothesis.
            every = [SCHEMAS[schema](*slots) for slots in permutations(range(levers))]
            own = [one for number, one in enumerate(every) if one not in every[:number]]
            self.hypotheses += [(schema, one) for one in own]
            self.odds += [probability / len(own)] * len(own)
        self.expected = cache(self.expected)  # each state is planned for once

    def probability(self, some):
        """Return the prior probability of some hypotheses."""
        return sum(self.odds[h] for h in some)

    def outcomes(self, possible, pushed, *action):
        """Return what an action can lead to, each with the hypotheses under which it does."""
        found = {}
        for h in possible:
            outcome = happens(self.hypotheses[h][1], pushed, *action)
            found[outcome] = (*found.get(outcome, ()), h)
        return found

    def attempts(self, possible, found):
        """Return the least expected number of attempts until everything is found."""
        if len(found) == self.levers - 1:
            return 0.0
        return 1.0 + min(self.expected(possible, found, NOTHING, ACTIONS, idle=True).values())

    def expected(self, possible, found, pushed, left, idle=False):
        """Return, for each action, the expected number of attempts after this one (Bellman)."""
        # To open the locked door stands for all that does nothing, and wastes the rest. Not in an
        # idle attempt, which has taught nothing: the next would be the same, and so on for ever.
        values = {(OPEN, 0): np.inf if idle else self.attempts(possible, found)}
        for action in [*product((PUSH, PULL), range(self.levers)), (OPEN, 0)] if left else []:
            outcomes, value = self.outcomes(possible, pushed, *action), 0.0
            if all(after == pushed and not opens for after, _, opens in outcomes):
                continue
            for (after, _, opens), those in outcomes.items():
                known = found | {after} if opens else found
                same = idle and (those, known) == (possible, found)
                then = self.expected(those, known, after, 0 if opens else left - 1, same)
                value += min(then.values()) * self.probability(those) / self.probability(possible)
            values[action] = value
        return values


# -- 4. The player --------------------------------------------------------------------------------
class Bayes:
    """Takes the best action under its posterior. Told the schema, it is the ideal observer."""

    def __init__(self, generator, schemas=("CC", "CE")):
        self.generator, self.rooms = generator, dict.fromkeys(schemas, 1.0)  # one of each: Laplace

    def enter(self, seen):
        """Begin a room: which levers are grey is seen, and their roles are not."""
        self.grey = np.flatnonzero(seen[POSITIONS : 2 * POSITIONS]).tolist()
        odds = [(schema, rooms / sum(self.rooms.values())) for schema, rooms in self.rooms.items()]
        self.beliefs = Beliefs(tuple(odds), len(self.grey))
        self.possible, self.found = tuple(range(len(self.beliefs.odds))), NOTHING

    def act(self, seen, left):
        """Return one of the best actions, drawn at random."""
        self.pushed = frozenset(np.flatnonzero(seen[self.grey]).tolist())
        values = self.beliefs.expected(self.possible, self.found, self.pushed, left)
        best = [action for action, value in values.items() if value < min(values.values()) + 1e-9]
        verb, slot = best[self.generator.integers(len(best))]
        return verb * POSITIONS + (0 if verb == OPEN else self.grey[slot])

    def learn(self, action, then):
        """Strike out the hypotheses under which something else would have happened."""
        verb, lever = divmod(action, POSITIONS)
        after, opened = frozenset(np.flatnonzero(then[self.grey]).tolist()), bool(then[-1])
        if verb == OPEN or lever in self.grey:  # white levers teach nothing
            slot = 0 if verb == OPEN else self.grey.index(lever)
            outcomes = self.beliefs.outcomes(self.possible, self.pushed, verb, slot)
            self.possible = outcomes[after, not then[-2], opened]
        self.found = self.found | {after} if opened else self.found

    def leave(self):
        """Count the room for each schema by its posterior probability: this is what transfers."""
        for h in self.possible:
            share = self.beliefs.odds[h] / self.beliefs.probability(self.possible)
            self.rooms[self.beliefs.hypotheses[h][0]] += share


# -- 5. The experiment ----------------------------------------------------------------------------
def play(room, player):
    """Return how many attempts a player needs to find every solution; 30 if it does not."""
    player.enter(room.observation())
    attempts, solutions = 0, len(room.structure) - 2  # one for each lever but the first
    while attempts < ATTEMPTS and len(room.found) < solutions:
        attempts += 1
        room.reset()
        for left in range(ACTIONS, 0, -1):
            if not room.opened:  # an open door ends the attempt
                action = player.act(room.observation(), left)
                room.step(action)
                player.learn(action, room.observation())
    player.leave()
    return attempts


def last_trial(condition, ideal, seed):
    """Return a subject's attempts in the last room, by which a condition is judged."""
    generator = np.random.default_rng(seed)
    player, (train, _, test) = Bayes(generator), condition.partition("-")
    for name in [train] * 6 + [test] if test else [train] * 5:
        schema, levers = name[:2], int(name[2:])  # CC4: the common cause of four levers
        player = Bayes(generator, [schema]) if ideal else player
        attempts = play(Room(schema, generator.permutation(POSITIONS)[:levers].tolist()), player)
    return attempts


def main(subjects=40, seed=2018):
    """Print the mean attempts of people (Edmonds et al., 2018) and of both players."""
    print("condition  people  ideal  bayes")
    seeds = np.random.SeedSequence(seed).spawn(subjects)
    people = (("CC4", 6.45), ("CE4", 9.43), ("CC3-CC4", 5.53), ("CE3-CC4", 8.18),
              ("CC3-CE4", 13.75), ("CE3-CE4", 7.72))  # fmt: skip
    for condition, mean in people:
        ideal, bayes = [[last_trial(condition, one, s) for s in seeds] for one in (True, False)]
        print(f"{condition:9}  {mean:6.2f}  {np.mean(ideal):5.2f}  {np.mean(bayes):5.2f}")


if __name__ == "__main__":
    main()
