"""Any algorithm of Stable-Baselines3 as a learner: PPO, A2C, DQN, RecurrentPPO of sb3-contrib.

Stable-Baselines3 drives its environment itself, and a session drives its learners. Here each
subject has a model of its own, whose ``learn`` runs in a thread of its own and sees an environment
that hands its actions to the session and waits for what came of them. One thread runs at a time, so
that everything happens in the same order each time, and nothing of the library is done in another
way than it does it: the same seed and the same room give the same actions as without us.

The library draws from the generators that all share, and seeds them. They are exchanged whenever a
model is asked: each goes on with numbers of its own, and everybody else finds them as they were.

A model in the midst of ``learn`` cannot be saved. What is saved is what it was told; from that, a
new one is brought to the same point.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from queue import SimpleQueue
from typing import Annotated, Any, Literal, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.contract.probes import GlobalRandomness
from causal_openlock.errors import LearnerError
from causal_openlock.wording import nearest
from causal_openlock.world.fsm import IntArray

LIBRARIES = ("stable_baselines3", "sb3_contrib")
OURS = ("policy", "env", "seed", "_init_setup_model")
"""What a model is given by the learner, and no setting can say."""


@dataclass(frozen=True)
class StableBaselinesParameters:
    """Which algorithm, and its own hyper-parameters."""

    algorithm: Annotated[
        str, "class of stable_baselines3 or sb3_contrib: PPO, A2C, DQN, RecurrentPPO, ..."
    ] = "PPO"
    policy: Annotated[
        str | None, "the library's policy; null takes MlpPolicy, or MlpLstmPolicy if recurrent"
    ] = None
    settings: Annotated[
        dict[str, Any], "given to the class as they are, such as {n_steps: 60, gamma: 0.8}"
    ] = field(default_factory=dict)
    episode: Annotated[
        Literal["attempt", "trial"], "what an episode is: nothing that follows it is valued"
    ] = "attempt"
    total_actions: Annotated[
        int | None,
        "of a whole run, for schedules (exploration of DQN); null takes the most that the protocol "
        "allows",
    ] = None
    threads: Annotated[int, "of torch; more than one gains nothing at this size"] = 1

    def __post_init__(self) -> None:
        for name in OURS:
            if name in self.settings:
                raise ValueError(f"settings cannot hold {name!r}, which the learner itself sets")
        for name in ("total_actions", "threads"):
            if (getattr(self, name) or 1) < 1:
                raise ValueError(f"{name} must be at least 1")


class Told(NamedTuple):
    """What one action led to, for one subject."""

    outcome: NDArray[np.int8]
    reward: float
    terminated: bool
    truncated: bool
    next: NDArray[np.int8]


class _Ended(BaseException):
    """Nobody asks any more: ends a model's ``learn``."""


class _Room(gymnasium.Env[NDArray[np.int8], np.int64]):
    """What a model takes for its environment."""

    def __init__(self, brief: Brief) -> None:
        self.observation_space = spaces.MultiBinary(brief.observation_size)
        self.action_space: spaces.Space[Any] = spaces.Discrete(brief.actions)
        self.questions: SimpleQueue[Told | None] = SimpleQueue()
        self.answers: SimpleQueue[int | Exception] = SimpleQueue()
        self._observation = np.zeros(brief.observation_size, dtype=np.int8)

    def wait(self) -> Told:
        """Wait for what comes next."""
        told = self.questions.get()
        if told is None:
            raise _Ended
        self._observation = told.next
        return told

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """The room as it stands: the session has put it back."""
        super().reset(seed=seed)
        return self._observation.copy(), {}

    def step(self, action: np.int64) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        """Answer with an action, and wait for what comes of it."""
        self.answers.put(int(action))
        told = self.wait()
        return told.outcome, told.reward, told.terminated, told.truncated, {}


