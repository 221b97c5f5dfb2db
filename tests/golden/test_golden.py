"""The fixture ``golden``: what is stored is compared, and written only where one asks for it."""

import pytest
import torch  # noqa: F401 - pytester forgets what a run imports, and torch cannot be imported twice

pytest_plugins = ["pytester"]


@pytest.fixture
def project(pytester: pytest.Pytester, request: pytest.FixtureRequest) -> pytest.Pytester:
    pytester.makeconftest((request.config.rootpath / "tests" / "conftest.py").read_text())
    pytester.makepyfile("def test_a(golden):\n    golden('a.txt', 'one\\ntwo')\n")
    return pytester


def test_a_stored_text_that_differs_fails_with_the_lines_that_differ(project):
    project.runpytest("-p", "no:xdist", "--golden").assert_outcomes(passed=1)
    stored = project.path / "golden" / "a.txt"
    assert stored.read_text() == "one\ntwo\n"
    project.runpytest().assert_outcomes(passed=1)
    stored.write_text("one\n2\n")
    result = project.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["golden/a.txt differs*", "-2", "+two"], consecutive=False)
    assert stored.read_text() == "one\n2\n"


def test_a_text_that_is_stored_for_other_processors_is_skipped_with_the_command(project):
    project.makepyfile("def test_a(golden):\n    golden('a.txt', 'one', processor=True)\n")
    result = project.runpytest("-rs")
    result.assert_outcomes(skipped=1)
    result.stdout.fnmatch_lines(["*git worktree add*"])
    project.runpytest("--golden").assert_outcomes(passed=1)
    (stored,) = (project.path / "golden").iterdir()
    assert stored.name.startswith("a.")
    stored.write_text("two\n")
    project.runpytest().assert_outcomes(failed=1)
