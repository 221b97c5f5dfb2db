"""A causal schema: which lever enables which, and what unlocks the door.

A :class:`Schema` is a directed acyclic graph. Its nodes are levers and one door. An edge
``cause -> effect`` means that the cause, while it is pushed, *enables* the effect. The
:class:`Gate` of a node combines its causes: ``any`` one of them, ``all`` of them, or at least *k*.
A lever without causes moves freely; a lever with causes moves, either way, only while its gate
holds. The door is unlocked exactly while its gate holds: the lock depends only on which levers are
pushed now.

The *strength* of an edge is the probability that an enabled push or pull takes effect through it.
Each pushed cause transmits independently with the strength of its edge, and the push or pull takes
effect if as many transmit as the gate requires: a noisy-OR under ``any``, a noisy-AND under
``all``. Strengths on edges into the door apply to pushing the door open; whether it is unlocked
never depends on chance.

The *solutions* are computed from the graph: the minimal sets of levers that unlock the door when
they are pushed. So is the number of actions that an attempt needs for each of them to fit.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from numbers import Real
from typing import Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from causal_openlock.errors import SchemaError, together
from causal_openlock.wording import counted, nearest

DOOR = "door"
MAX_LEVERS = 12
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
GATES = ("any", "all", "at_least")
NO_TEXT = re.compile("[\\x00-\\x08\\x0b-\\x1f\\x7f\\ud800-\\udfff]")
"""Not allowed in titles: control characters and lone surrogates, which files cannot hold."""


Edges = Mapping[str, Iterable[str] | Mapping[str, float]]


@dataclass(frozen=True)
class Gate:
    """Rule by which a node combines its causes.

    Attributes:
        kind: ``any``, ``all`` or ``at_least``.
        k: For ``at_least``: how many causes must be pushed.

    Example:
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


