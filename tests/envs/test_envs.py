"""One room and many rooms against the oracle's: all that is seen, paid, counted and ended."""

import pickle

import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded

import oracle
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.world.room import position_names
from support.env_play import CONSOLE, EPISODES, L0, L1, NOTHING, SOLUTIONS, WHITE, trial7

SCHEMAS = bundled_schemas()
PAPER = ("basic", "negative_immovable", "partial_sequence", "solution_multiplier")
OTHER = ("basic", "unique_solutions", "negative_repeat", "state_change")
each_episode = pytest.mark.parametrize("episode", EPISODES)


class Expected:
    """What an environment must answer in one room, by the oracle."""

    def __init__(self, schema, terms, episode, attempts, actions, positions=7):
        self.rules, self.terms = oracle.Rules.of(schema), terms
        self.whole_trial = episode == "trial"
        self.attempts, self.actions, self.positions = attempts, actions, positions
        self.left, self.ended, self.layout = 0, True, None

    def begin_trial(self, places):
        """The answer to a reset that begins a trial, in this layout."""
        self.layout, self.left = places, self.attempts
        rules = self.rules.at(dict(zip(self.rules.levers, places, strict=True)))
        self.room, self.aims = oracle.Room(rules, self.positions, self.actions), rules.solutions
        return self.begin_attempt()

    def begin_attempt(self):
        self.room.begin()
        self.ended = False
        return self.room.observation(), self.console()

    def reset(self, places, new_trial=False):
        """The answer to a reset; ``places`` is the layout in which the environment then is."""
        if not self.ended and self.room.used and not self.whole_trial:
            self.left -= 1  # the attempt in progress is given up
        if self.whole_trial or new_trial or not self.left:
            return self.begin_trial(places)
        return self.begin_attempt()

    def console(self, attempt_over=False):
        found = len(self.room.found)
        actions = 0 if attempt_over else self.actions - self.room.used
        return dict(zip(CONSOLE, (len(self.aims) - found, found, self.left, actions), strict=True))

    def step(self, action, seen=None):
        """The answer to an action; what was seen after it says whether it failed by chance."""
        lucky = 0 < self.room.can_do(action) < 1 and seen != self.room.observation()
        event = self.room.step(action, luck=0.0 if lucky else np.nextafter(1, 0))
        reward, outcome = oracle.reward(event, self.terms), self.room.observation()
        if not self.room.over:
            return outcome, reward, False, False, self.console(), None
        solved = len(self.room.found) == len(self.aims)
        self.ended = over = solved or self.left == 1
        if over:
            self.left = 0
        if not self.whole_trial:
            console = self.console(attempt_over=True)
            self.left -= not over
            self.ended = True
            return outcome, reward, True, False, console, None
        self.left -= not over
        self.room.begin()
        now = self.room.observation()
        return now, reward, solved, over and not solved, self.console(), outcome

    def lively(self, generator):
        """An action that often leads to a solution, sometimes repeats, and sometimes errs."""
        room, chance = self.room, generator.random()
        if room.used == 0:
            missing = self.aims - {*map(room.rules.solution, room.found)} or self.aims
            aims = sorted(map(sorted, missing if generator.random() < 0.7 else self.aims))
            self.aim = aims[generator.integers(len(aims))]
        if chance < 0.1:
            return int(generator.integers(2 * self.positions + 1))
        if chance < 0.2 and room.previous is not None:
            return room.previous
        todo = [lever for lever in self.aim if lever not in room.pushed]
        free = [lever for lever in todo if room.rules.holds(lever, room.pushed)]
        return free[0] if free else 2 * self.positions


def places_of(latent):
    """The place of each lever, of what ``reveal`` tells of a single room."""
    names = position_names(7)
    return tuple(names.index(position) for _, position in latent["layout"])


