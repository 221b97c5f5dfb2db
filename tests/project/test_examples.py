"""The examples in docstrings, run as they stand."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

from support import played_results
from support.places import ROOT

pytestmark = pytest.mark.slow


def module_name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = sorted(
    module_name(path)
    for path in (ROOT / "causal_openlock").rglob("*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_come_out_as_shown(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shared = {}
    if any(
        part in name for part in (".analysis.", ".paper.", ".plotting")
    ):  # their examples are of results that are there
        for made in (played_results.results, played_results.trained, played_results.believed):
            shared[made.__name__] = made()
    failed, tried = doctest.testmod(importlib.import_module(name), extraglobs=shared)
    plt.close("all")
    assert (failed, tried > 0) == (0, True), capsys.readouterr().out