class Schema:
    """A causal schema over levers and a door.

    Args:
        name: A short name: letters, digits and underscores, beginning with a letter.
        levers: The active levers, in the order in which layouts place them.
        edges: ``{cause: {effect: strength}}``, or ``{cause: [effects]}`` where all are certain.
        gates: ``{node: Gate}``; the gate of other nodes is ``any``.
        inert: Levers that are intentionally on no path to the door.
        title: A line for tables and figures.

    Raises:
        SchemaError: If the graph has a cycle, names an unknown lever, never unlocks the door, or
            breaks another rule. It has all faults, each as one of ``error.parts``, whose ``at``
            says where.

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
        levers: Iterable[str],
        edges: Edges,
        *,
        gates: Mapping[str, Gate] | None = None,
        inert: Iterable[str] = (),
        title: str = "",
    ) -> None:
        self.name, self.title = name, title or name
        gates = gates or {}
        for what, form, value, kind in _expected(name, title, levers, inert, edges, gates):
            if not isinstance(value, kind):
                raise SchemaError(f"{what} must be {form}, not {value!r:.64}", (what.split()[0],))
        self.levers, self.inert = tuple(levers), tuple(inert)
        self._check_names()  # every other part names the levers
        self.graph = nx.DiGraph(name=name)
        self.graph.add_nodes_from(self.levers, kind="lever")
        self.graph.add_node(DOOR, kind="door")
        self._add_edges(edges, gates)
        for node in self.graph:
            self.graph.nodes[node]["gate"] = gates.get(node, Gate())
        nx.freeze(self.graph)

    def _check_names(self) -> None:
        faults = _Faults()
        if illegal := NO_TEXT.search(self.title):
            text = f"the title holds the character U+{ord(illegal[0]):04X}; take it out"
            faults.add(text, "title")
        if not NAME.fullmatch(self.name):
            text = f"the name {self.name!r:.64} is not a letter and up to 63 letters, digits and _"
            faults.add(text, "name")
        if not 1 <= len(self.levers) <= MAX_LEVERS:
            text = f"{len(self.levers)} levers; a schema needs a lever and has at most {MAX_LEVERS}"
            faults.add(text, "levers")
        for index, lever in enumerate(self.levers):
            if lever == DOOR:
                faults.add("the door is not a lever; take it out of this list", "levers", index)
            elif not isinstance(lever, str) or not NAME.fullmatch(lever):
                text = f"{lever!r:.64} is not a valid name of a lever; write it like L0"
                faults.add(text, "levers", index)
        faults.of_twice(self.levers, "levers")
        faults.check()

    def _add_edges(self, edges: Edges, gates: Mapping[str, Gate]) -> None:
        """Add the edges to the graph, and check them, the gates, inert levers and paths."""
        faults, graph, nodes = _Faults(), self.graph, [*self.levers, DOOR]
        for index, lever in enumerate(self.inert):
            faults.unless_known(lever, self.levers, "inert", index)
        faults.of_twice(self.inert, "inert")
        for cause, effects in edges.items():
            if cause == DOOR:
                faults.add("the door is an effect and enables nothing", "edges", DOOR)
                continue
            faults.unless_known(cause, self.levers, "edges", cause)
            if not isinstance(effects, Mapping):
                effects = dict.fromkeys(map(str, effects), 1.0)
            for effect, strength in effects.items():
                at = ("edges", cause, effect)
                faults.unless_known(effect, nodes, *at)
                if not isinstance(strength, Real) or not 0.0 < float(strength) <= 1.0:
                    edge = f"{cause!s:.64} -> {effect!s:.64}"
                    text = f"the strength {strength!r:.64} of {edge} must be above 0 and at most 1"
                    faults.add(text, *at, "strength")
                elif cause in graph and effect in graph:
                    graph.add_edge(cause, effect, strength=float(strength))
        complete = not faults  # what else is wrong follows from the edges
        for node, gate in gates.items():
            faults.unless_known(node, nodes, "gates", node)
            causes = graph.in_degree(node) if node in graph else 0
            if gate.kind not in GATES:
                known = nearest(str(gate.kind)[:64], GATES)
                faults.add(f"the gate of {node} is {gate.kind!r:.64}; {known}", "gates", node)
            elif complete and node in self.levers and not causes:
                text = f"{node} has a gate and no cause; give it a cause or drop the gate"
                faults.add(text, "gates", node)
            elif complete and causes and gate.threshold(causes) not in range(1, causes + 1):
                text = (
                    f"the gate of {node} needs {gate.k} of {causes} causes; require 1 to {causes}"
                )
                faults.add(text, "gates", node)
        cycle: list[str] = []
        if not nx.is_directed_acyclic_graph(graph):
            cycle = [cause for cause, _ in nx.find_cycle(graph)]
            around = [*cycle, cycle[0]]
            text = f"{' -> '.join(around)} is a cycle; no lever could move first; remove an edge"
            faults.add(text, "edges", *around[:2])
        useful = nx.ancestors(graph, DOOR)
        if complete and not useful:
            hint = "".join(f"; is {near} the door?" for near in get_close_matches(DOOR, nodes[:-1]))
            faults.add(f"nothing unlocks the door; add an edge from a lever to it{hint}", "edges")
        for index, lever in enumerate(self.levers if complete and useful else ()):
            if lever not in (*useful, *self.inert, *cycle):
                text = f"lever {lever} is on no path to the door; connect it or list it as inert"
                faults.add(text, "levers", index)
            if lever in useful and lever in self.inert:
                text = f"lever {lever} leads to the door; take it out of inert"
                faults.add(text, "inert", self.inert.index(lever))
        faults.check()

    # -- the graph ------------------------------------------------------------------------------

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

    # -- solutions ------------------------------------------------------------------------------

    @cached_property
    def solutions(self) -> tuple[tuple[str, ...], ...]:
        """Minimal sets of levers whose pushes unlock the door, each in one order that works.

        A set works if its levers can be pushed one after another, each enabled by those before
        it, so that the door's gate holds in the end; it is minimal if none of its proper subsets
        works. Causes must be pushed before their effects, so a set works exactly if it satisfies
        the gates of its own levers and of the door.
        """
        subsets = np.arange(1 << len(self.levers))
        works = self._holds(DOOR, subsets)
        for bit, lever in enumerate(self.levers):
            works &= self._holds(lever, subsets) | (subsets >> bit & 1 == 0)
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

    def _holds(self, node: str, pushed: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether a node's gate holds while these sets of levers are pushed."""
        return np.bitwise_count(pushed & self.mask(self.causes(node))) >= self.threshold(node)

    @property
    def least_action_limit(self) -> int:
        """The fewest actions in which every solution fits, the push of the door included."""
        return max(map(len, self.solutions)) + 1

    def mask(self, levers: Iterable[str]) -> int:
        """A set of levers as an integer: bit *i* is set if ``self.levers[i]`` is in it."""
        return sum(1 << self.levers.index(lever) for lever in set(levers))

    # -- as data --------------------------------------------------------------------------------

    def as_dict(self) -> dict[str, Any]:
        """The schema as plain data, in the form of a schema file; equal schemas give equal data."""
        data: dict[str, Any] = {"name": self.name}
        if self.title != self.name:
            data["title"] = self.title
        data["levers"] = list(self.levers)
        data["edges"] = {}
        for cause in self.levers:
            effects = sorted(self.graph.successors(cause), key=[*self.levers, DOOR].index)
            strengths = {effect: self.graph.edges[cause, effect]["strength"] for effect in effects}
            if effects:
                data["edges"][cause] = {
                    effect: {} if strength == 1.0 else {"strength": strength}
                    for effect, strength in strengths.items()
                }
                if {*strengths.values()} == {1.0}:
                    data["edges"][cause] = effects
        gates = {
            node: {"at_least": gate.k} if gate.kind == "at_least" else gate.kind
            for node in [*self.levers, DOOR]
            if (gate := self.gate(node)).kind != "any"
        }
        if gates:
            data["gates"] = gates
        if self.inert:
            data["inert"] = list(self.inert)
        return data

    def to_yaml(self) -> str:
        """The text of a schema file, in block style with lists of names on one line.

        >>> print(Schema("one", ["A"], {"A": ["door"]}).to_yaml(), end="")
        name: one
        levers: [A]
        edges:
          A: [door]
        """
        from causal_openlock.files.yaml_file import dump_yaml, styled

        return dump_yaml(styled(self.as_dict()))

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
        return self._hash

    @cached_property
    def _hash(self) -> int:
        # Not hash(): that differs between processes, and this value travels with a pickled schema.
        return zlib.crc32(repr((self.name, self.levers, sorted(self.graph.edges))).encode())

    def __repr__(self) -> str:
        levers, solutions = counted(len(self.levers), "lever"), len(self.solutions)
        return f"<Schema {self.name}: {levers}, {counted(solutions, 'solution')}>"


