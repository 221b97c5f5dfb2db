"""Conditions and protocols: the trials of a subject, and their budgets.

A *condition* is a sequence of trials: first those to train on, then perhaps those to test on.
``CC4`` is a baseline (rooms of the schema CC4), ``CC3-CC4`` a transfer (six rooms of CC3, then
CC4). The paper's six conditions have these two forms, which work with any other schemas too:
``chain3``, ``chain3-seven``. In ``shown-CC3-CC4`` the training is *shown*: in each of its rooms the
subject watches every solution once and does nothing itself; then it plays the test.

A *protocol* defines how a condition is played: how many attempts a trial has, whether it ends when
all solutions are found, how many trials there are and how often they are repeated.

* ``human``: 30 attempts; a trial ends as soon as everything is found; baseline 5 trials, transfer
  6 + 1 (paper, "Materials and Procedure").
* ``rl``: 300 attempts in every trial, also after everything is found; a baseline loops 10 times
  over its 5 trials; transfer loops 100 times over 6 training trials and 10 times over the 5 test
  trials (paper, "Model Results"). Figure 6 shows 150,000 attempts for each schema and Figure 7
  18,000 for each case, where these loops give 15,000 each. These protocols follow the text; the
  numbers of loops are parameters.
* ``rl_2020``: the one of *Theory-based Causal Transfer* (Edmonds et al., AAAI 2020) for learners by
  reinforcement: 700 attempts; a trial ends when everything is found; 200 loops over 5 trials, or
  over 6 training trials and then 5 test trials. It belongs with the reward ``unique_solutions``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cache
from typing import Any, Literal

import numpy as np

from causal_openlock.errors import FileError, LayoutError, OpenLockError, ProtocolError
from causal_openlock.files.validation import whole_number
from causal_openlock.schemas.finding import SUFFIXES
from causal_openlock.schemas.schema import NAME, Schema
from causal_openlock.wording import counted, nearest
from causal_openlock.world.room import Layout, positions_for, published_layouts

PAPER_ACTION_LIMIT = 3
MAX_ACTION_LIMIT = 63
HUMAN_PROTOCOL = "human"
"""The protocol under which people played in the paper."""

PAPER_CONDITIONS = ("CC4", "CE4", "CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4")
SHOWN = "shown"
"""The phase of training that is shown, and what the name of such a condition begins with."""
MOST_CHARACTERS = 9000
"""Most characters of a condition: two paths are never longer."""
LayoutSource = Literal["published", "random"]


def default_action_limit(schema: Schema) -> int:
    """Actions in an attempt by default: the paper's 3, or as many as the schema needs.

    Example:
        >>> from causal_openlock import find_schema
        >>> default_action_limit(find_schema("CC3"))
        3
    """
    return max(PAPER_ACTION_LIMIT, schema.least_action_limit)


@dataclass(frozen=True)
class Protocol:
    """Protocol: the budgets and rules under which a condition is played.

    Attributes:
        name: For the record.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial ends as soon as all its solutions are found.
        baseline_trials: Trials of a condition without a test. This number and the next two are
            defaults for conditions, lowered to the number of published layouts if those are used
            (there are five with four levers).
        training_trials: Trials to train on, in a condition with a test.
        test_trials: Trials to test on.
        baseline_loops: How often the trials of a baseline are repeated.
        train_loops: The same for trials to train on.
        test_loops: The same for trials to test on.
        layouts: The default source of layouts: those the paper's authors published, or random.
        test_layout: A published layout to test on, so that each loop over the test is one trial
            (the authors' program always used ``trial7``); none by default.
        action_limit: Actions in an attempt; by default 3, or as many as the schema's longest
            solution needs.

    Example:
        >>> short = replace(PROTOCOLS["human"], name="short", attempt_limit=5)
        >>> short.attempt_limit, short.training_trials
        (5, 6)
    """

    name: str
    attempt_limit: int
    stop_when_solved: bool
    baseline_trials: int = 5
    training_trials: int = 6
    test_trials: int = 1
    baseline_loops: int = 1
    train_loops: int = 1
    test_loops: int = 1
    layouts: LayoutSource = "published"
    test_layout: str | None = None
    action_limit: int | None = None

    def __post_init__(self) -> None:
        for one in fields(self):
            value = getattr(self, one.name)
            if one.type == "int" or (one.name == "action_limit" and value is not None):
                try:
                    number = whole_number(value, f"{one.name} of protocol {self.name}", 1)
                except OpenLockError as error:
                    raise ProtocolError(str(error)) from None
                object.__setattr__(self, one.name, number)
        if not isinstance(self.stop_when_solved, bool):
            raise ProtocolError(
                f"protocol {self.name}: stop_when_solved must be true or false, and this is "
                f"{self.stop_when_solved!r}"
            )
        if self.action_limit is not None and self.action_limit > MAX_ACTION_LIMIT:
            raise ProtocolError(
                f"action_limit of protocol {self.name} must be at most {MAX_ACTION_LIMIT}"
            )
        if self.layouts not in ("published", "random"):
            raise ProtocolError(f"layouts are published or random, not {self.layouts!r}")

    def actions_for(self, schema: Schema) -> int:
        """Actions in an attempt in a room of this schema.

        Raises:
            ProtocolError: If the protocol's limit is too small for the schema.
        """
        if self.action_limit is None:
            return default_action_limit(schema)
        if self.action_limit < schema.least_action_limit:
            raise ProtocolError(
                f"{schema.name} needs attempts of {schema.least_action_limit} actions and the "
                f"protocol {self.name} allows {self.action_limit}; raise its action_limit"
            )
        return self.action_limit

    def as_dict(self) -> dict[str, Any]:
        """The protocol as plain data."""
        return asdict(self)


PROTOCOLS = {
    "human": Protocol("human", attempt_limit=30, stop_when_solved=True),
    "rl": Protocol(
        "rl",
        attempt_limit=300,
        stop_when_solved=False,
        test_trials=5,
        baseline_loops=10,
        train_loops=100,
        test_loops=10,
    ),
    "rl_2020": Protocol(
        "rl_2020",
        attempt_limit=700,
        stop_when_solved=True,
        test_trials=5,
        baseline_loops=200,
        train_loops=200,
        test_loops=200,
    ),
}


def find_protocol(name: str, own: dict[str, Protocol] | None = None) -> Protocol:
    """A protocol by name.

    Raises:
        ProtocolError: If there is none; the message suggests the nearest name.
    """
    known = {**PROTOCOLS, **(own or {})}
    if name not in known:
        raise ProtocolError(f"there is no protocol {name!r}; {nearest(name, known)}")
    return known[name]


@dataclass(frozen=True)
class Trials:
    """Trials in rooms of one schema.

    Attributes:
        schema: The schema of the rooms.
        layouts: Layouts to draw from without repeats, or their source; ``None`` uses the
            protocol's.
        number: Exactly how many trials; ``None`` uses the protocol's number, or all given layouts.
        shuffle: Whether the layouts come in random order.
    """

    schema: Schema
    layouts: tuple[Layout, ...] | LayoutSource | None = None
    number: int | None = None
    shuffle: bool = True

    def __post_init__(self) -> None:
        if isinstance(self.layouts, tuple) and (self.number or 0) > len(self.layouts):
            raise ProtocolError(
                f"{self.number} trials of {self.schema.name} need that number of layouts, and "
                f"{len(self.layouts)} are given"
            )

    def as_dict(self) -> dict[str, Any]:
        """The trials as plain data, schema included."""
        layouts = self.layouts
        return {
            "schema": self.schema.as_dict(),
            "layouts": [list(layout.places) for layout in layouts]
            if isinstance(layouts, tuple)
            else layouts,
            "number": self.number,
            "shuffle": self.shuffle,
        }

    def draw(
        self, generator: np.random.Generator, number: int, source: LayoutSource
    ) -> list[Layout]:
        """The layouts of one loop over these trials, for one subject.

        Args:
            generator: Draws them.
            number: How many, if the trials do not say; fewer if fewer layouts are published.
            source: Where they come from, if the trials do not say.

        Raises:
            ProtocolError: If there are not enough layouts.
        """
        layouts: Any = self.layouts or source
        if layouts == "published":
            layouts = _published(self.schema) or "random"
        number = self.number or (len(layouts) if self.layouts and layouts != "random" else number)
        if layouts == "random":
            most = math.perm(positions_for(self.schema), len(self.schema.levers))
            if number > most:
                raise ProtocolError(
                    f"{self.schema.name} has {most} layouts, too few for {number} trials; "
                    "ask for fewer trials, or for more loops"
                )
            drawn: dict[tuple[int, ...], Layout] = {}
            while len(drawn) < number:
                layout = Layout.random(self.schema, generator)
                drawn.setdefault(layout.places, layout)
            return list(drawn.values())
        if (self.number or 0) > len(layouts):
            raise ProtocolError(
                f"{self.number} trials of {self.schema.name} are asked for and {len(layouts)} "
                f"layouts of {len(self.schema.levers)} levers are published; ask for at most "
                f"{len(layouts)} trials, or for layouts: random"
            )
        order = generator.permutation(len(layouts)) if self.shuffle else np.arange(len(layouts))
        return [layouts[index] for index in order[:number]]


@cache
def _published(schema: Schema) -> tuple[Layout, ...]:
    return tuple(Layout.of(schema, name) for name in published_layouts(schema))


@dataclass(frozen=True)
class Condition:
    """A sequence of trials.

    Attributes:
        name: For the record.
        train: Trials in the order in which they come; all of a baseline's trials are here.
        test: Trials to test on afterwards; empty for a baseline.
        rooms: By number of the subject, the layouts of its trials in order, where it is on record
            that they were others than the drawn ones, as in data from elsewhere.
        shown: Whether the trials to train on are shown: each solution of the room in an attempt of
            its own, in an order drawn for the subject, and then the trial is over.

    Raises:
        ProtocolError: If training is shown without a test, in rooms where a push can fail, or under
            the name of a condition of the paper.

    Example:
        >>> from causal_openlock import find_schema
        >>> [schema.name for schema in Condition.named("CC3-CC4", find_schema).schemas]
        ['CC3', 'CC4']
    """

    name: str
    train: tuple[Trials, ...]
    test: tuple[Trials, ...] = ()
    rooms: Mapping[int, tuple[Layout, ...]] = field(default_factory=dict, compare=False)
    shown: bool = False

    def __post_init__(self) -> None:
        if not self.shown:
            return
        if not self.test:
            raise ProtocolError(f"{self.name} is only shown; add a test, which is played")
        if self.name in PAPER_CONDITIONS:
            raise ProtocolError(
                f"{self.name} is a condition of the paper, where nothing is shown; choose another "
                f"name, such as {SHOWN}-{self.name}"
            )
        for trials in self.train:
            if not trials.schema.deterministic:
                raise ProtocolError(
                    f"a push can fail in rooms of {trials.schema.name}, so its solutions cannot be "
                    "shown; choose a schema without strengths below 1"
                )

    @classmethod
    def named(cls, name: str, find: Callable[[str], Schema]) -> Condition:
        """The baseline ``A`` or the transfer ``A-B`` over schemas A and B, or ``shown-A-B``.

        Args:
            name: One or two schemas, by name or by the path of a file: ``CC4``,
                ``CC3-CC4``, ``CC3-my/vault.yaml``. A path may have dashes in it; a file of the
                whole name comes first. Before two schemas, ``shown-`` has the training shown.
            find: Finds a schema by name or path.

        Raises:
            ProtocolError: If it has another form.
            OpenLockError: If there is no such schema, or its file has faults.
        """
        if len(name) > MOST_CHARACTERS:
            raise ProtocolError(f"{name[:40]!r}... is not a condition: {len(name):,} characters")
        dashes = [index for index, sign in enumerate(name) if sign == "-"]
        missing: tuple[int, OpenLockError] | None = None
        for parts in ((name,), *((name[:dash], name[dash + 1 :]) for dash in dashes)):
            if not all(NAME.fullmatch(part) or part.lower().endswith(SUFFIXES) for part in parts):
                continue
            schemas: list[Schema] = []
            try:
                for part in parts:
                    schemas.append(find(part))
            except FileError:  # the file exists and has faults
                raise
            except OpenLockError as error:
                # Report the reading of the name in which the most schemas were found.
                if missing is None or len(schemas) > missing[0]:
                    missing = len(schemas), error
                continue
            words = [
                part if NAME.fullmatch(part) else schema.name
                for part, schema in zip(parts, schemas, strict=True)
            ]
            train, *tested = ((Trials(schema),) for schema in schemas)
            return cls("-".join(words), train, tested[0] if tested else ())
        rest = name.removeprefix(f"{SHOWN}-")
        if rest != name and not rest.startswith(f"{SHOWN}-"):
            played = cls.named(rest, find)
            return replace(played, name=f"{SHOWN}-{played.name}", shown=True)
        if missing is not None:
            raise missing[1]
        raise ProtocolError(
            f"{name!r} is not a condition; write one schema for a baseline (CC4) or two for a "
            "transfer (CC3-CC4); a file is given by its path (CC3-my/vault.yaml)"
        )

    @property
    def schemas(self) -> tuple[Schema, ...]:
        """The condition's schemas, each once, in order."""
        return tuple(dict.fromkeys(trials.schema for trials in (*self.train, *self.test)))

    def as_dict(self) -> dict[str, Any]:
        """The condition as plain data, schemas included."""
        data: dict[str, Any] = {
            "name": self.name,
            "train": [trials.as_dict() for trials in self.train],
            "test": [trials.as_dict() for trials in self.test],
        }
        if self.rooms:
            data["rooms"] = {str(k): [list(o.places) for o in v] for k, v in self.rooms.items()}
        if self.shown:
            data["shown"] = True
        return data


@dataclass(frozen=True)
class Visit:
    """One trial of one subject: its number in the condition, and its room.

    ``order`` has the indices of the room's solutions in the order in which they are shown; it is
    empty where the subject plays.
    """

    phase: str
    loop: int
    trial: int
    schema: Schema
    layout: Layout
    order: tuple[int, ...] = ()


def plan(
    condition: Condition,
    protocol: Protocol,
    generator: np.random.Generator,
    subject: int | None = None,
) -> list[Visit]:
    """The trials of one subject, in order.

    Each loop draws new layouts, without repeats within the loop. Of a subject that the condition
    has ``rooms`` of, the first trials are in those.

    Raises:
        ProtocolError: If a schema does not fit the protocol or its ``test_layout``, has fewer
            layouts than trials, or more solutions to show than a trial has attempts.
    """
    train = (protocol.training_trials, protocol.train_loops)
    if not condition.test:
        train = (protocol.baseline_trials, protocol.baseline_loops)
    tested = condition.test
    if protocol.test_layout is not None:
        try:
            tested = tuple(
                replace(trials, layouts=(Layout.of(trials.schema, protocol.test_layout),))
                for trials in tested
            )
        except LayoutError as error:
            message = f"test_layout of protocol {protocol.name}: {error}"
            raise ProtocolError(message) from None
    visits: list[Visit] = []
    for phase, groups, number, loops in (
        (SHOWN if condition.shown else "train", condition.train, *train),
        ("test", tested, protocol.test_trials, protocol.test_loops),
    ):
        for loop in range(1, loops + 1):
            drawn = (
                (trials.schema, layout)
                for trials in groups
                for layout in trials.draw(generator, number, protocol.layouts)
            )
            visits += [Visit(phase, loop, trial, *room) for trial, room in enumerate(drawn, 1)]
    for number, visit in enumerate(visits):
        if visit.phase == SHOWN:
            solutions = len(visit.schema.solutions)
            if solutions > protocol.attempt_limit:
                raise ProtocolError(
                    f"{visit.schema.name} has {solutions} solutions to show, and a trial of "
                    f"protocol {protocol.name} has {counted(protocol.attempt_limit, 'attempt')}; "
                    "raise its attempt_limit"
                )
            order = tuple(generator.permutation(solutions).tolist())
            visits[number] = replace(visit, order=order)
    for schema in condition.schemas:
        protocol.actions_for(schema)
    known = condition.rooms.get(-1 if subject is None else subject, ())
    for number, (visit, layout) in enumerate(zip(visits, known, strict=False)):
        visits[number] = replace(visit, layout=layout)
    return visits


def shown_trials(condition: Condition, protocol: Protocol) -> int:
    """How many trials each subject is shown before it plays.

    >>> from causal_openlock import find_schema
    >>> shown_trials(Condition.named("shown-CC3-CC4", find_schema), PROTOCOLS["human"])
    6
    """
    if not condition.shown:
        return 0
    visits = plan(condition, protocol, np.random.default_rng(0))
    return sum(visit.phase == SHOWN for visit in visits)


def check_trial(trial: int, trials: int, where: str) -> None:
    """Refuse a number of a trial that a condition does not have; ``where`` is for the message.

    Raises:
        ProtocolError: If there is no such trial.
    """
    if not 1 <= trial <= trials:
        raise ProtocolError(f"{where} has no trial {trial}; choose one from 1 to {trials}")
