"""The user's own code and files that an experiment was run with, in its results folder.

::

    code/mine_0123456789abcdef/      modules of a learner or a reward that comes with no package
    code/Mine_0123456789abcdef.py    source of one that a notebook or a script defined
    files/LEARNER/PARAMETER/         the file that a parameter names, such as trained weights

They are for people, and for bundles: nothing in a results folder is ever run.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from causal_openlock.errors import StoreError
from causal_openlock.experiment.declare import Experiment
from causal_openlock.files.atomic import write_bytes, write_text
from causal_openlock.usercode.own_files import digest_of, own_files
from causal_openlock.usercode.session_code import is_of_session, session_source
from causal_openlock.world.rewards import OwnReward


def store_code(experiment: Experiment, folder: Path) -> list[str]:
    """Write the user's code and files of an experiment into its results folder.

    Returns:
        The folders that its modules can be imported from.
    """
    folders: dict[str, None] = {}
    for spec in experiment.learners:
        # The class may be in another module than the one that it is named by.
        named = [(spec.learner, spec.origin.package, {spec.origin.class_name.partition(":")[0]})]
        if isinstance(spec.reward, OwnReward):
            named.append((spec.reward.name, spec.reward.source, set()))
        for name, origin, modules in named:
            place = _place(folder, origin)  # named by what it holds, so written once
            if is_of_session(name):
                if not place.exists():
                    write_text(place, session_source(name))
            elif _is_own(name):
                folders[str(place.with_suffix(""))] = None
                for inside, path in own_files({name.partition(":")[0], *modules}).items():
                    if not (copy := place.with_suffix("") / inside).exists():
                        write_bytes(copy, path.read_bytes())
        for parameter, value in spec.parameters.items():
            with suppress(OSError, ValueError):  # a text that is no path
                if spec.origin.artifact_hash and isinstance(value, str) and Path(value).is_file():
                    copy = folder / "files" / spec.name / parameter / Path(value).name
                    write_bytes(copy, Path(value).read_bytes())
    return [*folders]


def stored_code(name: str, origin: str, folder: Path) -> tuple[str, dict[str, Path]]:
    """Return what ``module:Class`` is called where its stored code stands, and the files of that.

    Raises:
        StoreError: If the folder has the code, and not that of the recorded ``origin``.
    """
    place = _place(folder, origin)
    files: dict[str, Path] = {}
    if is_of_session(name):
        files = {place.name: place} if place.is_file() else {}
        name = f"{place.stem}:{name.partition(':')[2]}"
    elif _is_own(name):
        place = place.with_suffix("")
        files = {path.relative_to(place).as_posix(): path for path in place.rglob("*.py")}
    if files and digest_of(files) != origin[-16:]:
        raise StoreError(f"{place} is not the source of {name} that was run; compare again")
    return name, files


def stored_files(learner: str, folder: Path) -> dict[str, Path]:
    """Return the stored files that a learner's parameters name, by parameter."""
    return {
        path.parent.name: path
        for path in (folder / "files").glob("*/*/*")
        if path.parts[-3] == learner
    }


def _is_own(name: str) -> bool:
    return ":" in name and not name.startswith("causal_openlock.")


def _place(folder: Path, origin: str) -> Path:
    name = re.sub(r"\W", "_", origin.replace(".py ", "_"))
    return folder / "code" / f"{name[-200:]}.py"