@each_episode
@pytest.mark.parametrize("name", SCHEMAS)
@pytest.mark.parametrize("terms", [OTHER, PAPER])
def test_a_room_is_the_oracles_room(name, episode, terms):
    schema, generator = SCHEMAS[name], np.random.default_rng(5)
    limit = len(schema.solutions) * 3 // 2 + 1
    env = OpenLockEnv(schema, reward=terms, episode=episode, attempt_limit=limit, reveal=True)
    with pytest.raises(ResetNeeded):
        env.step(0)
    seen, info = env.reset(seed=3)
    plain = Expected(schema, terms, episode, limit, max(3, schema.least_action_limit))
    expected = plain.begin_trial(places_of(info["latent"]))
    assert (seen.tolist(), info["console"]) == expected
    kept, layouts, ends = [], set(), set()
    for moment in range(400):
        action = plain.lively(generator)
        seen, reward, *ended, info = env.step(action)
        outcome = info.get("outcome", seen)
        expected = plain.step(action, outcome.tolist())
        assert (seen.tolist(), reward, *ended, info["console"]) == expected[:5]
        assert outcome.tolist() == (expected[5] or expected[0])
        assert set(info) == {"console", "latent"} | ({"outcome"} if expected[5] else set())
        solutions = info["latent"]["solutions"]
        told = {frozenset(solutions[number]) for number in info["latent"]["found"]}
        assert told == {frozenset(schema.levers[plain.layout.index(place)] for place in levers)
                        for levers in map(plain.room.rules.solution, plain.room.found)}  # fmt: skip
        assert (info["latent"]["schema"], solutions) == (name, schema.solutions)
        assert places_of(info["latent"]) == plain.layout
        ends.add(tuple(ended))
        layouts.add(plain.layout)
        if moment % 2:  # what was handed out may be changed, and is not changed
            seen[:] = outcome[:] = 7
            info["console"].update(dict.fromkeys(CONSOLE, 99))
        else:
            kept += [(array, array.copy()) for array in (seen, outcome)]
        if any(ended) or moment % 41 == 40:
            if any(ended):
                with pytest.raises(ResetNeeded):
                    env.step(0)
            new_trial = moment % 7 == 0
            for asked in (new_trial, False):  # the second spends no attempt
                seen, info = env.reset(options={"new_trial": True} if asked else {})
                expected = plain.reset(places_of(info["latent"]), asked)
                assert (seen.tolist(), info["console"]) == expected
    assert all((array == copied).all() for array, copied in kept)
    assert len(layouts) > 1
    ends_of = {"attempt": {(True, False)}, "trial": {(True, False), (False, True)}}
    assert ends == {(False, False)} | ends_of[episode]
    seen, info = env.reset(seed=4)
    assert (seen.tolist(), info["console"]) == plain.begin_trial(places_of(info["latent"]))


def consoles_of(info):
    """The console of each of many rooms."""
    columns = zip(*(info["console"][key].tolist() for key in CONSOLE), strict=True)
    return [dict(zip(CONSOLE, column, strict=True)) for column in columns]


def layouts_of(info):
    """The layout of each of many rooms, as ``reveal`` tells."""
    layouts = info["latent"]["layout"]
    return [tuple(row.index(k) for k in range(max(row) + 1)) for row in layouts.tolist()]