class _Player:
    """A model, the thread that it learns in, and global generators that only it draws from."""

    def __init__(self, kind: Any, policy: str, settings: Mapping[str, Any], brief: Brief) -> None:
        self._room = _Room(brief)
        self._thread: threading.Thread | None = None
        outside = GlobalRandomness.now()
        try:
            self.model = kind(policy, self._room, **settings)
            if "tensorboard_log" not in settings:  # or it makes a folder for each model
                self.model.set_logger(_silent())
            self._randomness = GlobalRandomness.now()
        finally:
            outside.restore()

    def answer(self, told: Told, total: int) -> int:
        """The model's next action, after all that it does before it chooses."""
        outside = GlobalRandomness.now()
        self._randomness.restore()
        try:
            self._room.questions.put(told)
            if self._thread is None:
                arguments = (self.model, self._room, total)
                self._thread = threading.Thread(target=_run, args=arguments, daemon=True)
                self._thread.start()
            answer = self._room.answers.get()
        finally:
            self._randomness = GlobalRandomness.now()
            outside.restore()
        if isinstance(answer, Exception):
            raise LearnerError(
                f"{type(self.model).__name__} of Stable-Baselines3 failed while it learned "
                f"({type(answer).__name__}: {answer}); look at its settings"
            ) from answer
        return answer

    def end(self) -> None:
        """Let the thread end, before the interpreter might end around it."""
        self._room.questions.put(None)
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()


def _silent() -> Any:
    """A logger of the library that writes nothing."""
    from stable_baselines3.common.logger import Logger

    return Logger(folder=None, output_formats=[])


def _run(model: Any, room: _Room, total: int) -> None:
    """Learn, and when that is over go on playing by what was learned, until nobody asks."""
    try:
        room.wait()
        model.learn(total_timesteps=total)
        memory, fresh = None, np.ones(1, dtype=bool)
        while True:
            action, memory = model.predict(room.reset()[0][None], memory, fresh)
            _, _, terminated, truncated, _ = room.step(action[0])
            fresh = np.array([terminated or truncated])
    except _Ended:
        pass
    except Exception as error:  # whatever it is, who waits for an answer has to know
        room.answers.put(error)


def _end(players: list[_Player]) -> None:
    for player in players:
        player.end()


def find_algorithm(name: str) -> Any:
    """A class of ``stable_baselines3`` or ``sb3_contrib``.

    Raises:
        LearnerError: If the libraries are not installed or have no such class.
    """
    missing = []
    places = []
    for library in LIBRARIES:
        try:
            places.append(import_module(library))
        except ImportError:
            missing.append(library)
    if LIBRARIES[0] in missing:
        raise LearnerError(
            "the learner sb3 needs Stable-Baselines3, which is not installed; install it with "
            "pip install 'causal-openlock[sb3]'"
        )
    known = {
        key: value
        for place in places
        for key, value in vars(place).items()
        if isinstance(value, type) and hasattr(value, "policy_aliases")
    }
    if name not in known:
        also = "; more come with pip install 'causal-openlock[sb3]'" if missing else ""
        raise LearnerError(f"there is no algorithm {name!r}; {nearest(name, known)}{also}")
    return known[name]


