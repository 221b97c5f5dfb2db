"""Refusals, a row each: what is asked for, and what the answer must name.

A row of ``tests/refusals/*.txt`` is ``asked ⇒ named | named``. What is asked for is a Python
expression over the names of :mod:`refusals.given`, or, after ``$``, what follows
``causal-openlock`` on a command line. The answer has to be an `OpenLockError`, or of a command the
exit status 2, with a plain sentence that holds each thing named: the key, the place, the nearest
name. Other words are free to change. Lines between ``[file NAME]`` and ``[end]`` are written to a
file of that name for the rows after them.
"""

import shlex
from pathlib import Path

import pytest

from causal_openlock.errors import OpenLockError
from refusals import given
from support.command import at_once

HERE = Path(__file__).parent


def rows():
    """All rows of all tables, each with the files that stand before it in its table."""
    for table in sorted(HERE.glob("*.txt")):
        files = {}
        written = ""  # name of the file that lines go into
        for number, line in enumerate(table.read_text(encoding="utf-8").splitlines(), 1):
            if line == "[end]":
                written = ""
            elif written:
                files[written] += f"{line}\n"
            elif line.startswith("[file "):
                written = line.removeprefix("[file ").removesuffix("]")
                files[written] = ""
            elif line and not line.startswith("#"):
                asked, arrow, named = line.partition(" ⇒ ")
                assert arrow, f"{table.name}:{number} names nothing"
                yield pytest.param(
                    asked.strip(), named.split(" | "), dict(files), id=f"{table.stem}:{number}"
                )


@pytest.mark.parametrize(("asked", "named", "files"), list(rows()))
def test_a_refusal_names_what_is_wrong(asked, named, files, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, text in files.items():
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text(text, encoding="utf-8")
    if asked.startswith("$"):
        answer = refused_command(asked[1:])
    else:
        with pytest.raises(OpenLockError) as caught:
            eval(asked, dict(vars(given)))
        answer = str(caught.value)
    assert "Traceback" not in answer
    assert answer.strip(), "an empty answer"
    for thing in named:
        assert thing in answer, f"{thing!r} is not named in: {answer}"


def refused_command(words):
    """What a command says that ends with status 2."""
    done = at_once(*shlex.split(words))
    assert done.status == 2, done.stdout + done.stderr
    assert "error: " in done.stderr.lower()
    return done.stderr
