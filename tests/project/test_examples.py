"""The examples in docstrings, run as they stand."""

import doctest
import importlib

import matplotlib.pyplot as plt
import pytest

from support import played_results
from support.places import ROOT

pytestmark = pytest.mark.slow

MODULES = sorted(
    ".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__")
    for root in (ROOT, ROOT / "learners")
    for path in root.glob("*open*lock*/**/*.py")
    if ">>> " in path.read_text(encoding="utf-8")
)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_come_out_as_shown(name, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shared = {}
    if any(part in name for part in (".analysis.", ".paper.", ".plotting")):
        # Their examples are of results that are there.
        for made in (played_results.results, played_results.trained, played_results.believed):
            shared[made.__name__] = made()
    failed, tried = doctest.testmod(importlib.import_module(name), extraglobs=shared)
    plt.close("all")
    assert (failed, tried > 0) == (0, True), capsys.readouterr().out
