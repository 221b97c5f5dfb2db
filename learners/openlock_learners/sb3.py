"""Any algorithm of Stable-Baselines3 as a learner: PPO, A2C, DQN, RecurrentPPO of sb3-contrib.

Stable-Baselines3 drives its environment itself, and a session drives its learners. Here each
subject has a model of its own, whose ``learn`` runs in a thread of its own, on an environment that
passes its actions to the session and waits for their outcome. One thread runs at a time, so that
everything happens in the same order each time, and the library works as it always does: the same
seed and the same room give the same actions as without this learner.

The library draws from NumPy's, torch's and Python's global generators, and seeds them. Each model
has global generators of its own (:class:`OwnRandomness`).

It gives no probabilities. Each algorithm has its own way of acting and of exploring, and a model
learns from the actions that it took itself, so it could not be put in another subject's place.

A model in the midst of ``learn`` cannot be saved. Everything that it was given is saved, a few
bytes for each action, and a new model is brought to the same point with it.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from queue import SimpleQueue
from typing import Annotated, Any, Literal, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.contract.parameters import Count
from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.wording import nearest

LIBRARIES = ("stable_baselines3", "sb3_contrib")
OURS = ("policy", "env", "seed", "_init_setup_model")
"""Arguments of a model that the learner sets, so that ``settings`` cannot."""


@dataclass(frozen=True)
class StableBaselinesParameters:
    """The algorithm, and its own hyper-parameters."""

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
        Count | None,
        "of a whole run, for schedules (exploration of DQN); null takes the most that the protocol "
        "allows",
    ] = None
    threads: Annotated[Count, "of torch; more than one gains nothing at this size"] = 1

    def __post_init__(self) -> None:
        for name in OURS:
            if name in self.settings:
                raise ValueError(f"settings cannot hold {name!r}, which the learner itself sets")


class Feedback(NamedTuple):
    """Outcome and reward of one action of one subject."""

    outcome: NDArray[np.int8]
    reward: float
    terminated: bool
    truncated: bool
    next: NDArray[np.int8]


class _Ended(BaseException):
    """No more actions are needed: ends a model's ``learn``."""


class OwnRandomness:
    """Global generators of a model's own: what it draws depends on nobody else.

    They begin as ``random.seed``, ``numpy.random.seed`` and ``torch.manual_seed`` would set them.
    """

    def __init__(self, seed: int) -> None:
        import torch  # noqa: F401  # so that its generator is among them

        with GlobalRandomness.seeded(seed) as self._states:
            pass

    @contextmanager
    def in_place(self) -> Iterator[None]:
        """A block in which these are the global generators."""
        outside = GlobalRandomness.now()
        self._states.restore()
        try:
            yield
        finally:
            self._states = GlobalRandomness.now()
            outside.restore()


class _Environment(gymnasium.Env[NDArray[np.int8], np.int64]):
    """The environment of a model."""

    def __init__(self, brief: Brief) -> None:
        self.observation_space = spaces.MultiBinary(brief.observation_size)
        self.action_space: spaces.Space[Any] = spaces.Discrete(brief.actions)
        self.feedback: SimpleQueue[Feedback | None] = SimpleQueue()
        self.actions: SimpleQueue[int | Exception] = SimpleQueue()
        self._observation = np.zeros(brief.observation_size, dtype=np.int8)

    def wait(self) -> Feedback:
        """Wait for feedback."""
        feedback = self.feedback.get()
        if feedback is None:
            raise _Ended
        self._observation = feedback.next
        return feedback

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.int8], dict[str, Any]]:
        """The observation now: the session resets the room itself."""
        super().reset(seed=seed)
        return self._observation.copy(), {}

    def step(self, action: np.int64) -> tuple[NDArray[np.int8], float, bool, bool, dict[str, Any]]:
        """Pass on an action, and wait for what it led to."""
        self.actions.put(int(action))
        outcome, reward, terminated, truncated, _ = self.wait()
        return outcome, reward, terminated, truncated, {}