@each_episode
@pytest.mark.parametrize(
    ("name", "terms", "limits"),
    [
        ("CE4", PAPER, {"attempt_limit": 5}),
        ("noisy_CC3", OTHER, {"attempt_limit": 2, "positions": 9}),
        ("two_keys", OTHER, {"attempt_limit": 1, "action_limit": 6}),
    ],
)
def test_many_rooms_are_the_oracles_rooms(name, terms, limits, episode):
    if episode == "trial":  # which shows no outcome of the last action, so nor its luck
        name = name.removeprefix("noisy_")
    schema, generator, many = SCHEMAS[name], np.random.default_rng(1), 6
    actions = limits.get("action_limit", max(3, schema.least_action_limit))
    options = (schema, terms, episode, limits["attempt_limit"], actions)
    rooms = [Expected(*options, limits.get("positions", 7)) for _ in range(many)]
    env = OpenLockVectorEnv(many, schema, reward=terms, episode=episode, reveal=True, **limits)
    with pytest.raises(ResetNeeded):
        env.step(np.zeros(many, int))
    seen, info = env.reset(seed=0, options={"reset_mask": [True] + [False] * 5})  # all, at first
    answers = [room.begin_trial(at) for room, at in zip(rooms, layouts_of(info), strict=True)]
    assert [*zip(seen.tolist(), consoles_of(info), strict=True)] == answers
    kept, ends = [], set()
    for moment in range(250):
        if moment == 100:
            env = pickle.loads(pickle.dumps(env))
        chosen = [room.lively(generator) for room in rooms]
        if moment % 50 == 7:  # what is refused changes nothing, nor anybody's luck
            with pytest.raises(InvalidAction):
                env.step(np.array([*chosen[1:], 99]))
        result = seen, *rest, info = env.step(np.array(chosen))
        answers = []
        for room, action, now, at in zip(
            rooms, chosen, seen.tolist(), layouts_of(info), strict=True
        ):
            if room.ended:  # this step resets it
                observation, console = room.reset(at)
                answers.append((observation, 0.0, False, False, console))
            else:
                answers.append(room.step(action, now)[:5])
            assert room.layout == at
        columns = [array.tolist() for array in (seen, *rest)]
        assert [*zip(*columns, consoles_of(info), strict=True)] == answers
        ends.update(answer[2:4] for answer in answers)
        for room, known in zip(rooms, info["latent"]["found"], strict=True):
            solutions = {*map(room.room.rules.solution, room.room.found)}
            levers = [
                frozenset(room.layout[schema.levers.index(lever)] for lever in solution)
                for solution in schema.solutions
            ]
            assert {levers[k] for k in np.flatnonzero(known)} == solutions
        arrays = [*result[:4], *info["latent"].values(), *info["console"].values()]
        kept += [(array, array.copy()) for array in arrays]
        if moment % 30 == 29:
            mask = generator.random(many) < 0.5
            anew, info = env.reset(options={"reset_mask": mask.tolist()})
            assert (anew[~mask] == seen[~mask]).all()
            for index in np.flatnonzero(mask):
                answer = rooms[index].begin_trial(layouts_of(info)[index])
                assert (anew[index].tolist(), consoles_of(info)[index]) == answer
    assert all((array == copied).all() for array, copied in kept)
    assert len(ends) == (2 if episode == "attempt" else 3)


# -- chance ---------------------------------------------------------------------------------------


def course(env, seed, actions):
    """All that is seen and paid in the course of some actions; ``[moments, ...]`` of many rooms."""
    many = isinstance(env, OpenLockVectorEnv)
    seen = [env.reset(seed=seed)[0]]
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action if many else int(action))
        seen.append(
            np.concatenate([observation, np.reshape(reward, (*observation.shape[:-1], 1))], -1)
        )
        if not many and (terminated or truncated):
            seen.append(env.reset()[0])
    return seen


def equal(one, other):
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


@each_episode
@pytest.mark.parametrize("schema", ["CE4", "noisy_CC3"])
def test_a_seed_determines_layouts_and_luck(schema, episode):
    actions = np.random.default_rng(0).integers(15, size=(200, 8))
    arguments = {"schema": schema, "episode": episode, "attempt_limit": 4}
    for env, taken in (
        (OpenLockEnv(**arguments), actions[:, 0]),
        (OpenLockVectorEnv(8, **arguments), actions),
    ):
        first = course(env, 1, taken)
        assert not equal(first[:30], course(env, 2, taken)[:30])
        assert equal(first, course(env, 1, taken))


@each_episode
def test_luck_of_a_room_depends_on_no_other_room_and_not_on_how_many_there_are(episode):
    few, many = (OpenLockVectorEnv(n, "noisy_CC3", "trial1", PAPER, episode, 4) for n in (3, 10))
    actions = np.random.default_rng(0).choice([0, 0, 4, 4, 14], size=(300, 10))
    one, other = course(few, 5, actions[:, :3]), course(many, 5, actions)
    assert equal(one, [seen[:3] for seen in other])


def test_a_noisy_room_obeys_as_often_as_its_strengths_say():
    pushes, three_sigma = 4000, 0.02
    env = OpenLockEnv("noisy_CC3", "trial1")  # L0 at 0, L1 at 4; L0 -> L1 has strength 0.8
    env.reset(seed=0)
    moved = []
    for _ in range(pushes):
        env.reset()
        assert env.step(0)[0][0] == 1  # a lever without causes always obeys
        moved.append(env.step(4)[0][4])
    assert np.mean(moved) == pytest.approx(0.8, abs=three_sigma)
    many = OpenLockVectorEnv(pushes, "noisy_CC3", "trial1")
    many.reset(seed=0)
    many.step(np.full(pushes, 0))
    seen, *_ = many.step(np.full(pushes, 4))
    assert seen[:, 4].mean() == pytest.approx(0.8, abs=three_sigma)
    before, failed = seen.copy(), seen[:, 4] == 0  # their next try has luck of its own
    again = many.step(np.full(pushes, 4))[0]
    assert again[failed, 4].mean() == pytest.approx(0.8, abs=0.06)
    for _ in range(6):  # what was handed out stays as it was
        many.step(np.full(pushes, 14))
    assert (seen == before).all()


