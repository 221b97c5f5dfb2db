"""What rooms, rewards, beliefs and plans must be, in plain sets and dicts: slow and by definition.

Written from the paper, `docs/decisions.md` (what it leaves open) and `docs/structure_learner.md`,
not from the package's code, none of which it calls: of a schema it reads the levers, the edges and
the gates. Tests compare the package with it; `support/authors_program.py` is a second witness.

Levers have any names: roles, positions or slots. An action is ``(verb, node)``: push or pull a
lever, or push the door. Where only what can do something matters, the node is enough: a pulled
lever can be pushed, a pushed one pulled.
"""

import math
from collections import defaultdict
from functools import cache, cached_property
from itertools import combinations, permutations, product
from typing import NamedTuple

DOOR = "door"
NOTHING = frozenset()


class Seen(NamedTuple):
    """What there is to see after an action: the room, and whether it was a new solution."""

    moved: bool
    pushed: frozenset
    unlocked: bool
    opened: bool
    new: bool


class Rules:
    """Which nodes enable which: a directed acyclic graph with gates and strengths.

    Args:
        causes: Of each lever, and of the door, ``{cause: strength}``; other levers never move.
        needed: How many of its causes must be pushed, of each node; 0 of one without causes.
    """

    def __init__(self, causes, needed):
        self.causes, self.needed = causes, needed
        self.levers = [node for node in causes if node != DOOR]
        self._known = {}

    @classmethod
    def of(cls, schema):
        """The rules of a schema, by role."""
        graph, needed = schema.graph, {}
        causes = {
            node: {
                cause: graph.edges[cause, node]["strength"] for cause in graph.predecessors(node)
            }
            for node in (*schema.levers, DOOR)
        }
        for node, own in causes.items():
            gate = graph.nodes[node]["gate"]
            needed[node] = {"any": min(1, len(own)), "all": len(own), "at_least": gate.k}[gate.kind]
        return cls(causes, needed)

    def at(self, place):
        """The same rules, each lever called by its place."""
        place = {**place, DOOR: DOOR}
        causes = {
            place[node]: {place[cause]: strength for cause, strength in own.items()}
            for node, own in self.causes.items()
        }
        return Rules(causes, {place[node]: enough for node, enough in self.needed.items()})

    @cached_property
    def key(self):
        """Equal for equal rules."""
        return frozenset((n, frozenset(c.items()), self.needed[n]) for n, c in self.causes.items())

    def holds(self, node, pushed):
        """Whether a node is enabled: the lever moves, the door is unlocked."""
        causes = self.causes.get(node)
        return causes is not None and sum(c in pushed for c in causes) >= self.needed[node]

    def chance(self, node, pushed):
        """Probability that a push or a pull of a node takes effect: enough causes transmit."""
        if not self.holds(node, pushed):
            return 0.0
        transmitted = [1.0]  # how probable it is that 0, 1, 2, ... causes transmit
        for cause, strength in self.causes[node].items():
            if cause in pushed:
                transmitted = [
                    fails * (1 - strength) + transmits * strength
                    for fails, transmits in zip([*transmitted, 0], [0, *transmitted], strict=True)
                ]
        return sum(transmitted[self.needed[node] :])

    def pushable(self, levers):
        """Whether these levers can be pushed one after another."""
        pushed = NOTHING
        while more := {lever for lever in levers - pushed if self.holds(lever, pushed)}:
            pushed |= more
        return pushed == levers

    @cached_property
    def solutions(self):
        """Every minimal set of levers that can be pushed and then unlock the door."""
        found = []
        for size in range(len(self.levers) + 1):
            for levers in map(frozenset, combinations(self.levers, size)):
                minimal = not any(smaller < levers for smaller in found)
                if minimal and self.holds(DOOR, levers) and self.pushable(levers):
                    found.append(levers)
        return frozenset(found)

    @cached_property
    def inert(self):
        """The levers on no path to the door."""
        useful = {DOOR}
        while more := {c for node in useful for c in self.causes[node]} - useful:
            useful |= more
        return frozenset(self.levers) - useful

    def solution(self, pushed):
        """The solution that stands pushed, inert levers aside; None if none does."""
        useful = pushed - self.inert
        return useful if useful in self.solutions else None

    def begins(self, lever):
        """Whether a push of a lever from the start begins a solution."""
        return self.holds(lever, NOTHING) and any(lever in levers for levers in self.solutions)

    def outcomes(self, pushed, node, found=NOTHING):
        """``{seen: probability}`` after a lever is moved, or the door pushed.

        Args:
            pushed: Which levers are pushed before.
            node: The lever or the door.
            found: What stood pushed as the door opened with a new solution.
        """
        if (pushed, node, found) not in self._known:
            chance, opens = self.chance(node, pushed), node == DOOR
            after, solution = pushed if opens else pushed ^ {node}, self.solution(pushed)
            new = opens and solution is not None and solution not in map(self.solution, found)
            seen = {
                Seen(False, pushed, self.holds(DOOR, pushed), False, False): 1 - chance,
                Seen(True, after, self.holds(DOOR, after), opens, new): chance,
            }
            self._known[pushed, node, found] = {one: p for one, p in seen.items() if p > 0}
        return self._known[pushed, node, found]


