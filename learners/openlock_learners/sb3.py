"""Any algorithm of Stable-Baselines3 as a learner: PPO, A2C, DQN, RecurrentPPO of sb3-contrib.

Stable-Baselines3 drives its environment itself, and a session drives its learners. So each subject
has a model of its own, whose ``learn`` runs in a thread, on an environment that passes its actions
to the session and waits for their outcome. One thread runs at a time, with global generators of its
own, which the library draws from and seeds: the same seed and the same room give the same actions
as without this learner. A model in the midst of ``learn`` cannot be saved. What it was given is
saved, some forty bytes for each action, and a new model is brought to the same point with it.

It gives no probabilities: each algorithm has its own way of exploring, and a model learns from its
own actions, so it could not be in another subject's place.

Of a trained model's file only tensors are read. What else is in there the library would unpickle,
which runs code of whoever made the file; so the model is made from ``algorithm`` and ``settings``.
"""

from __future__ import annotations

import inspect
import threading
import weakref
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import import_module
from io import BytesIO
from queue import SimpleQueue
from typing import Annotated, Any, Literal

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.learner import Brief, Learner, Observations, Step, View
from causal_openlock.errors import LearnerError, in_short, with_kind
from causal_openlock.files.checksums import digest
from causal_openlock.schemas.fsm import IntArray
from causal_openlock.wording import nearest
from openlock_learners.trained_file import content_of

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
    model: Annotated[
        str | None, "file of a trained model, as the library saves it; its weights are taken"
    ] = None
    prior_attempts: Annotated[
        int | None, "attempts that it was trained with; null if nobody knows"
    ] = None
    learns: Annotated[bool, "whether it goes on learning; a trained model can be frozen"] = True

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


class _Player(gymnasium.Env[Observations, np.int64]):
    """A model with its environment, the thread that it learns in, and its own global generators.

    In the environment the session takes the model's actions and says what they led to.
    """

    def __init__(self, kind: Any, policy: str, settings: dict[str, Any], brief: Brief) -> None:
        import torch  # noqa: F401  # so that its generator is among the global ones

        self.observation_space = spaces.MultiBinary(brief.observation_size)
        self.action_space: spaces.Space[Any] = spaces.Discrete(brief.actions)
        self._feedback: SimpleQueue[np.void | None] = SimpleQueue()
        self._actions: SimpleQueue[int | Exception] = SimpleQueue()
        self._thread: threading.Thread | None = None
        with GlobalRandomness.seeded(settings["seed"]):
            self.model = kind(policy, self, **settings)
            if "tensorboard_log" not in settings:  # or it makes a folder for each model
                from stable_baselines3.common.logger import Logger

                self.model.set_logger(Logger(folder=None, output_formats=[]))
            self._randomness = GlobalRandomness.now()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """The observation now: the session resets the room itself."""
        super().reset(seed=seed)
        return self._observation.copy(), {}

    def step(self, action: np.int64) -> tuple[Observations, float, bool, bool, dict[str, Any]]:
        """Pass on an action, and wait for what it led to."""
        self._actions.put(int(action))
        led_to = self._wait()
        over = bool(led_to["terminated"]), bool(led_to["truncated"])
        return led_to["outcome"].copy(), float(led_to["reward"]), *over, {}

    def _wait(self) -> np.void:
        """Wait for what the last action led to, and for the observation to act on now."""
        feedback = self._feedback.get()
        if feedback is None:
            raise _Ended
        self._observation = feedback["seen"]
        return feedback

    def act(self, feedback: np.void, actions: int) -> int:
        """The model's next action, after all that it does before it chooses.

        Args:
            feedback: What it acts on, and what its last action led to.
            actions: How many it learns from, of the whole run.
        """
        outside = GlobalRandomness.now()
        self._randomness.restore()
        try:
            self._feedback.put(feedback)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, args=(actions,), daemon=True)
                self._thread.start()
            action = self._actions.get()
        finally:
            self._randomness = GlobalRandomness.now()
            outside.restore()
        if isinstance(action, Exception):
            raise LearnerError(
                f"{type(self.model).__name__} of Stable-Baselines3 failed while it learned "
                f"({type(action).__name__}: {action}); look at its settings"
            ) from action
        return action

    def _run(self, actions: int) -> None:
        """Learn, then play with what was learned until no more actions are needed."""
        try:
            self._wait()
            if actions:
                self.model.learn(total_timesteps=actions)
            elif hasattr(self.model, "exploration_final_eps"):  # as it ends to explore
                self.model.exploration_rate = self.model.exploration_final_eps
            memory, fresh = None, np.ones(1, dtype=bool)
            while True:
                action, memory = self.model.predict(self._observation[None], memory, fresh)
                _, _, terminated, truncated, _ = self.step(action[0])
                fresh = np.array([terminated or truncated])
        except _Ended:
            pass
        except Exception as error:  # whatever it is, the session waits for an action
            self._actions.put(error)

    @staticmethod
    def end_all(players: list[_Player]) -> None:
        """Let their threads end, before the interpreter might end around them."""
        for player in players:
            player._feedback.put(None)
            if player._thread is not None and player._thread is not threading.current_thread():
                player._thread.join()


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
    given = {**settings, **pairs}
    if of_policy:
        given["policy_kwargs"] = of_policy
    return given


