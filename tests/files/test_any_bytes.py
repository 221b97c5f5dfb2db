"""Any bytes are read, or refused in a sentence, by every reader of files.

Good files of each kind are changed at random, half of the time with checksums that fit again, as
somebody could send them on purpose. ``TIMES=100`` before the command tries a hundred times as many.
Networks, checkpoints and studies are damaged in tests of their own.
"""

import csv
import json
import os
import shutil
from functools import partial
from hashlib import sha256
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from causal_openlock.analysis.topics.language_models import _Counts, _letters, _lines
from causal_openlock.cli.folder import status
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.beside_record import read_answers, read_reactions, write_answers
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.making import make_experiment, read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Protocol
from causal_openlock.export.as_csv import write_csv
from causal_openlock.files.checksums import ZEROS
from causal_openlock.fitting.plan import Range, make_plan, read_plan
from causal_openlock.fitting.predicting import read_fit, score_folder
from causal_openlock.fitting.to_actions import FILE as FITS
from causal_openlock.fitting.to_actions import fit_all, groups_of
from causal_openlock.importing.folder import import_files
from causal_openlock.play.people import People
from causal_openlock.running.runner import run
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.graphs import FORMATS, export_schema, read_schema
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.scoring.scores import ACTIONS, FOLDER, Scores
from causal_openlock.storage.store import Store
from openlock_learners.language.replies import FOLDER as REPLIES
from openlock_learners.language.replies import Replies
from openlock_learners.meta.training_file import read_training
from support.fits import with_settings
from support.places import ROOT

pytestmark = pytest.mark.slow

TIMES = int(os.environ.get("TIMES", "1"))
PIECES = [b"", b"\0", b"\xff", b"0", b"-1", b"1e999", b"NaN", b"9" * 400, b"[" * 3000, b"{a: "]
PIECES += [b'"', b"'", b"\n", b"\n  ", b"\t", b": ", b"- ", b"*a", b"&a ", b"!!python/name:os "]
PIECES += [b"null", b"true", b"[]", b"{}", b"\\ud800", b"\xc3\xa9", b"\x1b[2J", b"->", b"--", b"<-"]
PIECES += [b"../../outside/x", b"/dev/null", b"C:\\x", b"a" * 300, b"door", b"CC4", b"digraph {"]


@st.composite
def edits(draw, content):
    """The content with some pieces removed, repeated, or replaced by others."""
    for _ in range(draw(st.integers(1, 2))):
        at = draw(st.integers(0, len(content)))
        end = at + draw(st.sampled_from([0, 0, 1, 2, 8, 40, len(content)]))
        piece = draw(st.one_of(st.sampled_from([*PIECES, content[at:end] * 2]), st.binary()))
        content = content[:at] + piece + content[end:]
    return content


def changed(draw, content, name):
    """Changed content, whose checksums fit."""
    before, key, after = content.rpartition(b'"sha256": "')
    if key:
        blank = draw(edits(before + key + ZEROS + after[len(ZEROS) :]))
        return sha256(blank).hexdigest().encode().join(blank.rsplit(ZEROS, 1))
    return draw(edits(content))