class _Model:
    """A model, the thread that it learns in, and its global generators."""

    def __init__(self, kind: Any, policy: str, settings: Mapping[str, Any], brief: Brief) -> None:
        self._environment = _Environment(brief)
        self._thread: threading.Thread | None = None
        self._randomness = OwnRandomness(settings["seed"])
        with self._randomness.in_place():
            self.model = kind(policy, self._environment, **settings)
            if "tensorboard_log" not in settings:  # or it makes a folder for each model
                from stable_baselines3.common.logger import Logger

                self.model.set_logger(Logger(folder=None, output_formats=[]))

    def act(self, feedback: Feedback, total: int) -> int:
        """The model's next action, after all that it does before it chooses."""
        with self._randomness.in_place():
            self._environment.feedback.put(feedback)
            if self._thread is None:
                arguments = (self.model, self._environment, total)
                self._thread = threading.Thread(target=_run, args=arguments, daemon=True)
                self._thread.start()
            action = self._environment.actions.get()
        if isinstance(action, Exception):
            raise LearnerError(
                f"{type(self.model).__name__} of Stable-Baselines3 failed while it learned "
                f"({type(action).__name__}: {action}); look at its settings"
            ) from action
        return action

    @staticmethod
    def end_all(models: list[_Model]) -> None:
        """Let their threads end, before the interpreter might end around them."""
        for model in models:
            model._environment.feedback.put(None)
            if model._thread is not None and model._thread is not threading.current_thread():
                model._thread.join()


def _run(model: Any, environment: _Environment, total: int) -> None:
    """Learn, then play with what was learned until no more actions are needed."""
    try:
        environment.wait()
        model.learn(total_timesteps=total)
        memory, fresh = None, np.ones(1, dtype=bool)
        while True:
            action, memory = model.predict(environment.reset()[0][None], memory, fresh)
            _, _, terminated, truncated, _ = environment.step(action[0])
            fresh = np.array([terminated or truncated])
    except _Ended:
        pass
    except Exception as error:  # whatever it is, the session waits for an action
        environment.actions.put(error)


def find_algorithm(name: str) -> Any:
    """A class of ``stable_baselines3`` or ``sb3_contrib``.

    Raises:
        LearnerError: If the libraries are not installed or have no such class.
    """
    known: dict[str, Any] = {}
    missing = []
    for library in LIBRARIES:
        try:
            known |= vars(import_module(library))
        except ImportError:
            missing.append(library)
    if LIBRARIES[0] in missing:
        raise LearnerError(
            "the learner sb3 needs Stable-Baselines3, which is not installed; install it with "
            "pip install 'causal-openlock[sb3]'"
        )
    known = {key: value for key, value in known.items() if hasattr(value, "policy_aliases")}
    if name not in known:
        also = "; more come with pip install 'causal-openlock[sb3]'" if missing else ""
        raise LearnerError(f"there is no algorithm {name!r}; {nearest(name, known)}{also}")
    return known[name]


