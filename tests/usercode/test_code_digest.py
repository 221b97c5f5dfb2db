"""What counts as the code of a learner or a reward, and when it has changed."""

import importlib
import sys

import pytest

from causal_openlock.files.checksums import digest
from causal_openlock.usercode.own_files import code_digest
from support.command import modules_of


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder that modules are imported from, and around it one for others."""
    here = tmp_path / "here"
    here.mkdir()
    monkeypatch.chdir(here)
    monkeypatch.setattr(sys, "path", [*sys.path, str(here)])
    with modules_of(tmp_path):
        yield here


def write(folder, files):
    for inside, text in files.items():
        (folder / inside).parent.mkdir(parents=True, exist_ok=True)
        (folder / inside).write_text(text)


def of(module):
    return code_digest([module])


@pytest.mark.parametrize(
    ("module", "files"),
    [
        ("a_mine", {"a_mine.py": "import a_other", "a_other.py": ""}),
        ("a_mine", {"a_mine.py": "import a_next", "a_next.py": "import a_other", "a_other.py": ""}),
        ("a_mine", {"a_mine.py": "def f():\n    import a_other", "a_other.py": ""}),
        (
            "a_pkg.deep.mine",
            {"a_pkg/deep/mine.py": "from .. import other", "a_pkg/other.py": ""},
        ),
        ("a_pkg.mine", {"a_pkg/mine.py": "x = 1", "a_pkg/__init__.py": "other = 1"}),
        ("a_mine", {"a_mine.py": "import a_pkg", "a_pkg/__init__.py": "from . import other",
                    "a_pkg/other.py": ""}),
        ("a_mine", {"a_mine.py": "import a_far_other", "../away/a_far_other.py": ""}),
        ("a_mine", {"a_mine.py": "import learners_of_mine", "learners_of_mine.py": "other = 1"}),
    ],
    ids=lambda value: ", ".join(value) if isinstance(value, dict) else value,
)  # fmt: skip
def test_a_module_of_the_user_that_is_imported_counts(folder, module, files):
    write(folder, {name: text or "other = 0" for name, text in files.items()})
    sys.path.append(str(folder.parent / "away"))
    before = of(module)
    assert of(module) == before
    other = next(name for name, text in files.items() if not text or text == "other = 1")
    write(folder, {other: "other = 2"})
    assert of(module) != before


def test_what_is_not_imported_or_not_the_users_does_not_count(folder):
    text = "import json, numpy, ruamel.yaml, openlock_learners.random\n"
    text += "from causal_openlock import Learner\n"
    write(folder, {"a_mine.py": text, "a_stranger.py": "", "ruamel/notes.py": "x = 1"})
    assert of("a_mine") == digest(text)  # as it was before modules that are imported counted
    for place in ("libs/a_lib/__init__.py", "site-packages/a_lib/__init__.py"):
        write(folder, {"a_mine.py": "import a_lib", place: "x = 1"})
        (folder / "libs" / "a_lib-1.0.dist-info").mkdir(parents=True, exist_ok=True)
        sys.path.append(str((folder / place).parents[1]))
        assert of("a_mine") == digest("import a_lib")
        sys.path.pop()


def test_what_a_process_imported_is_known_until_it_is_imported_anew(folder):
    write(folder, {"a_mine.py": "import a_other", "a_other.py": "x = 1"})
    module = importlib.import_module("a_mine")
    first = code_digest(["a_mine"], imported=True)
    assert first == of("a_mine")
    write(folder, {"a_other.py": "x = 1 + 1"})
    assert of("a_mine") != first
    assert code_digest(["a_mine"], imported=True) == first
    importlib.reload(module.a_other)
    assert code_digest(["a_mine"], imported=True) == of("a_mine") != first
