"""A causal schema: which lever enables which, and what unlocks the door.

A :class:`Schema` is a directed acyclic graph. Its nodes are levers and one door. An edge
``cause -> effect`` means that the cause, while it is pushed, *enables* the effect. The
:class:`Gate` of a node combines its causes. A lever without causes moves freely; a lever with
causes moves, either way, only while its gate holds. The door is unlocked exactly while its gate
holds: the lock depends only on which levers are pushed now.

The *strength* of an edge is the probability that an enabled push or pull takes effect through it.
Each pushed cause transmits independently with the strength of its edge, and the push or pull takes
effect if as many transmit as the gate requires: a noisy-OR under ``any``, a noisy-AND under
``all``. Strengths on edges into the door apply to pushing the door open; whether it is unlocked
never depends on chance.

A schema is declared in one form (:class:`SchemaForm`), in Python as in a file; ``title``, ``gates``
and ``inert`` may be left out::

    name: CC3
    title: Common cause, three levers
    levers: [L0, L1, L2]
    edges:                      # cause: [effects]
      L0: [L1, L2]
      L1: [door]
      L2: {door: 0.8}           # its strength
    gates: {door: any}          # any, all, or {at_least: 2}
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, WrapValidator

from causal_openlock.errors import SchemaError, together
from causal_openlock.files.validation import StrictModel, described, plain, read
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.wording import counted, nearest

DOOR = "door"
MAX_LEVERS = 12
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
NAME_FORM = "a letter, then letters, digits and underscores, at most 64 in all"
JSON_SCHEMA_ID = "https://json-schema.org/draft/2020-12/schema"
NO_TEXT = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f\\ud800-\\udfff]")  # no file can hold these


@dataclass(frozen=True)
class Gate:
    """Rule by which a node combines its causes: ``any``, ``all``, or ``at_least`` *k* are pushed.

    >>> str(Gate("at_least", 2)), Gate("all").threshold(causes=3)
    ('at least 2', 3)
    """

    kind: str = "any"
    k: int = 1

    def threshold(self, causes: int) -> int:
        """Number of causes, of ``causes`` in all, that must be pushed for the gate to hold."""
        return {"any": 1, "all": causes}.get(self.kind, self.k)

    def __str__(self) -> str:
        return f"at least {self.k}" if self.kind == "at_least" else self.kind


Strength = Annotated[
    float, Field(gt=0, le=1, description="Probability that an enabled push takes effect.")
]


class Edge(StrictModel):
    """Attributes of one edge."""

    strength: Strength = 1.0


class AtLeast(StrictModel):
    """A gate that holds while at least this number of causes are pushed."""

    at_least: Annotated[int, Field(ge=1, le=MAX_LEVERS)]


def _title(title: str) -> str:
    if illegal := NO_TEXT.search(title):
        raise SchemaError(f"the title holds the character U+{ord(illegal[0]):04X}; take it out")
    return title


def _names(names: Any) -> Any:
    """Refuse a list in which something is no name, or stands twice."""
    faults = []
    for index, name in enumerate(names if isinstance(names, list) else ()):
        if not isinstance(name, str) or not NAME.fullmatch(name):
            text = f"{described(name)} is not a name: {NAME_FORM}; write it like L0"
            faults.append(SchemaError(text, (index,)))
        elif name in names[:index]:
            faults.append(SchemaError(f"{name} is listed twice; remove one of them", (index,)))
    if faults:
        raise together(faults)
    return names


def _edge(edge: Any) -> Any:
    """A number in place of an edge is its strength."""
    is_number = isinstance(edge, int | float) and not isinstance(edge, bool)
    return {"strength": edge} if is_number else edge


def _effects(effects: Any) -> Any:
    """A list of effects is a mapping of certain ones."""
    if isinstance(effects, list):
        return dict.fromkeys(_names(effects), Edge())
    if isinstance(effects, Mapping):
        return effects
    raise SchemaError(
        "effects are a list like [L1, door] or a mapping like {L1: 0.8}, and this is "
        f"{described(effects)}"
    )


def _gate(gate: Any, at_least: Callable[[Any], AtLeast]) -> Gate:
    """A gate from its name, from the least number of causes, or in words as those of a Gate."""
    kind, _, k = str(gate).lower().replace("at least", "at_least").partition(" ")
    if kind in ("any", "all"):
        return Gate(kind)
    if kind == "at_least" and k.isdecimal():
        gate = {"at_least": int(k[:9])}
    if not isinstance(gate, Mapping):
        raise SchemaError(f"a gate is any, all or {{at_least: k}}, and this is {described(gate)}")
    return Gate("at_least", at_least(gate).at_least)


EdgeForm = Annotated[Edge, BeforeValidator(_edge, json_schema_input_type=Strength | Edge)]
Effects = Annotated[
    dict[str, EdgeForm],
    BeforeValidator(_effects, json_schema_input_type=list[str] | dict[str, EdgeForm]),
]
GateForm = Annotated[
    AtLeast, WrapValidator(_gate, json_schema_input_type=Literal["any", "all"] | AtLeast)
]
Names = Annotated[list[str], BeforeValidator(_names)]


class SchemaForm(StrictModel):
    """A causal schema of levers and a door."""

    name: str = Field(pattern=f"^{NAME.pattern}$", description=NAME_FORM)
    title: Annotated[str, AfterValidator(_title)] = Field(
        "", description="A line for tables and figures."
    )
    levers: Names = Field(
        min_length=1,
        max_length=MAX_LEVERS,
        description="The active levers, in the order layouts place them.",
    )
    edges: dict[str, Effects] = Field(
        description="cause: [effects]; the effect `door` is the door."
    )
    gates: dict[str, GateForm] = Field(
        default_factory=dict, description="How a node combines its causes; `any` where not given."
    )
    inert: Names = Field(
        default_factory=list, description="Levers that are meant to lie on no path to the door."
    )


class Schema:
    """A causal schema over levers and a door.

    Args:
        name: A short name: letters, digits and underscores, beginning with a letter.
        levers: The active levers, in the order in which layouts place them.
        edges: ``{cause: {effect: strength}}``, or ``{cause: [effects]}`` where all are certain.
        gates: ``{node: gate}``, ``any`` where not given: a Gate, ``all`` or ``at_least 2``.
        inert: Levers that are intentionally on no path to the door.
        title: A line for tables and figures.

    Raises:
        OpenLockError: If it is no such schema; its ``parts`` are all faults, ``at`` says where.

    Example:
        >>> edges = {"L0": ["L1", "L2"], "L1": ["door"], "L2": ["door"]}
        >>> cc3 = Schema("CC3", ["L0", "L1", "L2"], edges)
        >>> cc3.solutions
        (('L0', 'L1'), ('L0', 'L2'))
        >>> cc3.least_action_limit
        3
    """

    def __init__(
        self,
        name: str,
        levers: Sequence[str],
        edges: Mapping[str, Sequence[str] | Mapping[str, Any]],
        *,
        gates: Mapping[str, Gate | str] | None = None,
        inert: Sequence[str] = (),
        title: str = "",
    ) -> None:
        data = {"name": name, "title": title, "levers": levers, "inert": inert, "edges": edges}
        form: SchemaForm = read(SchemaForm, plain({**data, "gates": gates or {}}))
        self.name, self.title = form.name, form.title or form.name
        self.levers, self.inert = tuple(form.levers), tuple(form.inert)
        self.graph = nx.DiGraph(name=name)
        self.graph.add_nodes_from(self.levers, kind="lever")
        self.graph.add_node(DOOR, kind="door")
        for cause, effects in form.edges.items():
            for effect, edge in effects.items():
                self.graph.add_edge(cause, effect, strength=float(edge.strength))
        for node in self.graph:
            self.graph.nodes[node]["gate"] = form.gates.get(node, Gate())
        if faults := [*self._faults(form)]:
            raise together(faults)
        nx.freeze(self.graph)

    def _faults(self, form: SchemaForm) -> Iterator[SchemaError]:
        """Whatever takes the meaning from the graph."""
        levers = [lever for lever in self.levers if lever != DOOR]
        nodes = [*levers, DOOR]
        named: list[tuple[tuple[str, ...], list[str]]] = []
        for key, names in (("levers", self.levers), ("inert", self.inert), ("edges", form.edges)):
            named += [((key, name), levers) for name in names]
        named += [(("gates", node), nodes) for node in form.gates]
        for cause, effects in form.edges.items():
            named += [(("edges", cause, effect), nodes) for effect in effects]
        unknown = [(at, known) for at, known in named if at[-1] not in known]
        for at, known in unknown:
            text = f"{at[-1]!r:.64} is unknown here; {nearest(at[-1][:64], known)}"
            yield SchemaError("the door is not a lever" if at[-1] == DOOR else text, at)
        if any(at[0] in ("levers", "edges") for at, _ in unknown):
            return  # what else is wrong follows from these
        for node in nodes:
            gate, causes, at = self.gate(node), self.graph.in_degree(node), ("gates", node)
            if node != DOOR and gate.kind != "any" and not causes:
                text = f"{node} has a gate and no cause; give it a cause or drop the gate"
                yield SchemaError(text, at)
            elif causes and gate.threshold(causes) > causes:
                yield SchemaError(
                    f"the gate of {node} needs {gate.k} of {causes} causes; lower it", at
                )
        cycle: list[str] = []
        if not nx.is_directed_acyclic_graph(self.graph):
            cycle = [cause for cause, _ in nx.find_cycle(self.graph)]
            around = " -> ".join([*cycle, cycle[0]])
            text = f"{around} is a cycle; no lever could move first; remove an edge"
            yield SchemaError(text, ("edges", *[*cycle, *cycle][:2]))
        useful = nx.ancestors(self.graph, DOOR)
        if not useful:
            text = f"nothing unlocks the door; add an edge to it from {' or '.join(levers)}"
            yield SchemaError(text, ("edges",))
        for lever in levers if useful else ():
            if lever not in (*useful, *self.inert, *cycle):
                text = f"lever {lever} is on no path to the door; connect it or list it as inert"
                yield SchemaError(text, ("levers", lever))
            if lever in useful and lever in self.inert:
                text = f"lever {lever} leads to the door; take it out of inert"
                yield SchemaError(text, ("inert", lever))

    def causes(self, node: str) -> tuple[str, ...]:
        """The levers that enable ``node``, in the order of :attr:`levers`."""
        return tuple(sorted(self.graph.predecessors(node), key=self.levers.index))

    def strengths(self, node: str) -> tuple[float, ...]:
        """The strength of each edge into ``node``, in the order of :meth:`causes`."""
        return tuple(self.graph.edges[cause, node]["strength"] for cause in self.causes(node))

    def gate(self, node: str) -> Gate:
        """The gate of ``node``."""
        gate: Gate = self.graph.nodes[node]["gate"]
        return gate

    def threshold(self, node: str) -> int:
        """Number of causes of ``node`` that must be pushed; 0 for a free lever."""
        causes = self.graph.in_degree(node)
        return self.gate(node).threshold(causes) if causes else 0

    @property
    def deterministic(self) -> bool:
        """Whether every strength is 1."""
        return all(data["strength"] == 1.0 for *_, data in self.graph.edges(data=True))

    @cached_property
    def solutions(self) -> tuple[tuple[str, ...], ...]:
        """Minimal sets of levers whose pushes unlock the door, each in one order that works.

        A set works if its levers can be pushed one after another, each enabled by those before
        it, so that the door's gate holds in the end; it is minimal if none of its proper subsets
        works. Causes must be pushed before their effects, so a set works exactly if it satisfies
        the gates of its own levers and of the door.
        """
        subsets = np.arange(1 << len(self.levers))
        works = self.holds(DOOR, subsets)
        for bit, lever in enumerate(self.levers):
            works &= self.holds(lever, subsets) | (subsets >> bit & 1 == 0)
        minimal: list[int] = []
        for subset in sorted(subsets[works].tolist(), key=int.bit_count):
            if not any(smaller & subset == smaller for smaller in minimal):
                minimal.append(subset)
        nodes = [*self.levers, DOOR]
        ordered = [*nx.lexicographical_topological_sort(self.graph, key=nodes.index)]
        solutions = [
            tuple(node for node in ordered if subset >> nodes.index(node) & 1) for subset in minimal
        ]
        return tuple(sorted(solutions, key=lambda levers: [*map(nodes.index, levers)]))

    def holds(self, node: str, pushed: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether a node's gate holds while these sets of levers (:meth:`mask`) are pushed."""
        return np.bitwise_count(pushed & self.mask(self.causes(node))) >= self.threshold(node)

    @property
    def least_action_limit(self) -> int:
        """The fewest actions in which every solution fits, the push of the door included."""
        return max(map(len, self.solutions)) + 1

    def mask(self, levers: Iterable[str]) -> int:
        """A set of levers as an integer: bit *i* is set if ``self.levers[i]`` is in it."""
        return sum(1 << self.levers.index(lever) for lever in set(levers))

    def as_dict(self) -> dict[str, Any]:
        """The schema as plain data, in the form of a schema file; equal schemas give equal data."""
        edges: dict[str, Any] = {}
        gates: dict[str, Any] = {}
        for node in [*self.levers, DOOR]:
            effects = sorted(self.graph[node], key=[*self.levers, DOOR].index)
            strengths = {effect: self.graph[node][effect]["strength"] for effect in effects}
            if {*strengths.values()} == {1.0}:
                edges[node] = effects
            elif effects:
                edges[node] = {
                    effect: {} if strength == 1.0 else {"strength": strength}
                    for effect, strength in strengths.items()
                }
            gate = self.gate(node)
            if gate.kind != "any":
                gates[node] = {"at_least": gate.k} if gate.kind == "at_least" else gate.kind
        title = self.title if self.title != self.name else ""
        data = {"name": self.name, "title": title, "levers": [*self.levers], "edges": edges}
        data |= {"gates": gates, "inert": [*self.inert]}
        return {key: value for key, value in data.items() if value}

    def to_yaml(self) -> str:
        """The text of a schema file, in block style with lists of names on one line.

        >>> print(Schema("one", ["A"], {"A": ["door"]}).to_yaml(), end="")
        name: one
        levers: [A]
        edges:
          A: [door]
        """
        return dump_yaml(self.as_dict(), innermost_in_a_line=True)

    def to_text(self) -> str:
        """The schema as a line of text; see :func:`~causal_openlock.schemas.one_line.one_line`.

        >>> Schema("one", ["A"], {"A": ["door"]}).to_text()
        'one: A -> door'
        """
        from causal_openlock.schemas.one_line import one_line

        return one_line(self)

    def play(self, **options: Any) -> Any:
        """Open rooms of the schema in the browser, to play oneself.

        Arguments and what is returned: :func:`~causal_openlock.play.background.play_room`.
        """
        from causal_openlock.play.background import play_room

        return play_room(self, **options)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Schema) and self.as_dict() == other.as_dict()

    def __hash__(self) -> int:
        return hash((self.name, self.levers, frozenset(self.graph.edges)))

    def __repr__(self) -> str:
        levers, solutions = counted(len(self.levers), "lever"), len(self.solutions)
        return f"<Schema {self.name}: {levers}, {counted(solutions, 'solution')}>"


SchemaData: Any = Annotated[SchemaForm, AfterValidator(lambda form: Schema(**dict(form)))]
"""What pydantic reads plain data, such as a schema file, with: a :class:`Schema`."""


def schema_from_dict(data: Mapping[str, Any]) -> Schema:
    """A schema from plain data in the form of a schema file.

    Raises:
        OpenLockError: If the data are not a schema, as for :class:`Schema`.
    """
    schema: Schema = read(SchemaData, plain(data))
    return schema


def json_schema() -> dict[str, Any]:
    """The JSON Schema of schema files, for editors."""
    made = SchemaForm.model_json_schema()
    return {"$schema": JSON_SCHEMA_ID, **made, "title": "causal_openlock schema"}