# -- a trial, and what it pays ---------------------------------------------------------------------


class Event(NamedTuple):
    """What an action did, as far as it is paid for."""

    first: bool
    repeated: bool
    begins: bool
    moved: bool
    unlocks: bool
    opens: bool
    new: bool
    found_before: int


class Room:
    """A trial in one room, action by action.

    Args:
        rules: The rules, by position.
        positions: How many positions there are.
        action_limit: Actions an attempt has.
    """

    def __init__(self, rules, positions=7, action_limit=3):
        self.rules, self.positions, self.action_limit = rules, positions, action_limit
        self.found = []  # what was pushed at each new solution
        self.begin()

    def begin(self):
        """Begin an attempt: all levers pulled, the door locked and closed."""
        self.pushed, self.opened, self.used = NOTHING, False, 0
        self.was_unlocked, self.new, self.previous = False, False, None

    @property
    def over(self):
        return self.opened or self.used == self.action_limit

    def observation(self):
        """Levers pushed, levers active, door locked, door open."""
        places = range(self.positions)
        levers = [place in those for those in (self.pushed, self.rules.causes) for place in places]
        return [*map(int, levers), int(not self.rules.holds(DOOR, self.pushed)), int(self.opened)]

    def named(self, action):
        """Verb and node of the action with this number."""
        pull, place = divmod(action, self.positions)
        return ("push", DOOR) if pull == 2 else (("push", "pull")[pull], place)

    def can_do(self, action):
        """Probability that an action takes effect."""
        verb, node = self.named(action)
        if self.opened or (node != DOOR and (verb == "push") == (node in self.pushed)):
            return 0.0
        return self.rules.chance(node, self.pushed)

    def step(self, action, luck=0.0):
        """Take an action, which takes effect if luck is below its chance; its `Event`."""
        verb, node = self.named(action)
        moved, locked = luck < self.can_do(action), not self.rules.holds(DOOR, self.pushed)
        first, repeated, before = self.used == 0, action == self.previous, len(self.found)
        if moved and node != DOOR:
            self.pushed ^= {node}
        opens = moved and node == DOOR
        unlocks = locked and self.rules.holds(DOOR, self.pushed)
        solution = self.rules.solution(self.pushed) if unlocks or opens else None
        new = solution is not None and solution not in map(self.rules.solution, self.found)
        self.opened, self.used, self.previous = opens, self.used + 1, action
        self.was_unlocked = self.was_unlocked or unlocks
        if opens and new:
            self.found.append(self.pushed)
            self.new = True
        begins = first and verb == "push" and self.rules.begins(node)
        return Event(first, repeated, begins, moved, unlocks, opens, new, before)

    @property
    def category(self):
        """How an attempt that is over ended."""
        if self.opened:
            return f"open{min(len(self.found), 3)}" if self.new else "open1"
        return "unlock" if self.was_unlocked else "else"


WEIGHTS = {
    "unlock": 10.0, "open": 50.0, "state_change": 0.5, "negative_immovable": -0.5,
    "negative_repeat": -0.25, "partial_sequence": 1.0, "solution_multiplier": 1.5,
}  # fmt: skip


def reward(event, terms, weights=WEIGHTS):
    """What an action is paid: the terms add up."""
    plain = weights["unlock"] * event.unlocks + weights["open"] * event.opens
    grown = plain * weights["solution_multiplier"] ** event.found_before if event.new else plain
    change_is_paid = event.moved and not (event.begins and "partial_sequence" in terms)
    return sum(
        {
            "basic": plain,
            "unique_solutions": 0.0 if event.new else -plain,
            "state_change": weights["state_change"] * change_is_paid,
            "negative_immovable": weights["negative_immovable"] * (not event.moved),
            "negative_repeat": weights["negative_repeat"] * event.repeated,
            "partial_sequence": weights["partial_sequence"] * event.begins,
            "solution_multiplier": grown - plain,
        }[term]
        for term in terms
    )


# -- what is probable ------------------------------------------------------------------------------


@cache
def structure(causes, needed, strength=1.0):
    """Rules of levers by number, all edges as strong: causes of each lever, the door's last."""
    nodes = [*range(len(causes) - 1), DOOR]
    linked = [dict.fromkeys(sorted(own), strength) for own in causes]
    return Rules(dict(zip(nodes, linked, strict=True)), dict(zip(nodes, needed, strict=True)))