def readers(work):
    """The readers of files, by the place of a good file in the folder of the work."""
    condition, human = find_condition("CC3-CC4"), PROTOCOLS["human"]
    kinds = {name: kind for name, kind in FORMATS.items() if kind.read}
    for part in ("experiments", "schemas"):
        shutil.copytree(ROOT / part, work / part)
    shutil.copytree(ROOT / "docs" / "example_play", work / "played")
    (work / "played" / "log.jsonl").unlink()
    brief = Protocol("brief", 4, stop_when_solved=True, baseline_trials=2)
    made = make_experiment(["CC3"], ["associative"], subjects=2, protocol=brief, seed=5)
    run(made, work / "out", workers=0)
    shutil.copytree(work / "out", work / "playing")
    cell, playing = (next((work / one / "cells").iterdir()) for one in ("out", "playing"))
    playing.unlink()
    playing.with_suffix(".progress").write_text("0.2500 12.5")
    score_folder(work / "out", made.learners).save(work / "out" / FOLDER)
    space = make_plan("associative", {"temperature": Range(0.02, 2.0, log=True)})
    plan = with_settings(space, candidates=2)
    groups = groups_of(recorded_subjects(*Store(work / "out").record()), plan)
    fit_all(groups, plan, work / "fit")
    asked = {"learner": "person", "condition": "CC3", "subject": 0, "visit": 1, "time": 2.5}
    pairs = [asked | {"cause": 0, "effect": effect, "enables": effect == 7} for effect in (3, 7)]
    write_answers(work / "asked" / "structures" / "one.parquet", pairs)
    for name, kind in kinds.items():
        text = export_schema(find_schema("CC4"), name)
        (work / f"schema{kind.suffixes[0]}").write_text(text)

    def people(_):
        return People(work / "people", [condition], human, recruiting=["PID"], clock=lambda: 1e9)

    opened = people(0)
    name = opened.join(recruited={"PID": "person"})
    for turn in range(4):
        opened.take(name, turn, action=turn, reaction=500)
    opened.close()
    write_csv(Store(work / "played"), work / "data.csv")
    with (work / "data.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))[:3]
    names = ("subject", "condition", "trial", "attempt", "layout")
    screens = [
        {"trial_type": "openlock", "rt": 250, "action": action, "moved": moved}
        | {name: row[name] for name in names}
        for row in rows
        for action, moved in zip(row["actions"].split(), row["moved"].split(), strict=True)
    ]
    (work / "data.json").write_text(json.dumps(screens))

    def imported(path):
        shutil.rmtree(work / "imported", ignore_errors=True)
        return import_files([path], work / "imported")

    about = {"finish": "stop", "model": "m", "server": "s", "fingerprint": None, "retries": 0}
    said = {"content": "Push oak."}
    reply = {"message": said, **about, "tokens": [90, 9], "latency": 0.5}
    (work / "replies").mkdir()
    (work / "replies" / "1.jsonl").write_text(json.dumps({"key": "1", "reply": reply}) + "\n")
    counts = {"answers": 4, "tokens": [90, 9], "latency": 0.5, "faults": {"no action": 1}}
    lines = [{"subject": 0, "role": "assistant", **said}, {"subject": 0, **counts}]
    (work / "spoken.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    head = {"scored": "llm", "letters": {"A": 0.75, "B": 0.25}, "missing": 0.125}
    (work / "lettered" / "scores").mkdir(parents=True)
    (work / "lettered/scores/transcripts.jsonl").write_text(json.dumps(head) + "\n")

    def replayed(path):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(REPLIES, str(path.parent))
            return Replies(dict)._kept

    spaces = ROOT / "causal_openlock" / "fitting"
    shutil.copy(next(spaces.glob("*.yaml")), work / "space.yaml")
    record = lambda path, up=1: Store(path.parents[up]).record()  # noqa: E731
    return {
        **{f"schema{kind.suffixes[0]}": read_schema for kind in kinds.values()},
        "schemas/CC3.yaml": read_schema,
        "experiments/default.yaml": read_experiment,
        "experiments/meta_training/rl2.yaml": read_training,
        "space.yaml": read_plan,
        "out/experiment.json": partial(record, up=0),
        f"out/cells/{cell.name}": record,
        f"playing/cells/{playing.stem}.progress": lambda path: status(path.parents[1]),
        f"out/{FOLDER}/{ACTIONS}": lambda path: Scores.read(path.parent),
        f"fit/{FITS}": lambda path: read_fit(path.parent, ["associative"]),
        "asked/structures/one.parquet": lambda path: read_answers(work / "asked"),
        f"played/reactions/{next((work / 'played' / 'reactions').iterdir()).name}": (
            lambda path: read_reactions(work / "played")
        ),
        "people/log.jsonl": lambda path: people(0).close(),
        "people/recruited.csv": lambda path: people(0).close(),
        "data.csv": imported,
        "data.json": imported,
        "replies/1.jsonl": replayed,
        "spoken.jsonl": lambda path: list(_lines(path, _Counts)),
        "lettered/scores/transcripts.jsonl": lambda path: _letters(
            SimpleNamespace(folders=[path.parents[1]])
        ),
    }


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    (folder / "outside").mkdir()
    (folder / "outside" / "mine").write_text("mine")
    return folder / "in" / "here"


@pytest.fixture(scope="module")
def known(work):
    work.mkdir(parents=True)
    return {place: (read, (work / place).read_bytes()) for place, read in readers(work).items()}


def test_the_files_that_are_changed_are_read_as_they_are(known, work):
    for place, (read, _) in known.items():
        read(work / place)


@settings(
    max_examples=300 * TIMES,
    deadline=None,
    derandomize=TIMES == 1,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)
@given(data=st.data())
def test_any_bytes_are_read_or_refused_in_a_sentence(known, work, data):
    place = data.draw(st.sampled_from([*known]))
    read, content = known[place]
    kind = data.draw(st.sampled_from(["changed", "changed", "edited", "any"]))
    if kind == "changed":
        content = changed(data.draw, content, place)
    else:
        content = data.draw(edits(content) if kind == "edited" else st.binary())
    path = work / place
    whole = path.read_bytes()
    path.write_bytes(content)
    said = "read"
    try:
        read(path)
    except OpenLockError as error:
        said = str(error)
    finally:
        path.write_bytes(whole)
    assert 0 < len(said.splitlines()) < 20, said
    assert len(said) < 10_000
    around = [path for path in work.parents[1].glob("*/*") if path != work]
    assert [(path.name, path.read_text()) for path in around] == [("mine", "mine")]
