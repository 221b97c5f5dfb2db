"""Everything that is needed to run an experiment again, and its results, in one file.

A bundle is a ZIP file with one folder in it::

    NAME/
      DATA_CARD.md           what is to be known before the data are used
      README.md              what this is, and the one command that runs it again
      experiment.yaml        the experiment, every default written out
      schemas/               the schemas that it plays
      my_learner.py, ...     learners that come with no package, and modules that these import
      files/                 files that learners' parameters name
      requirements.txt       versions of the packages that it was run with
      results/               the results folder: the record, cell by cell, transcripts of what
                             was said, and the report

Equal results give equal bundles, byte for byte. Whether its experiment is the one that was run is
checked when it is made.

The folder may be of other people, and what it says of itself forged. So nothing that it names is
run, and a file from outside the folder gets in only if its content has the hash that the results
were made with: anybody who could forge that hash has the content already. Paths in the bundle lead
nowhere else, whatever things are called.
"""

from __future__ import annotations

import hashlib
import json
import re
import shlex
import tempfile
import zipfile
from collections.abc import Iterable
from dataclasses import replace
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jinja2 import Template

from causal_openlock.analysis.report.page import files_of
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.declare import PERSON, Experiment, LearnerSpec
from causal_openlock.experiment.file import read_experiment
from causal_openlock.export.data_card import data_card
from causal_openlock.files.atomic import replacing, write_bytes
from causal_openlock.files.digest import digest
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.storage.stored import StoredExperiment
from causal_openlock.storage.versions import Versions
from causal_openlock.usercode.own_files import digest_of, module_source, own_files
from causal_openlock.usercode.session_code import is_of_session
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.world.reward_code import OwnReward
from causal_openlock.world.rewards import PAPER_REWARD, find_reward

if TYPE_CHECKING:
    from causal_openlock.storage.store import Store

Contents = dict[str, bytes]
"""Files by their paths in a bundle."""

COMMAND = "causal-openlock compare experiment.yaml --out again"
"""Command that runs the experiment of a bundle again, in its folder."""

BESIDE = ("reactions", "structures")
"""Folders with a file for each person, in addition to the person's cell."""

_THEN = (1980, 1, 1, 0, 0, 0)  # the date of every file in a bundle
_PACKED = (".parquet", ".png")  # these cannot be made any smaller
_MOST_BYTES = 1 << 28  # of a file that a parameter names
_HASH = re.compile(r"[0-9a-f]{16,64}")
_RESERVED = re.compile(r"(CON|PRN|AUX|NUL|COM\d|LPT\d)(\.|$)", re.IGNORECASE)  # by Windows
_REQUIREMENT = re.compile(r"[A-Za-z0-9][\w.-]*( [\w.+!-]+| not installed)", re.ASCII)


