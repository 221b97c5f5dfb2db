"""Rewards: sums of terms, each a function of what one action led to.

The paper describes seven reward functions as changes to a basic one, so each is a *term* here and a
reward is the sum of its terms (paper, "Reward Functions"):

======================= ==========================================================================
``basic``               10 on the action that unlocks the door, 50 on the one that opens it.
``unique_solutions``    Takes both back unless the solution is new in this trial.
``state_change``        0.5 if the observation changed.
``negative_immovable``  -0.5 if the action moved nothing, levers and door alike.
``negative_repeat``     -0.25 if the action equals the one before it in the attempt.
``partial_sequence``    1 if the attempt's first action begins a solution; in place of
                        ``state_change`` there.
``solution_multiplier`` Multiplies both 10 and 50 of a new solution by 1.5 for each solution found
                        before it: 60, 90, 135.
======================= ==========================================================================

Every amount is a weight that can be changed: ``{solution_multiplier: 2.0}`` is the paper's reward
with another multiplier, ``{preset: basic, open: 100}`` the basic one with more for the door. Any
other reward can be a user-defined function (:class:`OwnReward`).

A reward is a function of :class:`Events`, for many actions at once. There are few different events,
so each function is evaluated once for all of them (:func:`rewards_by_event`) and looked up from
then on.

The authors' program of January 2018 paid something else than the text describes. Its rewards are a
list of cases, not a sum: the first case that applies pays and the others are ignored. They are the
presets ``authors_2018_*``, to test whether a result depends on the difference.
"""

from __future__ import annotations

import inspect
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from causal_openlock.errors import ExperimentError, failures_as
from causal_openlock.files.validation import StrictModel, plain, read
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.usercode import own_files
from causal_openlock.usercode.session_code import is_of_session, session_origin
from causal_openlock.wording import nearest
from causal_openlock.world import kernel
from causal_openlock.world.kernel import IDLE, NEW, ON_PATH, REPEATED, RETRACED, UNLOCKED, WORDS

BASIC_REWARD = "basic"  #: the plain reward, and the default of environments
PAPER_REWARD = "paper"  #: the paper's best combination, and the default of sessions and experiments
TERMS = (
    "basic",
    "unique_solutions",
    "state_change",
    "negative_immovable",
    "negative_repeat",
    "partial_sequence",
    "solution_multiplier",
)
Finite = Annotated[float, Field(allow_inf_nan=False)]


@dataclass(frozen=True)
class Events:
    """Events of N actions; every field is ``[N]``.

    Example:
        >>> Events.of(np.array([kernel.FIRST, kernel.OPENS]), np.array([0, 2])).opens
        array([False,  True])
    """

    first: BoolArray  #: it was the attempt's first action
    last: BoolArray  #: the attempt is over
    inactive: BoolArray  #: it was aimed at an inactive lever
    changed: BoolArray  #: something moved, so the observation changed
    unlocks: BoolArray  #: it unlocked the door
    unlocked: BoolArray  #: the door is unlocked now
    opens: BoolArray  #: it opened the door
    on_path: BoolArray  #: the actions so far are the beginning of a solution, or all of it
    repeated: BoolArray  #: it was the same action as the one before it in the attempt
    new: BoolArray  #: the levers of a solution are pushed that is not yet found in this trial
    retraced: BoolArray  #: the actions so far are the beginning of a solution already found
    found: IntArray  #: solutions found in earlier attempts of the trial

    @classmethod
    def of(cls, words: IntArray, found: IntArray) -> Events:
        """The events of N words of the kernel, ``[N]``, after ``[N]`` solutions found before.

        Arrays are read-only copies: a reward that changes them would be filed elsewhere.
        """
        facts = [name for name in cls.__dataclass_fields__ if name != "found"]
        arrays = {name: words & getattr(kernel, name.upper()) != 0 for name in facts}
        arrays["found"] = found.copy()
        for array in arrays.values():
            array.setflags(write=False)
        return cls(**arrays)