class StableBaselines(Learner):
    """An algorithm of Stable-Baselines3 (extra ``sb3``), one model for each subject."""

    Parameters = StableBaselinesParameters
    parameters: StableBaselinesParameters

    def begin(self, brief: Brief) -> None:
        """Make a model for each subject."""
        kind = find_algorithm(self.parameters.algorithm)
        import torch

        torch.set_num_threads(self.parameters.threads)
        self.brief = brief
        most = brief.trials * brief.attempt_limit * brief.action_limit
        self._total = self.parameters.total_actions or most
        self._seeds = [int(generator.integers(2**31 - 1)) for generator in brief.generators]
        # Of every step so far, what the subjects were told, packed; and what is not passed on yet.
        self._history: list[tuple[NDArray[Any], ...]] = []
        self._pending: list[Told | None] = []
        self._actions: IntArray = np.zeros(brief.subjects, dtype=np.int64)
        self._make_players(kind)

    def _make_players(self, kind: Any) -> None:
        chosen = self.parameters
        plain = "MlpPolicy" if "MlpPolicy" in kind.policy_aliases else "MlpLstmPolicy"
        policy = chosen.policy or plain
        self._players: list[_Player] = []
        # Threads know their players and not the learner, which may be forgotten meanwhile.
        weakref.finalize(self, _end, self._players)
        for seed in self._seeds:
            settings = {"device": "cpu", "verbose": 0, **chosen.settings, "seed": seed}
            try:
                player = _Player(kind, policy, settings, self.brief)
            except Exception as error:  # the library refuses settings in many ways
                raise LearnerError(
                    f"{chosen.algorithm} of Stable-Baselines3 refuses its settings: "
                    f"{type(error).__name__}: {error}"
                ) from error
            self._players.append(player)

    def act(self, view: View) -> IntArray:
        """``[B]`` what each model does next."""
        if not self._history:
            first = view.observation.copy()
            self._pending = [Told(row, 0.0, False, False, row) for row in first]
            self._history.append((_packed(first),))
        for subject in np.flatnonzero(view.playing):
            self._ask(int(subject))
        return self._actions.copy()

    def _ask(self, subject: int) -> None:
        told = self._pending[subject]
        if told is not None:
            self._actions[subject] = self._players[subject].answer(told, self._total)
            self._pending[subject] = None

    def learn(self, step: Step) -> None:
        """Keep what happened, until the models are asked again."""
        if self.parameters.episode == "attempt":
            terminated, truncated = step.attempt_over, step.trial_over & False
            outcome = step.outcome
        else:
            solved = step.view.console.solutions_left == step.new_solution
            terminated, truncated = step.trial_over & solved, step.trial_over & ~solved
            over = step.trial_over[:, None]
            outcome = np.where(over, step.outcome, step.next.observation)
        self._tell(
            outcome, step.next.observation, step.reward, terminated, truncated, step.view.playing
        )

    def _tell(self, *told: NDArray[Any]) -> None:
        outcome, following, reward, terminated, truncated, playing = (part.copy() for part in told)
        packed = _packed(outcome), _packed(following), reward, terminated, truncated, playing
        self._history.append(packed)
        for subject in np.flatnonzero(playing):
            self._pending[subject] = Told(
                outcome[subject],
                float(reward[subject]),
                bool(terminated[subject]),
                bool(truncated[subject]),
                following[subject],
            )

    def state_dict(self) -> dict[str, Any]:
        """The models' seeds and all that they were told."""
        asked = [told is None for told in self._pending]
        return {"seeds": list(self._seeds), "history": list(self._history), "asked": asked}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Bring new models to where the old ones were, which takes as long as it did then."""
        _end(self._players)
        self._seeds, self._history = list(state["seeds"]), []
        self._make_players(find_algorithm(self.parameters.algorithm))
        if not state["history"]:
            return
        first, *later = state["history"]
        observation = self._unpacked(first[0])
        self._history.append((first[0].copy(),))
        self._pending = [Told(row, 0.0, False, False, row) for row in observation]
        for outcome, following, *rest in later:
            for subject in np.flatnonzero(rest[-1]):
                self._ask(int(subject))
            self._tell(self._unpacked(outcome), self._unpacked(following), *rest)
        for number, asked in enumerate(state["asked"]):
            if asked:
                self._ask(number)

    def _unpacked(self, bits: NDArray[np.uint8]) -> NDArray[np.int8]:
        whole = np.unpackbits(bits, axis=1, count=self.brief.observation_size)
        return whole.astype(np.int8)


def _packed(observation: NDArray[np.int8]) -> NDArray[np.uint8]:
    return np.packbits(observation.astype(bool), axis=1)