def acyclic(causes):
    """Whether no lever is a cause of itself, through others or not."""
    left = set(range(len(causes)))
    while free := {lever for lever in left if not causes[lever] & left}:
        left -= free
    return not left


@cache
def free_form(levers, simplicity):
    """``{(causes, needed): probability}`` of every structure that follows no class.

    Levers in a random order, each choosing its causes among those before it, and the door among
    all; each edge, and each gate other than ``any``, makes it less probable.
    """
    sets = [frozenset(s) for k in range(levers + 1) for s in combinations(range(levers), k)]
    weight = {}
    for causes in filter(acyclic, product(sets, repeat=levers)):
        orders = sum(
            all(order[c] < order[lever] for lever in range(levers) for c in causes[lever])
            for order in permutations(range(levers))
        )
        for whole in ((*causes, door) for door in sets[1:]):
            for needed in product(*(range(1, len(own) + 1) if own else (0,) for own in whole)):
                parts = sum(len(own) + (k > 1) for own, k in zip(whole, needed, strict=True))
                weight[whole, needed] = orders * math.exp(-simplicity * parts)
    return normalised(weight)


def generated(roles, door, levers):
    """``{(causes, needed): probability}`` of what a class generates: sizes of roles, then players.

    Args:
        roles: Of each role which roles enable it, by which gate (any, all, two, ...), and whether
            many levers may play it.
        door: The same of the door.
        levers: Number of levers.
    """
    by_sizes = defaultdict(list)
    for played in product(range(len(roles)), repeat=levers):
        sizes = tuple(map(played.count, range(len(roles))))
        many = [role[2] for role in roles]
        if all(size == 1 or (size and more) for size, more in zip(sizes, many, strict=True)):
            causes, needed = [], []
            for enablers, gate, _ in (*(roles[role] for role in played), door):
                own = frozenset(lever for lever, role in enumerate(played) if role in enablers)
                enough = {"any": 1, "all": len(own), "two": 2, "three": 3, "four": 4}[gate]
                causes.append(own)
                needed.append(min(enough, len(own)))
            by_sizes[sizes].append((tuple(causes), tuple(needed)))
    chance = defaultdict(float)
    for made in by_sizes.values():
        for one in made:
            chance[one] += 1 / len(by_sizes) / len(made)
    return dict(chance)


def normalised(weights):
    total = sum(weights.values())
    return {one: weight / total for one, weight in weights.items() if weight > 0}


def fits_console(rules, solutions, action_limit):
    """Whether there are so many solutions, each of which an attempt has room for."""
    own = rules.solutions
    return len(own) == solutions and all(len(levers) < action_limit for levers in own)


def behaviour(rules, action_limit):
    """All that can be seen in an attempt, whatever is done: equal if nothing can tell two apart.

    Solutions are numbered as they come, since what they are called is not seen.
    """
    numbers = {}

    def seen(pushed, left):
        whole = [pushed, rules.holds(DOOR, pushed)]
        for node in [*sorted(rules.levers), DOOR] if left else ():
            chance = rules.chance(node, pushed)
            whole.append(round(chance, 9))
            if 0 < chance < 1:
                whole.append(seen(pushed, left - 1))
            if chance and node == DOOR:
                solution = rules.solution(pushed)
                whole.append(solution and numbers.setdefault(solution, len(numbers)))
            elif chance:
                whole.append(seen(pushed ^ {node}, left - 1))
        return tuple(whole)

    return seen(NOTHING, action_limit)


def likelihood(rules, happened):
    """How probable rules make a trial: ``(pushed, node, seen)`` for each action."""
    total, found = 1.0, NOTHING
    for pushed, node, seen in happened:
        total *= rules.outcomes(pushed, node, found).get(seen, 0.0)
        found |= {pushed} if seen.new else NOTHING
    return total


def posterior(prior, happened):
    """``{rules: probability}`` after what happened, by Bayes' rule."""
    return normalised({rules: p * likelihood(rules, happened) for rules, p in prior.items()})


def entropy(belief):
    """Bits."""
    return -sum(p * math.log2(p) for p in normalised(belief).values())


def branches(belief, pushed, node, found=NOTHING):
    """``{seen: belief}`` after an action, in shares of the belief."""
    after = defaultdict(dict)
    for rules, weight in belief.items():
        for seen, chance in rules.outcomes(pushed, node, found).items():
            after[seen][rules] = weight * chance
    return after


# -- plans -----------------------------------------------------------------------------------------


