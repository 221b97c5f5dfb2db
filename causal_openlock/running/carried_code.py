"""Code that goes with an experiment to other machines: learners and rewards that no package brings.

``module:Class`` names a class in a file of the user, which other machines need not have, or may
have in an older form. So its file, and those next to it that it imports, are copied into the
results folder (:func:`carry`). A worker compares their hashes with those that it was sent, and
imports them from there (:func:`use`).
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from causal_openlock.contract import registry
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.digest import digest
from causal_openlock.usercode.local_modules import local_modules
from causal_openlock.usercode.module_source import is_users_own, module_source
from causal_openlock.usercode.session_code import is_of_session
from causal_openlock.world import reward_code
from causal_openlock.world.reward_code import OwnReward, source_of


@dataclass(frozen=True)
class CarriedCode:
    """Files that were copied into a results folder.

    Attributes:
        folder: The folder to import them from.
        files: The SHA-256 of each, by its path there.
    """

    folder: str
    files: Mapping[str, str]


def carry(experiment: Experiment, folder: Path) -> CarriedCode:
    """Copy the code of an experiment's learners and rewards into its results folder.

    Raises:
        LearnerError: If a file has changed since the experiment was declared.
        OpenLockError: If a file is not valid Python or cannot be written.
    """
    named: dict[str, bool] = {}  # and whether it is as it was declared
    for spec in experiment.learners:
        if ":" in spec.learner and not is_of_session(spec.learner):
            named[spec.learner] = spec.origin.package == registry.origin(spec.learner)
        if isinstance(spec.reward, OwnReward) and not is_of_session(spec.reward.name):
            named[spec.reward.name] = spec.reward.source == source_of(spec.reward.name)
    found: dict[str, bytes] = {}
    for name, same in named.items():
        module = name.partition(":")[0]
        source = module_source(module)
        if source is None or not is_users_own(source):
            continue
        if not same:
            raise LearnerError(
                f"the file of {name} has changed since the experiment was declared; declare it "
                "again"
            )
        files = local_modules(module).files
        found |= {inside: path.read_bytes() for inside, path in files.items()}
    hashes = {inside: _sha256(content) for inside, content in sorted(found.items())}
    place = folder.resolve() / "code" / digest(repr(hashes))
    for inside, content in found.items():
        write_bytes(place / inside, content)
    return CarriedCode(str(place), hashes)


def use(carried: CarriedCode) -> None:
    """Import from these files, in place of others that have the same names.

    Raises:
        OpenLockError: If one is missing or is not what was carried.
    """
    if sys.path[0] == carried.folder or not carried.files:
        return
    for inside, expected in carried.files.items():
        path = Path(carried.folder) / inside
        if not path.is_file() or _sha256(path.read_bytes()) != expected:
            raise OpenLockError(
                f"{path} is missing or is not what it was when the comparison began; give the same "
                "command again"
            )
    tops = {Path(inside).parts[0].removesuffix(".py") for inside in carried.files}
    for name in [name for name in sys.modules if name.partition(".")[0] in tops]:
        del sys.modules[name]  # of another comparison
    registry.forget()
    reward_code.forget()
    sys.path.insert(0, carried.folder)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
