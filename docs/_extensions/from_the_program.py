"""Directives whose content comes from the program itself, so that it cannot fall behind.

=========================== ====================================================================
``.. public-api::``         The names of the package, grouped as ``__init__.pyi`` lists them.
``.. modules::``            The reference of modules, from their docstrings; ``package.*`` stands
                            for a package with all that is in it.
``.. command-help::``       What ``--help`` says of every command.
``.. file-format::``        The keys of a file, from the JSON Schema that editors use.
``.. learner-parameters::`` The registered learners and their parameters.
``.. record-columns::``     The columns of the record.
``.. reward-presets::``     The rewards that have a name.
=========================== ====================================================================
"""

from __future__ import annotations

import ast
import importlib
import inspect
import itertools
import pkgutil
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import causal_openlock

HELP_WIDTH = 88


def escaped(text: str) -> str:
    """A text as reStructuredText that shows this text, and what stands in backticks as code."""
    parts = re.split(r"`+([^`]+)`+", text)
    parts[::2] = [re.sub(r"([*_|\\<>])", r"\\\1", part) for part in parts[::2]]
    parts[1::2] = [f"\\ {literal(part)}\\ " for part in parts[1::2]]
    return "".join(parts)


def literal(text: str) -> str:
    """A text in the type of code."""
    return f"``{text}``" if text else ""


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], widths: str = "auto") -> list[str]:
    """A table as lines of reStructuredText."""
    lines = [".. list-table::", "   :header-rows: 1", f"   :widths: {widths}", ""]
    for row in (heads, *rows):
        for index, cell in enumerate(row):
            lines.append(f"   {'* -' if index == 0 else '  -'} {' '.join(cell.split())}")
    return [*lines, ""]


def section(title: str, *lines: str, mark: str = "-") -> list[str]:
    """A heading and what stands under it, as lines of reStructuredText."""
    return [title, mark * len(title), "", *lines, ""]


class FromTheProgram(SphinxDirective):
    """A directive that writes lines of reStructuredText."""

    optional_arguments = 1
    final_argument_whitespace = True

    def lines(self) -> Iterable[str]:
        """The lines."""
        raise NotImplementedError

    def run(self) -> list[nodes.Node]:
        """What the lines say."""
        return self.parse_text_to_nodes("\n".join(self.lines()), allow_section_headings=True)


class Modules(FromTheProgram):
    """The reference of modules: a heading and the docstrings of each."""

    required_arguments = 1
    optional_arguments = 0

    def lines(self) -> Iterator[str]:
        """A heading and an ``automodule`` for each module."""
        for name in self.arguments[0].split():
            for module in modules_of(name):
                yield from section(module, f".. automodule:: {module}")


def modules_of(name: str) -> list[str]:
    """A module, or with ``.*`` a package and all in it, in the order its docstring names them."""
    if not name.endswith(".*"):
        return [name]
    package = importlib.import_module(name.removesuffix(".*"))
    text = package.__doc__ or ""

    def place(part: pkgutil.ModuleInfo) -> tuple[int, str]:
        found = re.search(rf"``{part.name}``", text)
        return (found.start() if found else len(text), part.name)

    parts = sorted(pkgutil.iter_modules(package.__path__), key=place)
    names = (f"{package.__name__}.{part.name}{'.*' if part.ispkg else ''}" for part in parts)
    return [package.__name__, *(module for part in names for module in modules_of(part))]