class RewardFunction(ABC):
    """The reward of actions."""

    name: str  #: of a preset, or another description
    is_own: ClassVar[bool] = False  #: whether it is code of a user

    @abstractmethod
    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""

    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data: its fields."""
        return {**vars(self)}

    def written(self) -> Any:
        """The reward in the form of an experiment file; see ``rewards.find_reward``."""
        return self.name


def rewards_by_event(
    rewards: Sequence[RewardFunction], words: NDArray[Any], solutions: int
) -> FloatArray:
    """``[F, WORDS, solutions + 1]`` what F rewards pay for each event, by solutions found before.

    ``words`` are the events that there are, without the bits that depend on the past.

    Example:
        >>> opens = np.array([kernel.OPENS | UNLOCKED])
        >>> rewards_by_event([find_reward("basic")], opens, 1)[0, opens]
        array([[50., 50.]])
    """
    # Every event with every past that it can have, and every number of solutions found before.
    pasts = [sum(bits) for bits in product((0, REPEATED), (0, NEW), (0, RETRACED))]
    some = np.unique(words[words & IDLE == 0] & (IDLE - 1)).astype(np.int64)
    word, found = np.meshgrid(np.add.outer(some, pasts), np.arange(solutions + 1), indexing="ij")
    can_be_new = (word & UNLOCKED != 0) & (found < solutions)
    can_retrace = (word & ON_PATH != 0) & (found > 0)
    can_be = (can_be_new | (word & NEW == 0)) & (can_retrace | (word & RETRACED == 0))
    word, found = word[can_be], found[can_be]
    paid = np.zeros((len(rewards), WORDS, solutions + 1))
    for by_event, reward in zip(paid, rewards, strict=True):
        by_event[word, found] = reward.pay(Events.of(word, found))
    return paid


class Weights(StrictModel, frozen=True):
    """What the terms pay; by default as in the paper."""

    unlock: Finite = Field(10.0, description="for unlocking the door (basic)")
    open: Finite = Field(50.0, description="for opening the door (basic)")
    state_change: Finite = Field(0.5, description="for a change of the observation")
    negative_immovable: Finite = Field(-0.5, description="for an action that moves nothing")
    negative_repeat: Finite = Field(-0.25, description="for the same action twice in a row")
    partial_sequence: Finite = Field(1.0, description="for a first action that begins a solution")
    solution_multiplier: Finite = Field(
        1.5, description="factor on unlock and open of a new solution, for each found before it"
    )


class RewardWeights(Weights, frozen=True):
    """Another reward's terms or preset, with other weights."""

    preset: str = Field(PAPER_REWARD, description="The reward that is changed.")
    terms: list[str] = Field([], description="Instead of a preset.")


@dataclass(frozen=True)
class Reward(RewardFunction):
    """A sum of terms.

    Example:
        >>> reward = find_reward({"preset": "basic", "open": 100})
        >>> reward.name, reward.weights.open
        ('basic(open=100)', 100.0)
    """

    name: str  #: a preset's, or the terms joined by ``+``; in parentheses the changed weights
    terms: tuple[str, ...]  #: in :data:`TERMS`
    weights: Weights = field(default_factory=Weights)

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""
        weights = self.weights
        basic = weights.unlock * events.unlocks + weights.open * events.opens
        begins = events.first & events.on_path
        moves = events.changed & ~begins if "partial_sequence" in self.terms else events.changed
        factor = weights.solution_multiplier**events.found
        paid = {
            "basic": basic,
            "unique_solutions": -basic * ~events.new,
            "state_change": weights.state_change * moves,
            "negative_immovable": weights.negative_immovable * ~events.changed,
            "negative_repeat": weights.negative_repeat * events.repeated,
            "partial_sequence": weights.partial_sequence * begins,
            "solution_multiplier": (factor - 1.0) * basic * events.new,
        }
        return sum((paid[term] for term in self.terms), np.zeros(len(basic)))

    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data, with the weights that differ from the paper's."""
        changed = self.weights.model_dump(exclude_defaults=True)
        data = {"name": self.name, "terms": self.terms}
        return {**data, "weights": changed} if changed else data

    def written(self) -> Any:
        """A preset's name, a list of terms, or either with the weights that the name lists."""
        base, _, listed = self.name.partition("(")
        preset = PRESETS.get(base)
        is_preset = isinstance(preset, Reward) and preset.terms == self.terms[: len(preset.terms)]
        form = base if is_preset else base.split("+")
        if not listed:
            return form
        weights = {name: getattr(self.weights, name) for name in re.findall(r"(\w+)=", listed)}
        return {"preset" if is_preset else "terms": form, **weights}