def worth_of(belief, pushed, node, found, left, information, beta):
    """What an action is worth with the best that can follow in the attempt.

    Bits expected times ``information``, and ``beta`` for each new solution; a plan never pulls.
    """
    after = branches(belief, pushed, node, found)
    if not any(seen.moved for seen in after):
        return 0.0
    worth = information * entropy(belief)
    for seen, rest in after.items():
        then = 0.0
        if left > 1 and not seen.opened:
            then = max(
                0.0,
                *(
                    worth_of(rest, seen.pushed, node, found, left - 1, information, beta)
                    for node in useful_nodes(belief, seen.pushed, seen.unlocked)
                ),
            )
        chance = sum(rest.values()) / sum(belief.values())
        worth += chance * (beta * seen.new - information * entropy(rest) + then)
    return worth


def useful_nodes(belief, pushed, unlocked):
    """The levers that are not pushed, and the door if it is unlocked."""
    levers = sorted({lever for rules in belief for lever in rules.levers} - pushed)
    return [*levers, DOOR] if unlocked else levers


def placements(schemas, positions=None):
    """``((rules, weight), ...)``: every different placement of schemas that are as probable.

    Args:
        schemas: ``{schema: weight}``.
        positions: Number of positions, any of which may be active; its levers' if not given.
    """
    weights, rules = defaultdict(float), {}
    for schema, weight in normalised(schemas).items():
        own = Rules.of(schema)
        ways = list(permutations(range(positions or len(own.levers)), len(own.levers)))
        for places in ways:
            placed = own.at(dict(zip(own.levers, places, strict=True)))
            placed = rules.setdefault(placed.key, placed)
            weights[placed] += weight / len(ways)
    return tuple(weights.items())


class Plans:
    """The least expected attempts of who knows that one of some rooms is the true one.

    Every push, every pull and the door are tried, in rooms where all strengths are 1. All numbers
    of attempts are times the weight of the belief, a tuple of ``(rules, weight)``.

    Args:
        action_limit: Actions an attempt has.
        find: Number of solutions to find.
        lock_seen: Whether it is seen that the door is unlocked.
    """

    def __init__(self, action_limit, find, lock_seen=True):
        self.action_limit, self.find, self.lock_seen = action_limit, find, lock_seen
        self._attempts, self._rest = {}, {}

    def attempts(self, belief, found=NOTHING):
        """Attempts until enough is found, before an attempt begins."""
        if len(found) >= self.find:
            return 0.0
        if (belief, found) not in self._attempts:
            rest = self.rest(belief, found, NOTHING, self.action_limit, idle=True)
            self._attempts[belief, found] = sum(weight for _, weight in belief) + rest
        return self._attempts[belief, found]

    def rest(self, belief, found, pushed, left, idle=False):
        """Attempts after this one; an idle one, which has shown nothing so far, is for nothing."""
        if not left:
            return math.inf if idle else self.attempts(belief, found)
        key = belief, found, pushed, left, idle
        if key not in self._rest:
            self._rest[key] = min(self.after(*key).values())
        return self._rest[key]

    def after(self, belief, found, pushed, left, idle=False):
        """``{node: attempts after this one}`` of every action."""
        values = {}
        for node in [*sorted({lever for rules, _ in belief for lever in rules.levers}), DOOR]:
            parts = defaultdict(list)
            for rules, weight in belief:
                (seen,) = rules.outcomes(pushed, node, found)
                parts[seen if self.lock_seen else seen._replace(unlocked=None)] += [(rules, weight)]
            values[node] = 0.0
            for seen, part in parts.items():
                now = found | {pushed} if seen.new else found
                still = idle and len(parts) == 1 and not seen.new
                then = 0 if seen.opened else left - 1
                values[node] += self.rest(tuple(part), now, seen.pushed, then, still)
        return values

    def regret(self, belief, found, pushed, left, node):
        """Attempts that an action costs against the best one; None is an action without effect."""
        values = self.after(belief, found, pushed, left)
        own = self.rest(belief, found, pushed, left - 1) if node is None else values[node]
        return (own - min(values.values())) / sum(weight for _, weight in belief)


def least_attempts(schemas, action_limit, positions=None, find=None, lock_seen=True):
    """Least expected attempts of who holds these schemas possible; solutions are as many."""
    belief = placements(schemas, positions)
    find = find or len(belief[0][0].solutions)
    return Plans(action_limit, find, lock_seen).attempts(belief)


def schema_worth(schemas, action_limit, positions=None, find=None, lock_seen=True):
    """Least expected attempts of who knows which of the schemas holds, and of who does not."""
    options = action_limit, positions, find, lock_seen
    shares = normalised(schemas)
    known = sum(share * least_attempts({one: 1.0}, *options) for one, share in shares.items())
    return known, least_attempts(schemas, *options)
