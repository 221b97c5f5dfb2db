"""What the page on reliability says was measured is what is stored, and its tests exist."""

from __future__ import annotations

import json
import re
from typing import Any

import pytest

from support.places import ROOT

PAGE = ROOT / "docs" / "reliability.md"


def measured(name: str) -> Any:
    return json.loads((ROOT / "benchmarks" / "measured" / name).read_text(encoding="utf-8"))


def rows(heading: str) -> list[list[str]]:
    """The cells of the tables of a section."""
    section = PAGE.read_text(encoding="utf-8").partition(f"## {heading}\n")[2].partition("\n## ")[0]
    lines = re.findall(r"^\| (.+) \|$", section, re.MULTILINE)
    return [[cell.strip() for cell in line.split(" | ")] for line in lines]


def test_the_kills_are_those_that_were_counted() -> None:
    found = measured("soak.json")
    names = ["minutes", "kills", "of all processes", "in the midst of a cell", "comparisons"]
    names += ["cells", "attempts", "summaries that differ"]
    assert rows("Kills")[1] == [f"{found[name]:,.0f}" for name in names]
    assert not found["summaries that differ"]


def test_every_way_to_play_gave_the_same_bytes() -> None:
    found = measured("identity.json")["rows"]
    told = rows("The same bytes anywhere")[1:]
    assert told == [
        [one["way"], str(one["killed"]), str(one["cells"]), f"{one['attempts']:,}",
         f"`{one['sha256'][:16]}…`"]
        for one in found
    ]  # fmt: skip
    assert len({one["sha256"] for one in found}) == 1
    assert [one["killed"] for one in found if one["way"] in ("Dask", "16 shards")] == [1, 2]


def test_every_fault_has_a_test() -> None:
    defined = "\n".join(path.read_text(encoding="utf-8") for path in ROOT.glob("tests/*/test_*.py"))
    faults = [row for row in rows("Faults") if row[0] != "fault"]
    assert len(faults) > 30
    for fault, _, tests in faults:
        names = re.findall(r"`(test_\w+)`", tests)
        files = re.findall(r"`(tests/\w+/test_\w+\.py)`", tests)
        assert names or files, fault
        assert all((ROOT / file).is_file() for file in files), fault
        for name in names:
            if f"def {name}(" not in defined:
                pytest.fail(f"{fault}: there is no {name}")