class _Faults(list[SchemaError]):
    """Faults that are raised together."""

    def add(self, text: str, *at: str | int) -> None:
        self.append(SchemaError(text, at))

    def unless_known(self, node: Any, known: Sequence[str], *at: str | int) -> None:
        if node not in known:
            self.add(f"{node!r:.64} is unknown here; {nearest(str(node)[:64], known)}", *at)

    def of_twice(self, levers: Sequence[str], key: str) -> None:
        for index, lever in enumerate(levers):
            if lever in levers[:index]:
                self.add(f"lever {lever!s:.64} is listed twice; remove one of them", key, index)

    def check(self) -> None:
        if self:
            raise together(self)


def _expected(
    name: Any, title: Any, levers: Any, inert: Any, edges: Any, gates: Any
) -> Iterator[tuple[str, str, Any, type]]:
    """What a schema is made of: its name, its form in words, its value, its type."""
    yield "name", "a text", name, str
    yield "title", "a text", title, str
    yield "levers", "a list of names", levers, Iterable
    yield "inert", "a list of names", inert, Iterable
    yield "edges", "{cause: [effects]} or {cause: {effect: strength}}", edges, Mapping
    for effects in edges.values():
        yield "edges of a lever", "[effects] or {effect: strength}", effects, Iterable
    yield "gates", "{node: Gate}", gates, Mapping
    for gate in gates.values():
        yield "gates of nodes", "a Gate", gate, Gate
        yield "gates' k", "a whole number", gate.k, int