def write_bundle(store: Store, path: Path | str, licence: str = "") -> list[str]:
    """Bundle a results folder.

    Args:
        store: The results folder; its report is to be there.
        path: The ZIP file to write.
        licence: Under what the data may be used; an SPDX identifier or an address.

    Returns:
        What is to be known of it, a sentence each: why it could not be checked that it runs again.

    Raises:
        StoreError: If the folder holds no results, not all of them, or no report.
        OpenLockError: If a learner's file is not what it was, or the bundle cannot be written.
    """
    experiment = store.experiment()
    cells, missing = store.files()
    if missing:
        raise StoreError(
            f"{store.folder} is unfinished, {len(missing)} of its cells are missing; run compare "
            "again to complete it, then bundle it"
        )
    report = store.folder / "report.html"
    if not report.exists():
        raise StoreError(
            f"{store.folder} has no report; write it first, with: causal-openlock report "
            f"{store.folder}"
        )
    record, described = store.record()  # all columns, so that no damage is packed
    who = record.select(["learner", "condition", "subject", "phase"])
    versions = described.versions
    packages = _packages(experiment, versions)
    again = any(spec.learner != PERSON for spec in experiment.learners)
    contents, warnings = _experiment(experiment, packages, store) if again else ({}, [])
    contents["requirements.txt"] = _requirements(packages).encode()
    contents["README.md"] = _readme(experiment, versions, again, warnings).encode()
    results = [store.folder / "experiment.json", report, store.folder / "summary.csv", *cells]
    results += [store.folder / name for name in files_of(report)]
    results += [store.folder / part / one.name for part in BESIDE for one in cells]
    results += sorted(store.folder.glob("consent_*.md"))
    results += map(store.transcript, cells)
    for one in filter(Path.is_file, results):
        contents[f"results/{one.relative_to(store.folder).as_posix()}"] = one.read_bytes()
    contents["DATA_CARD.md"] = data_card(experiment, who, contents, licence).encode()
    name = _part(experiment.name)
    with replacing(path) as file, zipfile.ZipFile(file, "w") as bundle:
        for inside, content in sorted(contents.items()):
            about = zipfile.ZipInfo("/".join([name, *map(_part, inside.split("/"))]), _THEN)
            about.external_attr = 0o644 << 16
            about.compress_type = (
                zipfile.ZIP_STORED if inside.endswith(_PACKED) else zipfile.ZIP_DEFLATED
            )
            bundle.writestr(about, content)
    return warnings


def _part(name: Any) -> str:
    """A name as a part of a path, which leads nowhere else on any system."""
    plain = re.sub(r"[^\w.+ -]", "_", str(name))[:200].strip(" .")
    return f"_{plain}" if not plain or _RESERVED.match(plain) else plain


def _experiment(
    experiment: StoredExperiment, packages: Versions, store: Store
) -> tuple[Contents, list[str]]:
    """The experiment file and all that it names, and why it may not run as it did."""
    contents: Contents = {}
    for condition in experiment.conditions:
        for schema in condition.schemas:
            contents[f"schemas/{schema.name}.yaml"] = schema.to_yaml().encode()
    learners, moved, warnings = [], False, []
    of_notebook: list[str] = []
    places = _places(experiment)
    for spec in experiment.learners:
        if ":" in spec.learner and not is_of_session(spec.learner):
            found, warned = _module(spec, places, set(packages))
            contents.update(found)
            warnings += [one for one in warned if one not in warnings]
        if is_of_session(spec.learner):
            name, content = _from_session(spec.learner, spec.origin.package, store)
            spec = replace(spec, learner=name)
            contents.update(content)
            of_notebook.append(spec.name)
        if isinstance(spec.reward, OwnReward) and is_of_session(spec.reward.name):
            name, content = _from_session(spec.reward.name, spec.reward.source, store)
            spec = replace(spec, reward=replace(spec.reward, name=name))
            contents.update(content)
            of_notebook.append(f"the reward of {spec.name}")
        files = _files(spec)
        moved |= bool(files)
        contents.update(files.values())
        inside = {name: path for name, (path, _) in files.items()}
        learners.append(replace(spec, parameters={**spec.parameters, **inside}))
    declared = replace(experiment, learners=tuple(learners)).as_file()
    contents["experiment.yaml"] = dump_yaml(declared).encode()
    warnings += [
        f"{one} was defined in a notebook; its source is bundled as a module, and counts as "
        "another; what only a program could make is a comment in it."
        for one in of_notebook
    ]
    if moved or of_notebook:
        return contents, warnings
    return contents, warnings + _checked(contents, experiment)


def _places(experiment: StoredExperiment) -> list[Path]:
    """Folders in which learners may have been found: this one, and that of the experiment file."""
    try:
        command = shlex.split(experiment.command)
        found = len(command) > 2 and Path(command[2]).is_file()
    except (ValueError, OSError):
        found = False
    return [Path.cwd(), *([Path(command[2]).resolve().parent] if found else [])]


