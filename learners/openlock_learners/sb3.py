"""Any algorithm of Stable-Baselines3 as a learner: PPO, A2C, DQN, RecurrentPPO of sb3-contrib.

Stable-Baselines3 drives its environment itself, and a session drives its learners. Here each
subject has a model of its own, whose ``learn`` runs in a thread of its own, on an environment that
passes its actions to the session and waits for their outcome. One thread runs at a time, so that
everything happens in the same order each time, and the library works as it always does: the same
seed and the same room give the same actions as without this learner.

The library draws from NumPy's, torch's and Python's global generators, and seeds them. Each model
has global generators of its own. It gives no probabilities: each algorithm has its own way of
exploring, and a model learns from its own actions, so it could not be in another subject's place.

A model in the midst of ``learn`` cannot be saved. What it was given is saved, some forty bytes for
each action, and a new model is brought to the same point with it.

Of a trained model's file only tensors are read. What else is in there the library would unpickle,
which runs code of whoever made the file; so the model is made from ``algorithm`` and ``settings``.
"""

from __future__ import annotations

import inspect
import threading
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from queue import SimpleQueue
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Brief, Learner, Observations, Step, View
from causal_openlock.contract.parameters import Count
from causal_openlock.errors import LearnerError, in_short
from causal_openlock.files.digest import digest
from causal_openlock.schemas.fsm import IntArray
from causal_openlock.wording import nearest

OURS = ("policy", "env", "seed", "_init_setup_model")
"""Arguments of a model that the learner sets, so that ``settings`` cannot."""
CLASSES = {"activation_fn": "torch.nn", "optimizer_class": "torch.optim"}
"""Modules of the classes that ``policy_kwargs`` names."""


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
    model: Annotated[
        str | None, "file of a trained model, as the library saves it; its weights are taken"
    ] = None
    prior_attempts: Annotated[
        int | None, "attempts that it was trained with; null if nobody knows"
    ] = None
    learns: Annotated[bool, "whether it goes on learning; a trained model can be frozen"] = True
    threads: Annotated[Count, "of torch; more than one gains nothing at this size"] = 1

    def __post_init__(self) -> None:
        for name in OURS:
            if name in self.settings:
                raise ValueError(f"settings cannot hold {name!r}, which the learner itself sets")
        if self.model is None and (self.prior_attempts is not None or not self.learns):
            raise ValueError(
                "prior_attempts and learns: false belong to a trained model; name its file in model"
            )


class _Ended(BaseException):
    """No more actions are needed: ends a model's ``learn``."""