class PublicAPI(FromTheProgram):
    """What users import, each name with its first sentence and a link to all of it."""

    optional_arguments = 0

    def lines(self) -> Iterator[str]:
        """A table for each group of ``__init__.pyi``."""
        stub = Path(causal_openlock.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
        _, *groups = re.split(r"\n\n# (.*)\n", stub.partition("\n\n__version__")[0])
        for title, text in zip(groups[::2], groups[1::2], strict=True):
            rows = [self.row(*found) for found in re.findall(r"from (\S+) import (\w+)", text)]
            yield from section(title, *table(("name", "what it is"), rows))

    def row(self, home: str, name: str) -> tuple[str, str]:
        """A name as a link to where it is documented, and what it is."""
        module = importlib.import_module(f"causal_openlock{home}")
        value = getattr(module, name)
        if not (callable(value) and hasattr(value, "__qualname__")):
            return literal(name), first_sentence(comment_below(module, name))
        role = "class" if isinstance(value, type) else "func"
        return f":{role}:`{name} <{module.__name__}.{name}>`", first_sentence(value.__doc__ or "")


def comment_below(module: ModuleType, name: str) -> str:
    """The text below the assignment of a constant, which Python itself does not keep."""
    _, found = next(
        pair
        for pair in itertools.pairwise(ast.parse(inspect.getsource(module)).body)
        if isinstance(pair[0], ast.Assign | ast.AnnAssign)
        and name in {node.id for node in ast.walk(pair[0]) if isinstance(node, ast.Name)}
    )
    is_text = isinstance(found, ast.Expr) and isinstance(found.value, ast.Constant)
    return str(found.value.value) if is_text else ""


def first_sentence(text: str) -> str:
    """The first line of a docstring, with roles as plain code."""
    return escaped(re.sub(r":\w+:`~?([^`]*)`", r"`\1`", text.strip().partition("\n")[0]))


class CommandHelp(FromTheProgram):
    """What ``--help`` says of every command."""

    command: Any = None

    def lines(self) -> Iterator[str]:
        """A heading and the text for each command."""

        def told(command: Any, name: str) -> Iterator[str]:
            # Click's context class, wherever Typer has it from.
            context = command.make_context(name, [], resilient_parsing=True)
            context.terminal_width = context.max_content_width = HELP_WIDTH
            said = command.get_help(context).splitlines()
            yield from section(name, ".. code-block:: text", "", *(f"   {line}" for line in said))
            for part, inner in getattr(command, "commands", {}).items():
                yield from told(inner, f"{name} {part}")

        yield from told(self.command, "causal-openlock")


class FileFormat(FromTheProgram):
    """The keys of a file; the argument is ``module:function`` of its JSON Schema."""

    def lines(self) -> Iterator[str]:
        """A table for the file, and one for each mapping in it."""
        module, _, function = self.arguments[0].partition(":")
        schema = getattr(importlib.import_module(module), function)()
        parts = {schema["title"]: schema, **schema.get("$defs", {})}
        for name, part in parts.items():
            if "properties" not in part:
                continue
            needed = part.get("required", ())
            rows = [
                (
                    literal(key),
                    kind_of(said),
                    "required" if key in needed else literal(default_of(said)),
                    escaped(said.get("description", "")),
                )
                for key, said in part["properties"].items()
            ]
            if part is not schema:
                yield from (f".. _format-{function}-{name}:", "", f".. rubric:: {plain(name)}", "")
            yield from (escaped(part.get("description", "")), "")
            yield from table(("key", "value", "if left out", "meaning"), rows)


def plain(name: str) -> str:
    """``TrialsFile`` as it is called in the text: trials."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name.removesuffix("File")).lower()


def kind_of(said: dict[str, Any]) -> str:
    """What a value has to be, in a few words."""
    if "$ref" in said:
        return f"*{plain(said['$ref'].rpartition('/')[2])}*"
    if "enum" in said or "const" in said:
        return " or ".join(literal(str(value)) for value in said.get("enum", [said.get("const")]))
    arms = said.get("anyOf") or said.get("oneOf")
    if arms:
        kinds = dict.fromkeys(kind_of(arm) for arm in arms if arm.get("type") != "null")
        return ", or ".join(kinds)
    kind = said.get("type", "anything")
    if kind == "array":
        return f"list of {kind_of(said.get('items', {}))}"
    if kind == "object":
        inner = said.get("additionalProperties")
        return f"mapping to {kind_of(inner)}" if isinstance(inner, dict) else "mapping"
    kind = {"string": "text", "integer": "whole number", "boolean": "true or false"}.get(kind, kind)
    bounds = {
        "minimum": "at least",
        "exclusiveMinimum": "above",
        "maximum": "at most",
        "exclusiveMaximum": "below",
    }
    told = [f"{words} {said[key]}" for key, words in bounds.items() if key in said]
    return ", ".join([kind, *told])


def default_of(said: dict[str, Any]) -> str:
    """The value of a key that is left out; of lists and mappings that is an empty one."""
    value = said.get("default")
    return "" if value is None or isinstance(value, list | dict) else in_yaml(value)


def in_yaml(value: Any) -> str:
    """A value as it is written in an experiment file."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    return f"{value:g}" if isinstance(value, float) else str(value)


class LearnerParameters(FromTheProgram):
    """The registered learners of this project and their parameters."""

    def lines(self) -> Iterator[str]:
        """A heading and a table for each learner."""
        from causal_openlock.contract.registry import learner_class, parameter_table, registry

        for name, entry in registry().items():
            if not entry.value.startswith("openlock_learners."):
                continue
            single = learner_class(name)
            first = (single.__doc__ or "").split("\n\n")[0]
            known = parameter_table(name)
            yield from section(name, f":py:class:`{entry.value.replace(':', '.')}`. {first}", "")
            if known:
                rows = [
                    (literal(one.name), literal(in_yaml(one.default)), escaped(one.meaning))
                    for one in known
                ]
                yield from table(("parameter", "default", "meaning"), rows)


class RecordColumns(FromTheProgram):
    """The columns of the record."""

    def lines(self) -> Iterable[str]:
        """A table."""
        from causal_openlock.experiment.record import record_schema

        def kind(field: Any) -> str:
            return re.sub(r"^dictionary.*", "text", str(field.type)).replace("item: ", "")

        rows = [
            (
                literal(field.name),
                literal(kind(field)),
                escaped(field.metadata[b"meaning"].decode()),
            )
            for field in record_schema()
        ]
        return table(("column", "type", "meaning"), rows)


class RewardPresets(FromTheProgram):
    """The rewards that have a name."""

    def lines(self) -> Iterator[str]:
        """A table of sums, and a list of ladders."""
        from causal_openlock.world.rewards import PRESETS, Reward

        sums = {name: one for name, one in PRESETS.items() if isinstance(one, Reward)}
        rows = [(literal(name), ", ".join(map(literal, one.terms))) for name, one in sums.items()]
        yield from table(("name", "terms that add up"), rows)
        yield "What the authors' program of January 2018 paid, ladders whose first rung that"
        yield from ("fits pays, with these rungs beside unlocking and opening the door:", "")
        for name, one in PRESETS.items():
            if name not in sums:
                rungs = [field.name for field in fields(one) if getattr(one, field.name) is True]
                yield f"* {literal(name)}{': ' if rungs else ''}{', '.join(rungs)}"


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    import typer

    from causal_openlock.cli import app as program

    # Now, since autodoc rewrites the signatures that options are read from.
    CommandHelp.command = typer.main.get_command(program)
    app.add_directive("public-api", PublicAPI)
    app.add_directive("modules", Modules)
    app.add_directive("command-help", CommandHelp)
    app.add_directive("file-format", FileFormat)
    app.add_directive("learner-parameters", LearnerParameters)
    app.add_directive("record-columns", RecordColumns)
    app.add_directive("reward-presets", RewardPresets)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
