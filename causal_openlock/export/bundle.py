"""A results folder as one file for others, which runs the experiment again.

A bundle is a ZIP file with one folder in it::

    NAME/
      README.md              what the data are, and the one command that runs the experiment again
      experiment.yaml        the experiment, every default written out
      schemas/               the schemas that it plays
      my_learner.py, ...     learners that come with no package, and modules that these import
      files/                 files that learners' parameters name
      requirements.txt       versions of the packages that it was run with
      results/               of the results folder, what anybody may have: the record, cell by cell,
                             transcripts of what was said, what people agreed to, and the report

Equal results give equal bundles, byte for byte. The folder may be of other people, and what it says
of itself forged: so nothing that it names is run, and nothing from outside of it gets in. Paths in
the bundle lead nowhere else, whatever things are called.
"""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
from jinja2 import Template

from causal_openlock.errors import StoreError
from causal_openlock.experiment.beside_record import answers_schema, reactions_schema
from causal_openlock.experiment.declare import AGENT, PERSON
from causal_openlock.experiment.record import played, record_schema
from causal_openlock.files.atomic import replacing
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.storage.own_code import stored_code, stored_files
from causal_openlock.storage.store import Store, StoredExperiment
from causal_openlock.usercode.session_code import is_of_session
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import counted
from causal_openlock.world.rewards import OwnReward

Contents = dict[str, bytes]
"""Files by their paths in a bundle."""

TABLES = {"cells": record_schema, "reactions": reactions_schema, "structures": answers_schema}
"""Folders of a results folder with a table for each cell, and what their columns are."""

_THEN = (1980, 1, 1, 0, 0, 0)  # the date of every file in a bundle
_RESERVED = re.compile(r"(CON|PRN|AUX|NUL|COM\d|LPT\d)(\.|$)", re.IGNORECASE)  # by Windows
_REQUIREMENT = re.compile(r"[A-Za-z0-9][\w.-]*( [\w.+!-]+| not installed)", re.ASCII)


def write_bundle(store: Store, path: Path | str, licence: str = "") -> list[str]:
    """Bundle a results folder; a report that is missing or older than the record is written anew.

    Args:
        store: The results folder.
        path: The ZIP file to write.
        licence: Under what the data may be used; an SPDX identifier or an address.

    Returns:
        Reasons why it may not run again as it did, a sentence each.

    Raises:
        StoreError: If the folder holds no results, not all of them, or code that is not what was
            run.
        OpenLockError: If the bundle cannot be written.
    """
    from causal_openlock.comparison.results import open_results

    experiment = store.experiment()
    cells, missing = store.files()
    if missing:
        raise StoreError(
            f"{store.folder} is unfinished, {counted(len(missing), 'cell')} missing; run compare "
            "again to complete it, then bundle it"
        )
    if unwritten := store.unwritten():
        raise StoreError(unwritten)
    record, experiment = store.record()  # all columns, so that no damage is packed
    if not _has_report(store):
        open_results(store.folder).report()
    again = any(spec.learner not in (PERSON, AGENT) for spec in experiment.learners)
    contents, warnings = _experiment(experiment, store) if again else ({}, [])
    contents["requirements.txt"] = _requirements(experiment).encode()
    results = [store.folder / name for name in ("experiment.json", "report.html", "summary.csv")]
    results += [store.folder / table / cell.name for table in TABLES for cell in cells]
    results += [*map(store.transcript, cells), *sorted(store.folder.glob("consent_*.md"))]
    for result in filter(Path.is_file, results):
        contents[f"results/{result.relative_to(store.folder).as_posix()}"] = result.read_bytes()
    contents["README.md"] = _readme(experiment, record, contents, warnings, licence).encode()
    with replacing(path) as file, zipfile.ZipFile(file, "w") as bundle:
        for inside, content in sorted(contents.items()):
            about = zipfile.ZipInfo(f"{_part(experiment.name)}/{_inside(inside)}", _THEN)
            about.external_attr = 0o644 << 16
            small = inside.endswith(".parquet")  # it is compressed already
            about.compress_type = zipfile.ZIP_STORED if small else zipfile.ZIP_DEFLATED
            bundle.writestr(about, content)
    return warnings


