"""Rewards: sums of terms, each a function of what one action led to.

The paper describes seven reward functions as changes to a basic one, so each is a *term* here and a
reward is the sum of its terms (paper, "Reward Functions"). A term is a pure function of what
happened in one action (:mod:`causal_openlock.world.events`), for many actions at once:

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

Every amount is a weight that can be changed (:class:`Weights`): ``{solution_multiplier: 2.0}`` is
the paper's reward with another multiplier, ``{preset: basic, open: 100}`` the basic one with more
for the door. Any other reward can be a user-defined function
(:mod:`causal_openlock.world.reward_code`).

The authors' program of January 2018 paid something else than the text describes. Its rewards are a
list of cases, not a sum: the first case that applies pays and the others are ignored. They are the
presets ``authors_2018_*``, to test whether a result depends on the difference.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Annotated, Any, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from causal_openlock.errors import ExperimentError
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.wording import nearest
from causal_openlock.world.events import Events as Events
from causal_openlock.world.events import RewardFunction as RewardFunction

UNLOCK, OPEN = 10.0, 50.0
MULTIPLIER = 1.5


@dataclass(frozen=True)
class Weights:
    """Weights of the terms; the texts explain each one to users."""

    unlock: Annotated[float, "for unlocking the door (basic)"] = UNLOCK
    open: Annotated[float, "for opening the door (basic)"] = OPEN
    state_change: Annotated[float, "for a change of the observation"] = 0.5
    negative_immovable: Annotated[float, "for an action that moves nothing"] = -0.5
    negative_repeat: Annotated[float, "for the same action twice in a row"] = -0.25
    partial_sequence: Annotated[float, "for a first action that begins a solution"] = 1.0
    solution_multiplier: Annotated[
        float, "factor on unlock and open of a new solution, for each found before it"
    ] = MULTIPLIER


WEIGHTS: dict[str, str] = {
    name: hint.__metadata__[0]
    for name, hint in get_type_hints(Weights, include_extras=True).items()
}
"""Explanation of each weight, by name."""


TERMS = (
    "basic",
    "unique_solutions",
    "state_change",
    "negative_immovable",
    "negative_repeat",
    "partial_sequence",
    "solution_multiplier",
)


@dataclass(frozen=True)
class Reward(RewardFunction):
    """A sum of terms.

    Attributes:
        name: A preset's name, or the terms joined by ``+``; in parentheses the changed weights.
        terms: Names of terms, in :data:`TERMS`.
        weights: What the terms pay.

    Example:
        >>> reward = find_reward({"preset": "basic", "open": 100})
        >>> reward.name, reward.weights.open
        ('basic(open=100)', 100.0)
    """

    name: str
    terms: tuple[str, ...]
    weights: Weights = Weights()

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
        papers = asdict(Weights())
        changed = {name: w for name, w in asdict(self.weights).items() if w != papers[name]}
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
    """A reward of the authors' program of January 2018: the first case that applies pays.

    Attributes:
        name: The preset's name.
        unique: Unlocking and opening pay only on the way to a solution not yet found.
        multiplier: A new solution pays 1, 1.5, 3.0, ... times as much, growing linearly.
        partial: 1 while the attempt's actions begin a solution and the door is still locked.
        change: 0.5 for a change of the observation.
        immovable: -0.5 for an inactive lever; a locked active one costs nothing.
        repeat: -0.25 for the same action twice in a row.
    """

    name: str
    unique: bool = False
    multiplier: bool = False
    partial: bool = False
    change: bool = False
    immovable: bool = False
    repeat: bool = False

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""
        # In the last action, completing a new solution is unique; before that, any sequence that
        # does not retrace one already found.
        unique = np.where(events.last, events.opens & events.new, ~events.retraced)
        factor = np.maximum(1.0, MULTIPLIER * events.found) if self.multiplier else 1.0
        bonus = np.where(unique, factor, 1.0)
        due = unique if self.unique else np.ones_like(unique)
        never = np.zeros_like(unique)
        return np.select(
            [
                events.opens & due,
                events.unlocked & due,
                events.on_path if self.partial else never,
                events.changed if self.change else never,
                events.repeated if self.repeat else never,
                events.inactive if self.immovable else never,
            ],
            [OPEN * bonus, UNLOCK * bonus, 1.0, 0.5, -0.25, -0.5],
            default=0.0,
        )


BASIC_REWARD = "basic"
"""The plain reward, and the default of environments."""
PAPER_REWARD = "paper"
"""The paper's best combination, and the default of sessions and experiments."""


