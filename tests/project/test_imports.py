"""Every package uses only what it stands on, as `pyproject.toml` declares."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

from support.places import ROOT

LINT = [str(Path(sys.executable).parent / "lint-imports"), "--no-cache"]


def test_every_package_uses_only_what_it_stands_on() -> None:
    done = subprocess.run(LINT, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_declaration_covers_local_and_type_checking_imports() -> None:
    # Both count unless they are left out by name; nothing is.
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]
    assert "exclude_type_checking_imports" not in declared
    assert not any("ignore_imports" in contract for contract in declared["contracts"])
