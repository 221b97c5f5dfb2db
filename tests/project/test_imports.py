"""What is loaded when, and what the tables of packages name; `make imports` does the rest."""

import ast
import re
import subprocess
import sys

import pytest

from support.places import ROOT

HEAVY = {"IPython", "matplotlib", "numba", "pandas", "pgmpy", "pyarrow", "scipy", "torch"}
GUESTS = {
    f"causal_openlock.{name}" for name in ("paper", "fitting", "scoring", "play", "importing")
}
HELP = """
from causal_openlock.cli import main
sys.argv[1:] = ["--help"]
try:
    main()
except SystemExit:
    pass
"""
ROOMS_AND_LEARNERS = """
import gymnasium  # the module before the colon is imported, as in the workers of SubprocVecEnv
gymnasium.make("causal_openlock:causal_openlock/OpenLock-v0").reset(seed=0)
assert not {"pyarrow", "pymunk"} & {*sys.modules}
import causal_openlock as ol, causal_openlock.belief.marginals, causal_openlock.storage.store
import openlock_learners.bayes, openlock_learners.ddqn
ol.compare, ol.room("CC4")
"""


def loaded(program):
    """The modules that a program loads in a process of its own."""
    code = f"import sys\n{program}\nprint('loaded', *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return {*done.stdout.splitlines()[-1].split()}


def test_nothing_is_loaded_before_it_is_needed():
    assert not loaded(HELP) & {*HEAVY, "networkx"}
    assert loaded(ROOMS_AND_LEARNERS) & {*HEAVY, *GUESTS} == {"pyarrow"}  # of the store


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
