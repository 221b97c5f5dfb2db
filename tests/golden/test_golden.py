"""The fixture ``golden``: what is stored is compared, and written only where one asks for it."""

import torch  # noqa: F401 - pytester forgets what a run imports, and torch cannot be imported twice

pytest_plugins = ["pytester"]


def test_a_stored_text_that_differs_fails_with_the_lines_that_differ(pytester, request):
    pytester.makeconftest((request.config.rootpath / "tests" / "conftest.py").read_text())
    pytester.makepyfile("def test_a(golden):\n    golden('a.txt', 'one\\ntwo')\n")
    pytester.runpytest("-p", "no:xdist", "--golden").assert_outcomes(passed=1)
    stored = pytester.path / "golden" / "a.txt"
    assert stored.read_text() == "one\ntwo\n"
    stored.write_text("one\n2\n")
    result = pytester.runpytest()
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["golden/a.txt differs*", "-2", "+two"], consecutive=False)
    assert stored.read_text() == "one\n2\n"