def _from_session(name: str, origin: str, store: Store) -> tuple[str, Contents]:
    """A notebook's definitions, as a name of a module, and that module."""
    path = store.source(origin)
    content = path.read_bytes() if path.is_file() else b""
    name = name.partition(":")[2]
    if digest(content) != origin[-16:]:
        raise StoreError(
            f"{path} is not the source of {name} that the results were made with; compare again"
        )
    return f"{path.stem}:{name}", {path.name: content}


def _module(
    spec: LearnerSpec, places: Iterable[Path], packages: set[str]
) -> tuple[Contents, list[str]]:
    """The files of a learner that comes with no package, and remarks about them."""
    name, package = spec.learner, spec.origin.package
    if name.startswith("causal_openlock."):
        return {}, []
    # The class may be in another module than the one that it is named by.
    source = module_source(spec.origin.class_name.partition(":")[0], places)
    module = name.partition(":")[0]
    modules = {module, spec.origin.class_name.partition(":")[0]}
    now = f"{source.name} {digest_of(own_files(modules, places).files)}" if source else "not found"
    # Results of earlier versions tell of the file alone.
    alone = source is not None and f"{source.name} {digest(source.read_bytes())}" == package
    if now != package and not alone:
        raise OpenLockError(
            f"{name} is not what the results were made with (that was {package}, and this is "
            f"{now}); restore it, or compare again"
        )
    found = own_files([module], places)
    # A link may lead to anything, and a bundle is for others.
    files = {
        inside: path
        for inside, path in found.files.items()
        if path.resolve().is_relative_to(path.parents[inside.count("/")].resolve())
    }
    warnings = []
    helpers = sorted(set(files) - {f"{module.replace('.', '/')}.py"})
    if helpers and now != package:
        warnings.append(
            f"{module} imports {', '.join(helpers)}, bundled as now; whether that has changed "
            "since the results were made is not on record."
        )
    installed = packages_distributions() if found.others else {}
    named = {_normal(package) for package in packages}
    missing = sorted(
        one for one in found.others if not named & {_normal(p) for p in installed.get(one, [one])}
    )
    if missing := [*sorted(found.files.keys() - files), *missing]:
        warnings.append(
            f"{module} imports {', '.join(missing)}, which neither the bundle nor its "
            "requirements.txt holds."
        )
    return {inside: path.read_bytes() for inside, path in files.items()}, warnings


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _normal(package: str) -> str:
    """A package's name as indexes of packages compare it."""
    return re.sub(r"[-_.]+", "-", package).lower()


def _files(spec: LearnerSpec) -> dict[str, tuple[str, bytes]]:
    """Files that a learner's parameters name: by parameter, path in the bundle and content."""
    hashes = _HASH.findall(spec.origin.artifact_hash)
    named = {
        name: Path(value)
        for name, value in spec.parameters.items()
        if isinstance(value, str) and spec.origin.artifact_hash and _is_file(value)
    }
    files = {}
    for name, path in named.items():
        content = path.read_bytes() if path.stat().st_size <= _MOST_BYTES else b""
        if any(map(_hash(content).startswith, hashes)):
            inside = "/".join(["files", *map(_part, (spec.name, name, path.name))])
            files[name] = inside, content
    if named and not files:
        name, path = next(iter(named.items()))
        raise OpenLockError(
            f"{path}, which the parameter {name} of {spec.name} names, is not the file that "
            "the results were made with; restore it, or compare again"
        )
    return files


def _is_file(value: str) -> bool:
    try:
        return Path(value).is_file()
    except (OSError, ValueError):  # too long, or with a zero in it
        return False