class _Environment(gymnasium.Env[Observations, np.int64]):
    """The environment of a model; feedback is a row of the learner's history."""

    def __init__(self, brief: Brief) -> None:
        self.observation_space = spaces.MultiBinary(brief.observation_size)
        self.action_space: spaces.Space[Any] = spaces.Discrete(brief.actions)
        self.feedback: SimpleQueue[np.void | None] = SimpleQueue()
        self.actions: SimpleQueue[int | Exception] = SimpleQueue()
        self._observation = np.zeros(brief.observation_size, dtype=np.int8)

    def wait(self) -> np.void:
        """Wait for feedback."""
        feedback = self.feedback.get()
        if feedback is None:
            raise _Ended
        self._observation = feedback["next"]
        return feedback

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """The observation now: the session resets the room itself."""
        super().reset(seed=seed)
        return self._observation.copy(), {}

    def step(self, action: np.int64) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Pass on an action, and wait for what it led to."""
        self.actions.put(int(action))
        feedback = self.wait()
        over = bool(feedback["terminated"]), bool(feedback["truncated"])
        return feedback["outcome"].copy(), float(feedback["reward"]), *over, {}


class _Model:
    """A model, the thread that it learns in, and global generators of its own.

    They begin as ``random.seed``, ``numpy.random.seed`` and ``torch.manual_seed`` would set them.
    """

    def __init__(self, kind: Any, policy: str, settings: dict[str, Any], brief: Brief) -> None:
        import torch  # noqa: F401  # so that its generator is among the global ones

        self._environment = _Environment(brief)
        self._thread: threading.Thread | None = None
        with GlobalRandomness.seeded(settings["seed"]) as self._randomness:
            pass
        with self._own_randomness():
            self.model = kind(policy, self._environment, **settings)
            if "tensorboard_log" not in settings:  # or it makes a folder for each model
                from stable_baselines3.common.logger import Logger

                self.model.set_logger(Logger(folder=None, output_formats=[]))

    @contextmanager
    def _own_randomness(self) -> Iterator[None]:
        outside = GlobalRandomness.now()
        self._randomness.restore()
        try:
            yield
        finally:
            self._randomness = GlobalRandomness.now()
            outside.restore()

    def act(self, feedback: np.void, actions: int) -> int:
        """The model's next action, after all that it does before it chooses.

        Args:
            feedback: What its last action led to.
            actions: How many it learns from, of the whole run.
        """
        with self._own_randomness():
            self._environment.feedback.put(feedback)
            if self._thread is None:
                arguments = (self.model, self._environment, actions)
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


def _run(model: Any, environment: _Environment, actions: int) -> None:
    """Learn, then play with what was learned until no more actions are needed."""
    try:
        environment.wait()
        if actions:
            model.learn(total_timesteps=actions)
        elif hasattr(model, "exploration_final_eps"):  # as it ends to explore
            model.exploration_rate = model.exploration_final_eps
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
    for library in ("stable_baselines3", "sb3_contrib"):
        with suppress(ImportError):
            known |= vars(import_module(library))
    known = {key: value for key, value in known.items() if hasattr(value, "policy_aliases")}
    if name not in known:
        install = "pip install 'causal-openlock[sb3]' has all of Stable-Baselines3"
        raise LearnerError(
            f"there is no algorithm {name!r} here; {nearest(name, known)}; {install}"
        )
    return known[name]


def as_python(settings: dict[str, Any]) -> dict[str, Any]:
    """Settings as the library takes them: pairs as tuples, and the classes that names stand for.

    >>> as_python({"train_freq": [1, "episode"]})
    {'train_freq': (1, 'episode')}
    >>> as_python({"policy_kwargs": {"activation_fn": "ReLU"}})["policy_kwargs"]
    {'activation_fn': <class 'torch.nn.modules.activation.ReLU'>}
    """
    of_policy = dict(settings.get("policy_kwargs", {}))
    for key, module in CLASSES.items():
        if isinstance(name := of_policy.get(key), str):
            known = {k: v for k, v in vars(import_module(module)).items() if inspect.isclass(v)}
            if name not in known:
                raise LearnerError(f"{module} has no {key} {name!r}; {nearest(name, known)}")
            of_policy[key] = known[name]
    pairs = {key: tuple(value) for key, value in settings.items() if isinstance(value, list)}
    return {**settings, **pairs, **({"policy_kwargs": of_policy} if of_policy else {})}


class StableBaselines(Learner):
    """An algorithm of Stable-Baselines3 (extra ``sb3``), one model for each subject."""

    Parameters = StableBaselinesParameters
    parameters: StableBaselinesParameters
    learns_from_others = False  # a model takes for granted that its own action was done

    @classmethod
    def artifact_hash(cls, parameters: StableBaselinesParameters) -> str:
        """A hash of the trained model."""
        try:
            return digest(Path(parameters.model).read_bytes()) if parameters.model else ""
        except (OSError, ValueError) as error:
            raise LearnerError(f"{parameters.model} cannot be read: {in_short(error)}") from None

    @classmethod
    def prior_attempts(cls, parameters: StableBaselinesParameters) -> int | None:
        """Those of the trained model."""
        return 0 if parameters.model is None else parameters.prior_attempts

    @classmethod
    def first_update(cls, parameters: StableBaselinesParameters) -> int:
        """The algorithm's ``n_steps`` or ``learning_starts``, whichever is more."""
        try:
            arguments = inspect.signature(find_algorithm(parameters.algorithm)).parameters
        except LearnerError:  # which is said when it plays
            return 0
        numbers = [
            parameters.settings.get(name, arguments[name].default)
            for name in ("n_steps", "learning_starts")
            if name in arguments
        ]
        return max((int(n) for n in numbers if isinstance(n, int) and parameters.learns), default=0)

    def begin(self, brief: Brief) -> None:
        """Make a model for each subject."""
        super().begin(brief)
        self._seeds = [int(generator.integers(2**31 - 1)) for generator in brief.generators]
        observation = (np.int8, (brief.observation_size,))
        flags = [(name, bool) for name in ("terminated", "truncated", "playing")]
        self._row = np.dtype(
            [("outcome", *observation), ("next", *observation), ("reward", float), *flags]
        )
        self._history: list[NDArray[np.void]] = []  # what was seen first, and then all feedback
        self._passed_on = 0  # how much of it the models have got
        self._actions: IntArray = np.zeros(brief.subjects, dtype=np.int64)
        self._make_models()

    def _make_models(self) -> None:
        chosen, kind = self.parameters, find_algorithm(self.parameters.algorithm)
        plain = "MlpPolicy" if "MlpPolicy" in kind.policy_aliases else "MlpLstmPolicy"
        weights = None if chosen.model is None else _weights(chosen.model)
        self._models: list[_Model] = []
        # The models hold no reference to the learner, so that it can be collected and ends them.
        self._end = weakref.finalize(self, _Model.end_all, self._models)
        for seed in self._seeds:
            try:
                given = as_python(chosen.settings)
                settings = {"device": "cpu", "verbose": 0, **given, "seed": seed}
                model = _Model(kind, chosen.policy or plain, settings, self.brief)
                if weights is not None:
                    model.model.set_parameters(weights, device=model.model.device)
            except Exception as error:  # the library refuses settings and weights in many ways
                of = f" for the weights in {chosen.model}" if weights else ""
                raise LearnerError(
                    f"{chosen.algorithm} of Stable-Baselines3 refuses its settings{of}: "
                    f"{type(error).__name__}: {in_short(error)}"
                ) from error
            self._models.append(model)

    def act(self, view: View) -> IntArray:
        """``[B]`` the action of each model."""
        if not self._history:
            first = np.zeros(self.brief.subjects, self._row)
            first["next"], first["playing"] = view.observation, view.playing
            self._history.append(first)
        self._pass_on(self._history[self._passed_on :])
        self._passed_on = len(self._history)
        return self._actions.copy()

    def _pass_on(self, history: Sequence[NDArray[np.void]]) -> None:
        """Give feedback to the models, and keep the actions that they answer with."""
        brief, chosen = self.brief, self.parameters
        most = brief.trials * brief.attempt_limit * brief.action_limit
        actions = (chosen.total_actions or most) if chosen.learns else 0
        for feedback in history:
            for subject in np.flatnonzero(feedback["playing"]).tolist():
                self._actions[subject] = self._models[subject].act(feedback[subject], actions)

    def learn(self, step: Step) -> None:
        """Keep the feedback until the models act again."""
        row = np.zeros(self.brief.subjects, self._row)
        row["outcome"], row["next"], row["reward"] = (
            step.outcome,
            step.next.observation,
            step.reward,
        )
        row["terminated"], row["playing"] = step.attempt_over, step.next.playing
        if self.parameters.episode == "trial":
            solved = step.view.console.solutions_left == step.new_solution
            row["terminated"] = step.trial_over & solved
            row["truncated"] = step.trial_over & ~solved
            over = step.trial_over[:, None]
            row["outcome"] = np.where(over, step.outcome, step.next.observation)
        self._history.append(row)

    def updates_made(self) -> int | None:
        """How often its models have learned; None if they are frozen."""
        counts = [getattr(model.model, "_n_updates", 1) for model in self._models]
        return sum(counts) if self.parameters.learns else None

    def __getstate__(self) -> dict[str, Any]:
        """All but the models: one in the midst of ``learn`` cannot be saved."""
        kept = {name: part for name, part in vars(self).items() if name not in ("_models", "_end")}
        return {**kept, "_history": np.array(self._history, self._row)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Bring new models to the same point, which takes as long as it did then."""
        vars(self).update(state)
        self._history = [*state["_history"]]
        self._make_models()
        self._pass_on(self._history[: self._passed_on])


def _weights(path: str) -> dict[str, Any]:
    """The tensors of a trained model's file; nothing is unpickled."""
    from stable_baselines3.common.save_util import load_from_zip_file

    try:
        _, weights, _ = load_from_zip_file(path, load_data=False, device="cpu")
    except Exception as error:  # whatever else the file is
        raise LearnerError(
            f"{path} is not a model that Stable-Baselines3 has saved ({in_short(error)})"
        ) from None
    return weights