def test_random_layouts_are_all_equally_likely():
    env = OpenLockVectorEnv(8400, "CC3", reveal=True)
    _, counts = np.unique(layouts_of(env.reset(seed=0)[1]), axis=0, return_counts=True)
    assert len(counts) == 7 * 6 * 5
    assert abs(counts - 40).max() < 6 * np.sqrt(40)


# -- single cases ---------------------------------------------------------------------------------


def test_a_mask_over_rooms_that_have_ended_spares_the_others_their_reset():
    env = OpenLockVectorEnv(2, "CC4", "trial7", "basic", "trial", attempt_limit=1)
    env.reset(seed=0)
    for action in NOTHING:
        _, _, _, truncated, _ = env.step(np.full(2, action))
    assert truncated.all()
    env.reset(options={"reset_mask": [True, False]})
    seen, *_ = env.step(np.full(2, L0))
    assert seen[:, L0].tolist() == [1, 0], "the second room takes this step to reset"


def test_what_is_latent_is_in_info_only_if_revealed():
    for episode in EPISODES:
        env = trial7(episode=episode)
        infos = [env.reset(seed=0)[1], *(env.step(action)[4] for action in SOLUTIONS[0])]
        many = OpenLockVectorEnv(2, "CC4", "trial7", episode=episode)
        infos += [many.reset(seed=0)[1], many.step(np.array([0, 1]))[4]]
        for info in infos:
            assert set(info) - {"outcome"} == {"console"}
            assert set(info["console"]) == set(CONSOLE)
        assert all(type(value) is int for value in infos[0]["console"].values())


@each_episode
@pytest.mark.parametrize("action", [-1, 15, 10**20, 1.0, np.float64(2), None, "3", [1]])
def test_what_is_no_action_is_refused_and_changes_nothing(episode, action):
    env = trial7(episode=episode)
    env.step(L0)
    with pytest.raises(InvalidAction, match="0 to 14"):
        env.step(action)
    seen, *_, info = env.step(L1)
    assert np.flatnonzero(seen[:7]).tolist() == [L1, L0]
    assert info["console"]["actions_left"] == 1


@pytest.mark.parametrize("options", [3, {"x": 1}])
def test_a_reset_that_is_refused_changes_nothing(options):
    env = trial7()
    env.step(L0)
    with pytest.raises(OpenLockError, match="new_trial"):
        env.reset(seed=1, options=options)
    info = env.step(L1)[4]
    assert (info["console"]["attempts_left"], info["console"]["actions_left"]) == (30, 1)


def test_any_kind_of_integer_is_an_action():
    for kind in (int, np.int8, np.uint8, np.int64, np.uint64, np.array):
        assert trial7().step(kind(L0))[0][L0] == 1


@pytest.mark.parametrize(
    "actions",
    [
        *(np.zeros(2), np.zeros(3, int), np.zeros((2, 1), int), np.zeros(2, bool), 0, None),
        *([0, None], [0, 15], [-1, 0], np.array([0, 2**63], dtype=np.uint64)),
    ],
)
@pytest.mark.parametrize("ended", [False, True])
def test_many_rooms_refuse_what_are_no_actions(actions, ended):
    env = OpenLockVectorEnv(2, "CC4", "trial7", episode="trial", attempt_limit=1)
    env.reset(seed=0)
    for action in NOTHING if ended else ():
        env.step(np.full(2, action))
    with pytest.raises(InvalidAction):
        env.step(actions)
    seen, *_ = env.step(np.array([L0, WHITE]))
    assert seen[:, L0].tolist() == [not ended, 0]  # of a trial that has ended, the step resets it


@pytest.mark.parametrize(
    "mask", [[True], [1, 0, 1], "all", [None] * 3, np.ones(4, bool), np.ones((3, 1), bool)]
)
def test_a_mask_that_is_not_one_of_the_rooms_is_refused(mask):
    rooms = OpenLockVectorEnv(3)
    rooms.reset(seed=0)
    with pytest.raises(OpenLockError, match=r"reset_mask .* 3"):
        rooms.reset(options={"reset_mask": mask})