def _checked(contents: Contents, experiment: StoredExperiment) -> list[str]:
    """Reasons why reading the experiment file does not give the experiment that was run."""
    # No code runs for this: another learner stands in for those that come with no package, whose
    # source has been found to be what it was, and the paper's reward for functions of one's own.
    stand_ins = []
    for spec in experiment.learners:
        if ":" in spec.learner:
            spec = replace(spec, learner="random", parameters={})
        if isinstance(spec.reward, OwnReward):
            spec = replace(spec, reward=find_reward(PAPER_REWARD))
        stand_ins.append(spec)
    declared = replace(experiment, learners=tuple(stand_ins)).as_file()
    with tempfile.TemporaryDirectory() as folder:
        for inside, content in contents.items():
            if inside.startswith("schemas/"):
                write_bytes(Path(folder) / inside, content)
        path = Path(folder) / "experiment.yaml"
        write_bytes(path, dump_yaml(declared).encode())
        try:
            read = read_experiment(path)
            learners = tuple(map(_put_back, read.learners, experiment.learners))
            now = replace(read, title=experiment.title, command="", learners=learners)
            data = _plain(now)
        except OpenLockError as error:
            message = str(error).splitlines()[0].replace(f"{path}:", "experiment.yaml:")
            return [f"It could not be checked that this runs again ({message})."]
    then = _plain(replace(experiment, command=""))
    if data == then:
        codes = {spec.reward.name for spec in learners if isinstance(spec.reward, OwnReward)}
        return [
            f"The reward {code} is not in the bundle; put its file next to experiment.yaml."
            for code in sorted(codes)
        ]
    if experiment.version != RESULTS_VERSION:
        why = f"the results were made with version {experiment.version}, and this is"
        return [f"It could not be checked that this runs again: {why} {RESULTS_VERSION}."]
    pairs = zip(data["learners"], then["learners"], strict=True)
    other = [one["name"] for one, before in pairs if one != before]
    return [
        "It may not run as it did, because other code is installed now than it was run with "
        f"({', '.join(other) or 'its conditions'})."
    ]


def _put_back(read: LearnerSpec, spec: LearnerSpec) -> LearnerSpec:
    """A learner that was read, with its own code in place of the stand-in's."""
    if ":" in spec.learner:
        parts = {"learner": spec.learner, "parameters": spec.parameters, "recorded": spec.recorded}
        read = replace(read, **parts)  # type: ignore[arg-type]
    return replace(read, reward=spec.reward) if isinstance(spec.reward, OwnReward) else read


def _plain(experiment: Experiment) -> dict[str, Any]:
    """An experiment as plain data, in which a tuple is a list."""
    data: dict[str, Any] = json.loads(json.dumps(experiment.as_dict(), default=str))
    return data


def _packages(experiment: StoredExperiment, versions: Versions) -> dict[str, str | list[str]]:
    """The packages that cells were run with, and those that learners come from."""
    known = dict(versions)
    for spec in experiment.learners:
        package, _, version = spec.origin.package.partition(" ")
        if version and not package.endswith(".py"):
            known.setdefault(package, version)
    return known


def _requirements(packages: Versions) -> str:
    """Requirements with which pip installs the packages that cells were run with."""
    lines = []
    for package, version in packages.items():
        for one in version if isinstance(version, list) else [version]:
            if not _REQUIREMENT.fullmatch(f"{package} {one}"):
                raise StoreError(
                    f"the results say that they were made with {f'{package} {one}'[:80]!r}, which "
                    "is not a version of a package; do not use them, they have been changed"
                )
        if isinstance(version, list):
            lines.append(f"# {package}: cells were run with {', '.join(version)}")
        elif package == "Python" or version == "not installed":
            lines.append(f"# {package} {version}")
        else:
            # What follows a plus sign is the build, which indexes of packages do not have.
            lines.append(f"{package}=={version.partition('+')[0]}")
    return "\n".join(lines) + "\n"


def _readme(
    experiment: StoredExperiment, versions: Versions, again: bool, warnings: list[str]
) -> str:
    """The README of the bundle."""
    text = Path(__file__).with_name("README.md.j2").read_text("utf-8")
    return Template(text, trim_blocks=True, keep_trailing_newline=True).render(
        title=" ".join((experiment.title or experiment.name).split()),
        again=again,
        command=COMMAND,
        python=versions.get("Python", "3"),
        warnings=warnings,
        own_learners=any(":" in spec.learner for spec in experiment.learners),
    )
