"""The names that rows of the tables may use.

A helper stands here only if several rows need it; what only one table needs is imported from the
package within the row's expression, as in ``of("causal_openlock.world.room", "Layout")([1, 1])``.
"""

import importlib
import json
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np

import causal_openlock as ol
from causal_openlock.errors import OpenLockError


def of(module, name):
    """A public name of a module."""
    return getattr(importlib.import_module(module), name)


def file(name, text):
    """Write a file into the folder of the test, and return its path."""
    path = Path(name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def schema_file(text="", name="schema.yaml", **changes):
    """Read a schema file: this text, or a good one with some values changed or added.

    Its lines are ``name: X``, ``levers: [L0, L1]``, ``edges: {L0: [L1], L1: [door]}``, then what is
    added, so that a row can name a line and a column.
    """
    good = {"name": "X", "levers": "[L0, L1]", "edges": "{L0: [L1], L1: [door]}", **changes}
    written = text or "".join(f"{key}: {value}\n" for key, value in good.items())
    return of("causal_openlock.schemas.graphs", "read_schema")(file(name, written), "yaml")


def experiment_file(text="", **changes):
    """Read an experiment file: this text, or a good one with some values changed or added.

    Its lines are ``name: x``, ``conditions: [CC3]``, ``learners: [random]``, then what is added.
    """
    good = {"name": "x", "conditions": "[CC3]", "learners": "[random]", **changes}
    written = text or "".join(f"{key}: {value}\n" for key, value in good.items())
    return ol.read_experiment(file("experiment.yaml", written))


def changed(name, old, new):
    """The text of a file that stands before the row, with one change."""
    text = Path(name).read_text(encoding="utf-8")
    assert old in text, old
    return text.replace(old, new, 1)


def imported(text, name="data.csv"):
    """Import a data file of this text; where it is refused, nothing has been written."""
    try:
        return of("causal_openlock.importing.folder", "import_files")([file(name, text)], "in")
    finally:
        assert not Path("in").exists()


def learner(name, **parameters):
    """Create a learner, with some parameters."""
    return of("causal_openlock.contract.registry", "create")(name, parameters)


def begun(name, condition="CC3", layouts="published", **parameters):
    """Let a learner begin a session, at which it looks for all that it needs."""
    protocol = of("causal_openlock.experiment.protocol", "Protocol")("t", 2, True, layouts=layouts)
    session = of("causal_openlock.experiment.session", "Session")(
        ol.find_condition(condition), protocol, 1
    )
    return session.begin(learner(name, **parameters))


def on_results(command):
    """Run a command next to a results folder ``played``, and raise what it refuses.

    Two subjects of ``random`` and of ``associative`` play two trials of CC3.
    """
    short = ol.Protocol("short", 3, stop_when_solved=True, baseline_trials=2)
    learners = ["random", "associative"]
    ol.compare("CC3", learners, protocol=short, subjects=2, out="played", workers=0)
    done = of("support.command", "at_once")(*shlex.split(command))
    if done.status == 2:
        raise of("causal_openlock.errors", "OpenLockError")(done.stderr)


def searched(learner, fixed=None, /, **ranges):
    """The search of a learner's parameters within ranges ``(low, high)``, perhaps logarithmic."""
    span = of("causal_openlock.fitting.plan", "Range")
    space = of("causal_openlock.fitting.plan", "make_plan")
    return space(learner, {name: span(*ends) for name, ends in ranges.items()}, fixed or {})


def compared(condition="CC3", learner="oracle"):
    """Results of one subject of a learner in a condition, in a folder of the test."""
    return ol.compare([condition], [learner], subjects=1, workers=0, out=f"compared_{learner}")


def reward_function(body):
    """Take a function of this body, in a module of its own, as a reward."""
    name = f"pays_{abs(hash(body))}"
    file(f"{name}.py", f"def pay(events):\n    {body}\n")
    with of("support.command", "modules_of")(Path.cwd()), np.errstate(all="ignore"):
        return of("causal_openlock.world.rewards", "own_reward")(f"{name}:pay")


def both_envs(**arguments):
    """Make one room and many rooms of these arguments; if one room is refused, so are many."""
    try:
        of("causal_openlock.envs", "OpenLockEnv")(**arguments)
    except ol.OpenLockError:
        return of("causal_openlock.envs", "OpenLockVectorEnv")(2, **arguments)


def some_results():
    """Results of one subject of ``oracle`` and of ``random`` in CC3, in memory."""
    return ol.compare("CC3", ["oracle", "random"], subjects=1, workers=0)


def reference(name="x", rows=1, **columns):
    """A reference with the mean of one trial, of which some columns are changed or None."""
    module = "causal_openlock.analysis.results.references"
    point = {"condition": "CC4", "phase": "train", "trial": 5, "subjects": 9, "mean": 1, "se": 1}
    points = of("pandas", "DataFrame")({**point, **columns}, index=range(rows))
    return of(module, "Reference")(name, points.dropna(axis=1), lambda *_: True)


def trained(old, new, out="net.npz"):
    """Train a network by ``small.yaml`` with one change; where that is refused, none is written."""
    train = of("openlock_learners.meta.command", "train")
    try:
        train(file("changed/small.yaml", changed("small.yaml", old, new)), Path(out))
    finally:
        assert not [*Path().rglob("*net*")]


def new_schema(**changes):
    """Make a schema in Python: one in which A unlocks the door, but for what is changed."""
    given = {"name": "X", "levers": ["A"], "edges": {"A": ["door"]}, **changes}
    return of("causal_openlock.schemas.schema", "Schema")(**given)


def schema_text(text, format):
    """Read a schema from a text in a format."""
    return of("causal_openlock.schemas.graphs", "import_schema")(text, format)


def node_link(nodes, edge="", **changes):
    """Read a node-link graph of these nodes and, perhaps, an edge from one to another."""
    ends = [dict(zip(("source", "target"), edge.split(), strict=True))] if edge else []
    graph = {"nodes": [{"id": node} for node in nodes.split()], "links": ends, **changes}
    return schema_text(json.dumps(graph), "node-link")


def short(ask):
    """Ask for something, and raise a refusal only if it is short."""
    try:
        ask()
    except OpenLockError as error:
        if len(str(error)) < 1000:
            raise


def graphml(parts):
    """Read a GraphML graph of the nodes A and door, and these parts."""
    keys = "".join(
        f'<key id="{key}" for="edge" attr.name="{name}" attr.type="double"/>'
        for key, name in (("s", "strength"), ("w", "weight"))
    )
    return schema_text(
        '<graphml xmlns="http://graphml.graphdrawing.org/xmlns" '
        'xmlns:y="http://www.yworks.com/xml/graphml">'
        f'{keys}<key id="g" for="edge" yfiles.type="edgegraphics"/><graph edgedefault="directed">'
        f'<node id="A"/><node id="door"/>{parts}</graph></graphml>',
        "graphml",
    )


def session(condition="CC3", subjects=2, **settings):
    """Begin a session of a condition, under the protocol of people with some settings changed."""
    if isinstance(condition, str):
        condition = ol.find_condition(condition)
    protocol = replace(ol.PROTOCOLS["human"], **settings)
    return of("causal_openlock.experiment.session", "Session")(condition, protocol, subjects)


def trials(number, layouts=None):
    """A condition of so many trials in rooms of CC3."""
    cc3 = ol.find_schema("CC3")
    if isinstance(layouts, list):
        placed = of("causal_openlock.world.room", "Layout").of
        layouts = tuple(placed(cc3, layout) for layout in layouts)
    return ol.Condition("mine", (ol.Trials(cc3, layouts, number),))


def believed(schema):
    """The model of what a structure learner believes before its first action."""
    learner, played = ol.create("bayes"), session(schema, 1)
    played.begin(learner)
    learner.act(played.view)
    return learner.model(0)