def _has_report(store: Store) -> bool:
    """Whether a results folder has the report of its record as it is now."""
    page = store.folder / "report.html"
    text = page.read_text("utf-8", errors="replace") if page.is_file() else ""
    return f'<meta name="record" content="{store.digest()}">' in text


def _inside(path: str) -> str:
    """A path that stays inside of a bundle, on any system."""
    return "/".join(map(_part, path.split("/")))


def _part(name: str) -> str:
    """A name as a part of a path."""
    plain = re.sub(r"[^\w.+ -]", "_", name)[:200].strip(" .")
    return f"_{plain}" if not plain or _RESERVED.match(plain) else plain


def _experiment(experiment: StoredExperiment, store: Store) -> tuple[Contents, list[str]]:
    """The experiment file and all that it names, and why it may not run as it did."""
    contents: Contents = {}
    learners, warnings = [], []
    for condition in experiment.conditions:
        for schema in condition.schemas:
            contents[f"schemas/{schema.name}.yaml"] = schema.to_yaml().encode()
    for spec in experiment.learners:
        learner, files = stored_code(spec.learner, spec.origin.package, store.folder)
        named = {spec.name: (spec.learner, files)}
        reward = spec.reward
        if isinstance(reward, OwnReward):
            function, more = stored_code(reward.name, reward.source, store.folder)
            named[f"the reward of {spec.name}"] = reward.name, more
            reward = replace(reward, name=function)
        for label, (name, code) in named.items():
            contents |= {inside: path.read_bytes() for inside, path in code.items()}
            if ":" in name and not code:
                warnings.append(f"{label}: the results folder lacks {name}; add its source.")
            elif is_of_session(name):
                warnings.append(
                    f"{label} was defined in a notebook; its source is bundled as a module, and "
                    "counts as another; what only a program could make is a comment in it."
                )
        parameters = {}
        for parameter, path in stored_files(spec.name, store.folder).items():
            parameters[parameter] = _inside(path.relative_to(store.folder).as_posix())
            contents[parameters[parameter]] = path.read_bytes()
        given = {**spec.parameters, **parameters}
        learners.append(replace(spec, learner=learner, reward=reward, parameters=given))
    declared = replace(experiment, learners=tuple(learners)).as_file()
    contents["experiment.yaml"] = dump_yaml(declared).encode()
    if experiment.version != RESULTS_VERSION:
        warnings.append(
            f"It may not run as it did: the results were made with version {experiment.version}, "
            f"and experiment.yaml is written for {RESULTS_VERSION}."
        )
    return contents, warnings


def _requirements(experiment: StoredExperiment) -> str:
    """Requirements with which pip installs the packages that cells were run with."""
    packages: dict[str, str | list[str]] = dict(experiment.versions)
    for spec in experiment.learners:
        package, _, known = spec.origin.package.partition(" ")
        if known and not package.endswith(".py"):
            packages.setdefault(package, known)
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
    experiment: StoredExperiment,
    record: pa.Table,
    contents: Contents,
    warnings: list[str],
    licence: str,
) -> str:
    """The README of the bundle, which is also the data card."""
    size = {"subjects": ("subject", "nunique"), "attempts": ("subject", "size")}
    who = played(record).select(["learner", "condition", "subject"]).to_pandas()
    who = who.groupby(["learner", "condition"], observed=True, sort=False).agg(**size)
    text = Path(__file__).with_name("README.md.j2").read_text("utf-8")
    return Template(text, trim_blocks=True, keep_trailing_newline=True).render(
        title=" ".join((experiment.title or experiment.name).split()),
        experiment=experiment,
        again="experiment.yaml" in contents,
        warnings=warnings,
        own_code=any(":" in spec.learner for spec in experiment.learners),
        people=any(spec.learner == PERSON for spec in experiment.learners),
        played=who.reset_index().to_dict("records"),
        tables={
            table: [(column.name, column.metadata[b"meaning"].decode()) for column in columns()]
            for table, columns in TABLES.items()
            if any(path.startswith(f"results/{table}/") for path in contents)
        },
        consents=[path for path in sorted(contents) if path.startswith("results/consent_")],
        licence=licence,
    )