class StableBaselines(Learner):
    """An algorithm of Stable-Baselines3 (extra ``sb3``), one model for each subject."""

    Parameters = StableBaselinesParameters
    parameters: StableBaselinesParameters
    learns_from_others = False  # a model takes for granted that its own action was done

    @classmethod
    def artifact_hash(cls, parameters: StableBaselinesParameters) -> str:
        """A hash of the trained model."""
        return digest(content_of(parameters.model)) if parameters.model else ""

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
        most = brief.trials * brief.attempt_limit * brief.action_limit
        self._learned_from = most if self.parameters.learns else 0
        self._seeds = [int(generator.integers(2**31 - 1)) for generator in brief.generators]
        room = (np.int8, (brief.observation_size,))
        flags = [(name, bool) for name in ("terminated", "truncated", "playing")]
        self._row = np.dtype([("seen", *room), ("outcome", *room), ("reward", float), *flags])
        self._led_to = np.zeros(brief.subjects, self._row)
        self._history: list[NDArray[np.void]] = []  # all that the models were given
        self._make_players()

    def _make_players(self) -> None:
        chosen, kind = self.parameters, find_algorithm(self.parameters.algorithm)
        plain = "MlpPolicy" if "MlpPolicy" in kind.policy_aliases else "MlpLstmPolicy"
        weights = _weights(chosen.model) if chosen.model else None
        self._players: list[_Player] = []
        # The players hold no reference to the learner, so that it can be collected and ends them.
        weakref.finalize(self, _Player.end_all, self._players)
        for seed in self._seeds:
            try:
                given = {"device": "cpu", "verbose": 0, **as_python(chosen.settings), "seed": seed}
                player = _Player(kind, chosen.policy or plain, given, self.brief)
                if weights is not None:
                    player.model.set_parameters(weights, device=player.model.device)
            except Exception as error:  # the library refuses settings and weights in many ways
                of = f" for the weights in {chosen.model}" if weights else ""
                raise LearnerError(
                    f"{chosen.algorithm} of Stable-Baselines3 refuses its settings{of}: "
                    + with_kind(error)
                ) from error
            self._players.append(player)

    def act(self, view: View) -> IntArray:
        """``[B]`` the action of each model."""
        given = self._led_to.copy()
        given["seen"], given["playing"] = view.observation, view.playing
        self._history.append(given)
        return self._answers(given)

    def _answers(self, given: NDArray[np.void]) -> IntArray:
        """``[B]`` the models' actions, once they know what their last ones led to."""
        actions = np.zeros(self.brief.subjects, dtype=np.int64)
        for subject in np.flatnonzero(given["playing"]).tolist():
            actions[subject] = self._players[subject].act(given[subject], self._learned_from)
        return actions

    def learn(self, step: Step) -> None:
        """Keep what the actions led to until the models act again."""
        row, over = self._led_to, step.trial_over
        row["outcome"], row["reward"] = step.outcome, step.reward
        row["terminated"] = step.attempt_over
        if self.parameters.episode == "trial":
            solved = step.view.console.solutions_left == step.new_solution
            row["terminated"], row["truncated"] = over & solved, over & ~solved
            row["outcome"] = np.where(over[:, None], step.outcome, step.next.observation)

    def __getstate__(self) -> dict[str, Any]:
        """All but the models."""
        kept = {name: part for name, part in vars(self).items() if name != "_players"}
        return {**kept, "_history": np.array(self._history, self._row)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Bring new models to the same point, which takes as long as it did then."""
        vars(self).update(state)
        self._history = [*state["_history"]]
        self._make_players()
        for given in self._history:
            self._answers(given)

    def updates_made(self) -> int | None:
        """How often its models have learned; None if they are frozen."""
        counts = [getattr(player.model, "_n_updates", 1) for player in self._players]
        return sum(counts) if self.parameters.learns else None


def _weights(model: str) -> dict[str, Any]:
    """The tensors of a trained model's file; nothing is unpickled."""
    from stable_baselines3.common.save_util import load_from_zip_file

    content = BytesIO(content_of(model))
    try:
        return load_from_zip_file(content, load_data=False, device="cpu")[1]
    except Exception as error:  # whatever else the file is
        raise LearnerError(
            f"{model} is not a model that Stable-Baselines3 has saved ({in_short(error)})"
        ) from None