@dataclass(frozen=True)
class AuthorsReward(RewardFunction):
    """A reward of the authors' program of January 2018: the first case that applies pays."""

    name: str
    unique: bool = False  #: unlocking and opening pay only on the way to a solution not yet found
    multiplier: bool = False  #: a new solution pays 1, 1.5, 3.0, ... times as much, linearly
    partial: bool = False  #: 1 while the actions begin a solution and the door is still locked
    change: bool = False  #: 0.5 for a change of the observation
    immovable: bool = False  #: -0.5 for an inactive lever; a locked active one costs nothing
    repeat: bool = False  #: -0.25 for the same action twice in a row

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""
        # In the last action, completing a new solution is unique; before that, any sequence that
        # does not retrace one already found.
        unique = np.where(events.last, events.opens & events.new, ~events.retraced)
        factor = np.maximum(1.0, 1.5 * events.found) if self.multiplier else 1.0
        bonus = np.where(unique, factor, 1.0)
        due = unique | (not self.unique)
        return np.select(
            [
                events.opens & due,
                events.unlocked & due,
                events.on_path & self.partial,
                events.changed & self.change,
                events.repeated & self.repeat,
                events.inactive & self.immovable,
            ],
            [50.0 * bonus, 10.0 * bonus, 1.0, 0.5, -0.25, -0.5],
            default=0.0,
        )


@dataclass(frozen=True)
class OwnReward(RewardFunction):
    """A reward that is a user's function, loaded when it is evaluated.

    ``module:function`` names it, in a file of the working directory or next to the experiment file,
    or in an installed package; in Python it can be given itself, also one of a notebook's cell::

        def eager(events):
            # Opening the door pays more while fewer solutions are found.
            return 50.0 * events.opens / (1 + events.found) - 0.1

    It gets the :class:`Events` of N actions and returns N numbers, each of which must depend on the
    events of its own action alone: it is called once for all events that there can be.
    """

    name: str  #: ``module:function``
    source: str  #: name of its file, and a hash of it and of the user's modules that it imports
    is_own = True

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action.

        Raises:
            ExperimentError: If the function fails or does not return N finite numbers.
        """
        function, number = _function(self.name), len(events.first)
        with failures_as(ExperimentError, f"the reward {self.name} fails"):
            paid = np.asarray(function(events))
            is_number = paid.dtype.kind in "iufb"
            if paid.shape != (number,) or not is_number or not np.isfinite(paid).all():
                raise ExperimentError(
                    f"the reward {self.name} has to return one finite number for each of {number} "
                    f"actions, and returned {paid.dtype} of shape {paid.shape}: {paid}"
                )
        return paid.astype(np.float64)

    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data."""
        return {"name": self.name, "function": self.name, "source": self.source}


def own_reward(given: str | Callable[..., Any]) -> OwnReward:
    """A function, itself or as ``module:function``, as a reward, tried out on all events.

    Raises:
        ExperimentError: If there is no such function, workers cannot find it by a name, or it does
            not work as a reward.
    """
    name = given
    if not isinstance(name, str):
        name = f"{given.__module__}:{getattr(given, '__qualname__', '')}"
        if not (own_files.MODULE_AND_NAME.fullmatch(name) and _function(name) is given):
            raise ExperimentError(
                f"the reward {given!r} cannot be found by a name, as workers have to; define it "
                "with def at the top level of a notebook or of a module"
            )
    reward = OwnReward(name, reward_source(name))
    rewards_by_event([reward], np.arange(256), 2)
    return reward


def _function(name: str) -> Callable[[Events], Any]:
    """A user's function by its name."""
    function = own_files.load_named(name, "reward", inspect.isfunction)
    if not callable(function) or isinstance(function, type):
        raise ExperimentError(f"{name!r} is not a function; a reward is a function of events")
    return function


def reward_source(name: str) -> str:
    """The file of a user's function, with a hash of it as this process imported it."""
    _function(name)
    if is_of_session(name):
        return session_origin(name)
    module = name.partition(":")[0]  # even if it has the function from elsewhere
    source = own_files.module_source(module)
    if source is None:
        raise ExperimentError(f"{name!r} has no source that can be recorded; write it in a file")
    return f"{source.name} {own_files.code_digest([module], imported=True)}"