_AUTHORS_CASES = {
    "basic": "",
    "change_state": "change",
    "unique_solutions": "unique",
    "change_state_unique_solutions": "unique change",
    "negative_immovable": "immovable",
    "negative_immovable_unique_solutions": "unique immovable",
    "negative_immovable_negative_repeat": "immovable repeat",
    "negative_immovable_partial_action_seq": "immovable partial",
    "negative_immovable_solution_multiplier": "immovable multiplier",
    "negative_immovable_partial_action_seq_solution_multiplier": "immovable partial multiplier",
}

PRESETS: dict[str, RewardFunction] = {
    # Each is added to the basic reward, as in the paper.
    **{term: Reward(term, tuple(dict.fromkeys(["basic", term]))) for term in TERMS},
    "partial_sequence": Reward("partial_sequence", ("basic", "state_change", "partial_sequence")),
    PAPER_REWARD: Reward(
        PAPER_REWARD, ("basic", "negative_immovable", "partial_sequence", "solution_multiplier")
    ),
    **{
        f"authors_2018_{name}": AuthorsReward(
            f"authors_2018_{name}", **dict.fromkeys(cases.split(), True)
        )
        for name, cases in _AUTHORS_CASES.items()
    },
    "authors_2018": AuthorsReward("authors_2018", immovable=True, partial=True, multiplier=True),
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
        return _weighted(reward)
    if callable(reward) or (isinstance(reward, str) and ":" in reward):
        from causal_openlock.world.reward_code import own_reward

        return own_reward(reward)
    if isinstance(reward, str):
        if reward not in PRESETS:
            raise ExperimentError(
                f"there is no reward {reward!r}; {nearest(reward, PRESETS)}; a function of your "
                "own is written module:function"
            )
        return PRESETS[reward]
    if not isinstance(reward, Iterable):
        raise ExperimentError(
            f"{reward!r} is not a reward; give a preset's name, terms, weights or a function"
        )
    terms = tuple(reward)
    for term in terms:
        if term not in TERMS:
            raise ExperimentError(f"there is no reward term {term!r}; {nearest(str(term), TERMS)}")
    if not terms or len({*terms}) < len(terms):
        raise ExperimentError(
            f"a reward has one term or more, each once, not {[*terms]}; known: {', '.join(TERMS)}"
        )
    return Reward("+".join(terms), terms)


def _weighted(description: Mapping[str, Any]) -> Reward:
    """A reward with changed weights; a weight of a term that it does not have adds the term."""
    given = dict(description)
    preset, terms = given.pop("preset", None), given.pop("terms", None)
    if preset is not None and terms is not None:
        raise ExperimentError("a reward is based on a preset or on terms; leave one of them out")
    base = find_reward(terms if terms is not None else preset or PAPER_REWARD)
    if not isinstance(base, Reward):
        raise ExperimentError(f"the reward {base.name} has no weights; base it on another preset")
    for name, value in given.items():
        if name not in WEIGHTS:
            raise ExperimentError(f"there is no weight {name!r}; {nearest(str(name), WEIGHTS)}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise ExperimentError(f"the weight {name} is a number, not {value!r}")
    weights = Weights(**{name: float(value) for name, value in given.items()})
    term_of = {name: name if name in TERMS else "basic" for name in WEIGHTS}
    all_terms = dict.fromkeys([*base.terms, *(term_of[name] for name in WEIGHTS if name in given)])
    listed = [
        f"{name}={value:g}"
        for name, value in asdict(weights).items()
        if value != getattr(Weights(), name) or term_of[name] in all_terms.keys() - {*base.terms}
    ]
    return Reward(f"{base.name}({', '.join(listed)})", (*all_terms,), weights) if listed else base