class StableBaselines(Learner):
    """An algorithm of Stable-Baselines3 (extra ``sb3``), one model for each subject."""

    Parameters = StableBaselinesParameters
    parameters: StableBaselinesParameters
    learns_from_others = False  # a model takes for granted that its own action was done

    def begin(self, brief: Brief) -> None:
        """Make a model for each subject."""
        kind = find_algorithm(self.parameters.algorithm)
        self.brief = brief
        most = brief.trials * brief.attempt_limit * brief.action_limit
        self._total = self.parameters.total_actions or most
        self._seeds = [int(generator.integers(2**31 - 1)) for generator in brief.generators]
        # What was seen first, and the feedback of every step so far; and by subject, what its model
        # has yet to get.
        bits = ("u1", -(-brief.observation_size // 8))
        flags = [(name, "?") for name in ("terminated", "truncated", "playing")]
        self._kept = np.dtype([("outcome", *bits), ("next", *bits), ("reward", "f8"), *flags])
        self._first: NDArray[np.uint8] | None = None
        self._history = bytearray()
        self._pending: list[Feedback | None] = []
        self._actions: IntArray = np.zeros(brief.subjects, dtype=np.int64)
        self._make_models(kind)

    def _make_models(self, kind: Any) -> None:
        chosen = self.parameters
        plain = "MlpPolicy" if "MlpPolicy" in kind.policy_aliases else "MlpLstmPolicy"
        policy = chosen.policy or plain
        self._models: list[_Model] = []
        # The models hold no reference to the learner, so that it can be collected and ends them.
        self._end = weakref.finalize(self, _Model.end_all, self._models)
        for seed in self._seeds:
            settings = {"device": "cpu", "verbose": 0, **chosen.settings, "seed": seed}
            try:
                model = _Model(kind, policy, settings, self.brief)
            except Exception as error:  # the library refuses settings in many ways
                raise LearnerError(
                    f"{chosen.algorithm} of Stable-Baselines3 refuses its settings: "
                    f"{type(error).__name__}: {error}"
                ) from error
            self._models.append(model)

    def act(self, view: View) -> IntArray:
        """``[B]`` the action of each model."""
        if self._first is None:
            self._begin_with(view.observation.copy())
        self._act(view.playing)
        return self._actions.copy()

    def _begin_with(self, observation: NDArray[np.int8]) -> None:
        self._pending = [Feedback(row, 0.0, False, False, row) for row in observation]
        self._first = _packed(observation)

    def _act(self, playing: BoolArray) -> None:
        for subject in np.flatnonzero(playing):
            if (feedback := self._pending[subject]) is not None:
                self._actions[subject] = self._models[subject].act(feedback, self._total)
                self._pending[subject] = None

    def learn(self, step: Step) -> None:
        """Keep the feedback until the models act again."""
        if self.parameters.episode == "attempt":
            terminated, truncated = step.attempt_over, step.trial_over & False
            outcome = step.outcome
        else:
            solved = step.view.console.solutions_left == step.new_solution
            terminated, truncated = step.trial_over & solved, step.trial_over & ~solved
            over = step.trial_over[:, None]
            outcome = np.where(over, step.outcome, step.next.observation)
        kept = np.empty(self.brief.subjects, self._kept)
        kept["outcome"], kept["next"] = _packed(outcome), _packed(step.next.observation)
        kept["reward"], kept["playing"] = step.reward, step.view.playing
        kept["terminated"], kept["truncated"] = terminated, truncated
        self._history += kept.tobytes()
        self._take(kept)

    def _take(self, kept: NDArray[np.void]) -> None:
        outcome, following = self._unpacked(kept["outcome"]), self._unpacked(kept["next"])
        reward, terminated, truncated = (
            kept[name].tolist() for name in ("reward", "terminated", "truncated")
        )
        for subject in np.flatnonzero(kept["playing"]):
            flags = reward[subject], terminated[subject], truncated[subject]
            self._pending[subject] = Feedback(outcome[subject], *flags, following[subject])

    def __getstate__(self) -> dict[str, Any]:
        """All but the models: one in the midst of ``learn`` cannot be saved."""
        return {name: part for name, part in vars(self).items() if name not in ("_models", "_end")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Bring new models to the same point, which takes as long as it did then."""
        vars(self).update(state)
        self._make_models(find_algorithm(self.parameters.algorithm))
        if self._first is None:
            return
        asked = np.array([feedback is None for feedback in self._pending])
        self._begin_with(self._unpacked(self._first))
        for kept in np.frombuffer(bytes(self._history), self._kept).reshape(-1, len(self._seeds)):
            self._act(kept["playing"])
            self._take(kept)
        self._act(asked)

    def _unpacked(self, bits: NDArray[np.uint8]) -> NDArray[np.int8]:
        whole = np.unpackbits(bits, axis=1, count=self.brief.observation_size)
        return whole.astype(np.int8)


def _packed(observation: NDArray[np.int8]) -> NDArray[np.uint8]:
    return np.packbits(observation.astype(bool), axis=1)
