"""``causal-openlock notebook``: begin a notebook from the template, or from one of the lessons."""

from __future__ import annotations

import json
import shlex
from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.terminal import say
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_text

SUFFIX = ".ipynb"


def notebook(
    name: Annotated[str, typer.Argument(help="Its name; .ipynb is added.")],
    lesson: Annotated[
        int | None, typer.Option(help="Begin with this lesson, and not with the template.")
    ] = None,
) -> None:
    """Begin a notebook from a template, or from a lesson."""
    from causal_openlock.schemas.finding import bundled

    path = Path(name if name.lower().endswith(SUFFIX) else f"{name}{SUFFIX}")
    if not name.strip() or name.endswith(("/", "\\", ".")) or not name.isprintable():
        raise OpenLockError(f"{name!r} is not a name of a notebook; choose one such as mine")
    if path.exists() or path.is_symlink():
        raise OpenLockError(f"{path} exists already; choose another name, or remove it first")
    lessons = sorted(bundled("notebooks").glob(f"[0-9]*{SUFFIX}"))
    if lesson is None:
        source = bundled("notebooks") / f"template{SUFFIX}"
    elif 1 <= lesson <= len(lessons):
        source = lessons[lesson - 1]
    else:
        raise OpenLockError(f"there is no lesson {lesson}; there are lessons 1 to {len(lessons)}")
    contents = json.loads(source.read_text(encoding="utf-8"))
    for cell in contents["cells"]:
        if cell["cell_type"] == "code":
            cell.update(execution_count=None, outputs=[])
    write_text(path, json.dumps(contents, indent=1, ensure_ascii=False) + "\n")
    say(f"{path} written; open it in an editor, or with: jupyter lab {shlex.quote(str(path))}")