_AUTHORS_CASES = {
    "authors_2018_basic": "",
    "authors_2018_change_state": "change",
    "authors_2018_unique_solutions": "unique",
    "authors_2018_change_state_unique_solutions": "unique change",
    "authors_2018_negative_immovable": "immovable",
    "authors_2018_negative_immovable_unique_solutions": "unique immovable",
    "authors_2018_negative_immovable_negative_repeat": "immovable repeat",
    "authors_2018_negative_immovable_partial_action_seq": "immovable partial",
    "authors_2018_negative_immovable_solution_multiplier": "immovable multiplier",
    "authors_2018_negative_immovable_partial_action_seq_solution_multiplier": (
        "immovable partial multiplier"
    ),
    "authors_2018": "immovable partial multiplier",
}

PRESETS: dict[str, RewardFunction] = {
    # Each is added to the basic reward, as in the paper.
    **{term: Reward(term, tuple(dict.fromkeys(["basic", term]))) for term in TERMS},
    "partial_sequence": Reward("partial_sequence", ("basic", "state_change", "partial_sequence")),
    PAPER_REWARD: Reward(
        PAPER_REWARD, ("basic", "negative_immovable", "partial_sequence", "solution_multiplier")
    ),
    **{
        name: AuthorsReward(name, **dict.fromkeys(cases.split(), True))
        for name, cases in _AUTHORS_CASES.items()
    },
}


RewardForm = (
    str | Iterable[str] | Mapping[str, Any] | RewardFunction | Callable[[Events], ArrayLike]
)
"""Forms of a reward that :func:`find_reward` takes."""


def find_reward(reward: RewardForm) -> RewardFunction:
    """A reward by its description.

    Args:
        reward: The name of a preset; a list of terms that add up; weights by name, with the
            ``preset`` or the ``terms`` that they change (by default the paper's reward); or
            a user-defined function, itself or as ``module:function``.

    Raises:
        ExperimentError: If there is no such preset, a term or a weight is unknown or does not fit,
            or the function does not work as a reward.

    Example:
        >>> find_reward("paper").terms
        ('basic', 'negative_immovable', 'partial_sequence', 'solution_multiplier')
        >>> find_reward(["basic", "state_change"]).name
        'basic+state_change'
    """
    if isinstance(reward, RewardFunction):
        return reward
    if isinstance(reward, Mapping):
        return _weighted(read(RewardWeights, plain(reward)))
    if callable(reward) or (isinstance(reward, str) and ":" in reward):
        return own_reward(reward)
    if isinstance(reward, str):
        if reward not in PRESETS:
            raise ExperimentError(
                f"there is no reward {reward!r}; {nearest(reward, PRESETS)}; a function of your "
                "own is written module:function"
            )
        return PRESETS[reward]
    terms = tuple(reward) if isinstance(reward, Iterable) else ()
    for term in terms:
        if term not in TERMS:
            raise ExperimentError(f"there is no reward term {term!r}; {nearest(str(term), TERMS)}")
    if not terms or len({*terms}) < len(terms):
        raise ExperimentError(
            f"{reward!r} is not a reward; give a preset's name, terms, each once "
            f"({', '.join(TERMS)}), weights or a function"
        )
    return Reward("+".join(terms), terms)


def _weighted(asked: RewardWeights) -> Reward:
    """A reward with changed weights; a weight of a term that it does not have adds the term."""
    if {"preset", "terms"} <= asked.model_fields_set:
        raise ExperimentError("a reward is based on a preset or on terms; leave one of them out")
    form = asked.terms if "terms" in asked.model_fields_set else asked.preset
    is_code = ":" in form  # of which nobody was told, so it does not run
    if is_code or not isinstance(base := find_reward(form), Reward):
        raise ExperimentError(f"the reward {form} has no weights; base it on another preset")
    term_of = {name: name if name in TERMS else "basic" for name in Weights.model_fields}
    given = [name for name in term_of if name in asked.model_fields_set]
    added = [
        term for term in dict.fromkeys(term_of[name] for name in given) if term not in base.terms
    ]
    weights = Weights(**{name: getattr(asked, name) for name in given})
    changed = weights.model_dump(exclude_defaults=True)
    listed = [
        f"{name}={getattr(weights, name):g}"
        for name, term in term_of.items()
        if name in changed or term in added
    ]
    if not listed:
        return base
    return Reward(f"{base.name}({', '.join(listed)})", (*base.terms, *added), weights)
