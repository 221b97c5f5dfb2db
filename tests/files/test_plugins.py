"""What other packages add: commands, topics of a report."""

import sys

import pytest

from causal_openlock.analysis.topic import all_topics
from causal_openlock.cli import add_registered
from causal_openlock.errors import OpenLockError
from causal_openlock.files.plugins import COMMANDS, LEARNERS, registered
from support.packages import register


@pytest.fixture
def guests(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("a_guest", None)


def test_a_command_of_another_package_is_found_and_one_that_breaks_harms_none(guests, capsys):
    from typer import Typer
    from typer.testing import CliRunner

    (guests / "a_guest.py").write_text("def greet(name: str) -> None:\n    print('hello', name)\n")
    register(guests, "guest", COMMANDS, greet="a_guest:greet", breaks="no_such_guest:command")
    app = Typer()
    app.callback()(lambda: None)
    add_registered(app)
    assert "the command breaks cannot be loaded: " in capsys.readouterr().err
    runner = CliRunner()
    assert runner.invoke(app, ["greet", "you"]).stdout == "hello you\n"
    assert runner.invoke(app, ["score", "--help"]).exit_code == 0


def test_a_name_that_two_packages_register_is_an_error(guests):
    register(guests, "one", COMMANDS, twin="one:a")
    register(guests, "two", COMMANDS, twin="two:b")
    with pytest.raises(OpenLockError, match=r"the command 'twin', .* is registered twice"):
        registered(COMMANDS)
    assert "random" in registered(LEARNERS)


@pytest.mark.parametrize("entries", ["", "[causal_openlock.learners]\nrandom = gone:Learner\n"])
def test_leftovers_of_other_versions_hide_no_learner_and_are_named(guests, entries):
    before = dict(registered(LEARNERS))
    info = guests / "causal_openlock-0.1.0.dist-info"
    info.mkdir()
    if entries:
        (info / "METADATA").write_text(
            "Metadata-Version: 2.1\nName: causal-openlock\nVersion: 0.1.0\n"
        )
        (info / "entry_points.txt").write_text(entries)
    sys.path.insert(0, f"{guests}/")  # which nobody has looked at
    try:
        with pytest.warns(
            UserWarning, match=f"{guests}.* is left over from another version; remove"
        ):
            assert registered(LEARNERS) == before
    finally:
        sys.path.pop(0)


def test_what_cannot_be_loaded_is_named_with_its_package(guests):
    register(guests, "broken", "causal_openlock.topics", pay="no_such_guest:TOPIC")
    with pytest.raises(
        OpenLockError, match=r"the topic 'pay', no_such_guest:TOPIC by broken, cann"
    ):
        all_topics()
