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

import importlib
import pkgutil
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import typer
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import causal_openlock
from causal_openlock.cli import app as program

COMMAND: Any = typer.main.get_command(program)  # before autodoc rewrites what options are read from


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> Iterator[str]:
    """A table as lines of reStructuredText."""
    yield from (".. list-table::", "   :header-rows: 1", "")
    for row in (heads, *rows):
        for index, cell in enumerate(row):
            yield f"   {'  -' if index else '* -'} {' '.join(str(cell).split())}"
    yield ""


def section(title: str, *lines: str) -> Iterator[str]:
    """A heading and what stands under it, as lines of reStructuredText."""
    yield from (title, "-" * len(title), "", *lines, "")


def text_of(text: str) -> str:
    """A text with its stars and bars as they are, and what stands in backticks as code."""
    parts = re.split(r"`+([^`]+)`+", re.sub(r":\w+:`~?", "`", text))
    parts[::2] = [re.sub(r"([*_|\\<>])", r"\\\1", part) for part in parts[::2]]
    parts[1::2] = [f"\\ ``{part}``\\ " for part in parts[1::2]]
    return "".join(parts)


def public_api() -> Iterator[str]:
    """A table for each group of ``__init__.pyi``: each name with its first sentence, and a link."""
    stub = Path(causal_openlock.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    _, *groups = re.split(r"\n\n# (.*)\n", stub.partition("\n\n__version__")[0])
    for title, text in zip(groups[::2], groups[1::2], strict=True):
        rows = []
        for home, name in re.findall(r"from (\S+) import (\w+)", text):
            module = f"causal_openlock{home}"
            value = getattr(importlib.import_module(module), name)
            first = (value.__doc__ or "").partition("\n")[0] if callable(value) else ""
            rows.append((f":py:obj:`{name} <{module}.{name}>`", text_of(first)))
        yield from section(title, *table(("name", "what it is"), rows))


def modules(names: str) -> Iterator[str]:
    """A heading and the docstrings of each module."""
    for name in names.split():
        for module in modules_of(name):
            yield from section(module, f".. automodule:: {module}")


def modules_of(name: str) -> Iterator[str]:
    """A module, or with ``.*`` a package and all in it."""
    yield (package := name.removesuffix(".*"))
    if name != package:
        for part in pkgutil.iter_modules(importlib.import_module(package).__path__):
            yield from modules_of(f"{package}.{part.name}{'.*' * part.ispkg}")


def command_help(command: Any = COMMAND, name: str = "causal-openlock") -> Iterator[str]:
    """A heading and the text for each command."""
    context = command.make_context(name, [], resilient_parsing=True)
    context.terminal_width = context.max_content_width = 88
    said = command.get_help(context).splitlines()
    yield from section(name, ".. code-block:: text", "", *(f"   {line}" for line in said))
    for part, inner in getattr(command, "commands", {}).items():
        yield from command_help(inner, f"{name} {part}")


def file_format(place: str) -> Iterator[str]:
    """A table for a file, given by ``module:function`` of its JSON Schema, and for each part."""
    module, _, function = place.partition(":")
    schema = getattr(importlib.import_module(module), function)()
    for name, part in {"": schema, **schema.get("$defs", {})}.items():
        if "properties" not in part:
            continue
        rows = [
            (
                f"``{key}``",
                "required" if key in part.get("required", ()) else kind_of(said),
                f"``{said['default']}``" if said.get("default") not in (None, "", [], {}) else "",
                text_of(said.get("description", "")),
            )
            for key, said in part["properties"].items()
        ]
        yield from ((f".. rubric:: {name}", "") if name else ())
        yield from (text_of(part.get("description", "")), "")
        yield from table(("key", "value", "if left out", "meaning"), rows)


def kind_of(said: dict[str, Any]) -> str:
    """What a value has to be: a part of the file, one of some words, or a type of JSON."""
    if "$ref" in said:
        return f"*{said['$ref'].rpartition('/')[2]}*"
    if arms := said.get("anyOf") or said.get("oneOf"):
        return " or ".join(dict.fromkeys(map(kind_of, arms)))
    if words := said.get("enum") or ([said["const"]] if "const" in said else []):
        return " or ".join(f"``{word}``" for word in words)
    inner = said.get("items") or said.get("additionalProperties")
    of = f" of {kind_of(inner)}" if isinstance(inner, dict) else ""
    return f"{said.get('type', 'anything')}{of}"


def learner_parameters() -> Iterator[str]:
    """A heading and a table for each registered learner of this project."""
    from causal_openlock.contract.registry import learner_class, parameter_table, registry

    for name, entry in registry().items():
        if entry.value.startswith("openlock_learners."):
            first = (learner_class(name).__doc__ or "").split("\n\n")[0]
            yield from section(name, f":py:class:`{entry.value.replace(':', '.')}`. {first}", "")
            rows = [
                (f"``{one.name}``", f"``{one.default!r}``", text_of(one.meaning))
                for one in parameter_table(name)
            ]
            yield from table(("parameter", "default", "meaning"), rows) if rows else ()


def record_columns() -> Iterator[str]:
    """A table of the record's columns."""
    from causal_openlock.experiment.record import record_schema

    def kind(column: Any) -> str:
        return re.sub(r"^dictionary.*", "text", str(column.type)).replace("item: ", "")

    yield from table(
        ("column", "type", "meaning"),
        [
            (f"``{one.name}``", f"``{kind(one)}``", text_of(one.metadata[b"meaning"].decode()))
            for one in record_schema()
        ],
    )


def reward_presets() -> Iterator[str]:
    """A table of the rewards that have a name."""
    from causal_openlock.world.rewards import PRESETS, Reward

    sums = {name: one for name, one in PRESETS.items() if isinstance(one, Reward)}
    rows = [(f"``{name}``", ", ".join(f"``{x}``" for x in one.terms)) for name, one in sums.items()]
    yield from table(("name", "terms that add up"), rows)
    yield "Ladders of the authors' program of January 2018, whose first rung that fits pays: "
    yield ", ".join(f"``{name}``" for name in PRESETS if name not in sums)


def directive(lines: Callable[..., Iterable[str]], arguments: int = 0) -> type[SphinxDirective]:
    """A directive that says what a function's lines of reStructuredText say."""

    class FromTheProgram(SphinxDirective):
        required_arguments = arguments
        final_argument_whitespace = True

        def run(self) -> list[nodes.Node]:
            text = "\n".join(lines(*self.arguments))
            return self.parse_text_to_nodes(text, allow_section_headings=True)

    return FromTheProgram


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directives."""
    for lines in (public_api, command_help, learner_parameters, record_columns, reward_presets):
        app.add_directive(lines.__name__.replace("_", "-"), directive(lines))
    app.add_directive("modules", directive(modules, arguments=1))
    app.add_directive("file-format", directive(file_format, arguments=1))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
