"""Every package uses only what it stands on, as `pyproject.toml` declares."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from support.places import ROOT

LINT = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"]


def test_every_package_uses_only_what_it_stands_on():
    done = subprocess.run(LINT, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_declaration_covers_local_and_type_checking_imports():
    # Both count unless they are left out by name; only what asks a guest is.
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    assert "exclude_type_checking_imports" not in declared


@pytest.mark.parametrize(
    "opened", ["gymnasium.make('causal_openlock/OpenLock-v0').reset(seed=0)", "ol.room('CC4')"]
)
def test_opening_a_room_loads_few_packages(opened):
    code = (
        "import sys; before = {*sys.modules}\n"
        f"import gymnasium, causal_openlock as ol; {opened}\n"
        "tops = {name.partition('.')[0] for name in {*sys.modules} - before}\n"
        "files = {name: getattr(sys.modules.get(name), '__file__', None) for name in tops}\n"
        "ours = {'causal_openlock', *sys.stdlib_module_names}\n"
        "print(*sorted(name for name in tops - ours if files[name] and name[0] != '_'))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    packages = done.stdout.split()
    assert "torch" not in packages
    assert 3 < len(packages) <= 12, packages


@pytest.mark.parametrize(
    "package",
    sorted({*ROOT.glob("causal_openlock/**/__init__.py"), *ROOT.glob("learners/**/__init__.py")}),
    ids=lambda path: str(path.parent.relative_to(ROOT)),
)
def test_the_table_of_a_package_names_modules_that_are_there(package):
    text = ast.get_docstring(ast.parse(package.read_text(encoding="utf-8"))) or ""
    named = set(re.findall(r"^``(\w+)``\s", text, flags=re.MULTILINE))
    there = {path.stem for path in package.parent.iterdir()}
    assert named <= there, sorted(named - there)
