"""What the toolkit is installed from: versions, hashes, advisories, and how a release is made."""

from __future__ import annotations

import re
import runpy
import tomllib
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from ruamel.yaml import YAML

from support.places import ROOT

said = runpy.run_path(str(ROOT / ".ci" / "audit.py"))["said"]
DECLARED = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = DECLARED["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")


def pinned(name: str) -> dict[str, str]:
    """The versions in a file, by the name of the package."""
    text = (ROOT / name).read_text(encoding="utf-8")
    found = re.findall(r"^([A-Za-z0-9._-]+)==([^\s;]+)", text, re.MULTILINE)
    return {canonicalize_name(package): version for package, version in found}


def test_the_locked_set_has_hashes_and_the_versions_of_the_constraints() -> None:
    locked = pinned("locked.txt")
    assert pinned("constraints.txt").items() <= locked.items()
    text = (ROOT / "locked.txt").read_text(encoding="utf-8").replace("\\\n", " ")
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert len(lines) == len(locked)
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", line) for line in lines)


def test_every_bound_is_a_lower_one_that_admits_the_locked_version() -> None:
    locked = pinned("constraints.txt")
    extras = PROJECT["optional-dependencies"].values()
    declared = [*PROJECT["dependencies"], *(one for extra in extras for one in extra)]
    for one in map(Requirement, declared):
        assert one.specifier.contains(locked[canonicalize_name(one.name)]), one
        assert {bound.operator for bound in one.specifier} == {">="}, one
    by_name: dict[str, set[str]] = {}
    for one in map(Requirement, declared):
        by_name.setdefault(one.name, set()).add(str(one.specifier))
    assert all(len(bounds) == 1 for bounds in by_name.values()), by_name


def package(name: str, **known: Any) -> dict[str, Any]:
    return {"name": name, "version": "1.0", "vulns": [], **known}


@pytest.mark.parametrize(
    ("packages", "status", "text"),
    [
        ([package("one"), package("two")], 0, "no advisory is known for any of 2 packages"),
        ([{"name": "one", "skip_reason": "not found"}], 3, "nothing was audited, as the advisory"),
        ([package("one"), {"name": "two", "skip_reason": "?"}], 3, "no answer: two"),
        (
            [package("one", vulns=[{"id": "PYSEC-1", "fix_versions": ["1.1"]}])],
            1,
            "one 1.0: PYSEC-1, mended in 1.1",
        ),
    ],
)
def test_an_audit_that_asked_nothing_is_not_called_clean(
    packages: list[dict[str, Any]], status: int, text: str
) -> None:
    sentence, found = said({"dependencies": packages})
    assert found == status
    assert text in sentence


def test_a_wheel_can_be_built_from_the_sdist() -> None:
    built = DECLARED["tool"]["hatch"]["build"]["targets"]
    needed = {*built["wheel"]["packages"], *built["wheel"]["force-include"]}
    assert {one.split("/")[0] for one in needed} <= {*built["sdist"]["only-include"]}
    assert all((ROOT / one).exists() for one in built["sdist"]["only-include"])


def test_the_release_builds_and_checks_with_targets_that_exist() -> None:
    workflow = YAML(typ="safe").load(ROOT / ".github" / "workflows" / "release.yml")
    build, check = workflow["jobs"]["build"], workflow["jobs"]["check"]
    assert workflow["on"]["push"]["tags"] == ["v*"]
    assert workflow["permissions"] == {"contents": "read"}
    assert check["needs"] == "build"
    commands = [step["run"] for job in (build, check) for step in job["steps"] if "run" in step]
    targets = {word for line in commands for word in re.findall(r"^make ([\w-]+)", line)}
    assert {"dist", "check-dist", "audit"} <= targets
    assert all(f"\n{target}:" in MAKEFILE for target in targets)
    (pythons,) = re.findall(r"^PYTHONS := \$\(OLDEST\) (.*)$", MAKEFILE, re.MULTILINE)
    assert check["strategy"]["matrix"]["python"] == ["3.11", *pythons.split()]
    assert PROJECT["requires-python"] == ">=3.11"
