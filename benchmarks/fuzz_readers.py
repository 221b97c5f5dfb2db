"""Every file that the toolkit reads: real files of each kind, how one is spoiled, and its reader.

A new reader is a line of :func:`readers`, with its share of the inputs.
"""

from __future__ import annotations

import csv
import io
import json
import random
import shutil
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import fuzz_results
import numpy as np
from fuzz_mutations import (
    spoil_archive,
    spoil_bytes,
    spoil_json,
    spoil_log,
    spoil_table,
    spoil_text,
)

from causal_openlock.analysis.topics.language_models import _counts
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.evidence.study import read_study
from causal_openlock.evidence.study_files import read_run, read_units
from causal_openlock.experiment.answers import Answer, read_answers, write_answers
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.reactions import read_reactions
from causal_openlock.experiment.session import Session
from causal_openlock.export.as_csv import write_csv
from causal_openlock.files.checksums import json_bytes, read_json
from causal_openlock.files.state import write_state
from causal_openlock.fitting.actions import FILE as FIT_TO_ACTIONS
from causal_openlock.fitting.actions import Fitted, fit_table, fits_of
from causal_openlock.fitting.candidates import Candidate, Fit, Plan, _keep, _opened
from causal_openlock.fitting.kept import fit_of, keep_fit
from causal_openlock.fitting.search import Range, bundled_search, read_search
from causal_openlock.importing.folder import import_files
from causal_openlock.play.people import People
from causal_openlock.play.recruiting import RECRUITED
from causal_openlock.render.words import Wording
from causal_openlock.running.checkpoint import Checkpoint
from causal_openlock.schemas.finding import bundled_schemas, find_schema
from causal_openlock.schemas.graphs import FORMATS, export_schema, read_schema
from causal_openlock.scoring.scores import ACTIONS, FOLDER
from causal_openlock.storage.store import Store
from openlock_learners.language.kept_replies import Replay
from openlock_learners.language.offered_actions import read_answer, read_structure
from openlock_learners.meta.training import MetaTraining, resume
from openlock_learners.meta.training_file import TrainingFile, read_training
from openlock_learners.networks.network_file import read_network, write_network
from openlock_learners.networks.recurrent_policy import Sizes, make_policy

ROOT = Path(__file__).parents[1]
PLAYED = ROOT / "docs" / "example_play"

Spoil = Callable[[bytes, random.Random], bytes]


class Reader(NamedTuple):
    """A reader of files.

    Attributes:
        name: What it reads.
        share: Of a hundred inputs, so many are for it.
        corpus: Real files of this kind.
        spoil: Changes one.
        place: Where the file has to be, in the folder of the work. What stands beside it there is
            whole, so that no input depends on those before it.
        read: Reads what is there; given the folder of the work.
    """

    name: str
    share: int
    corpus: Sequence[bytes]
    spoil: Spoil
    place: str
    read: Callable[[Path], object]

    def input(self, rng: random.Random) -> bytes:
        """A spoiled file."""
        return self.spoil(rng.choice(self.corpus), rng)


def readers(work: Path) -> list[Reader]:
    """All readers; what their files name, or stand beside, is put into the folder of the work."""
    for part in ("experiments", "schemas"):
        shutil.copytree(ROOT / part, work / part)
    schemas = [one.encode() for one in _texts(ROOT / "schemas", "*.yaml")]
    experiments = [one.encode() for one in _texts(ROOT / "experiments", "*.yaml")]
    trainings = [one.encode() for one in _texts(ROOT / "experiments/meta_training", "*.yaml")]
    studies = [one.encode() for one in _texts(ROOT / "evidence", "*/study.yaml")]
    spaces = [one.encode() for one in _texts(ROOT / "causal_openlock/fitting", "*.yaml")]
    folder = shutil.copytree(PLAYED, work / "played")
    (cell,) = (folder / "cells").iterdir()
    (reaction,) = (folder / "reactions").iterdir()
    (folder / "log.jsonl").unlink()
    shutil.copytree(folder, work / "cells")
    own = _own_csv(work)
    answers = work / "asked" / "structures" / "one.parquet"
    write_answers(answers, [Answer("person", "CC3", 0, 1, (0, 3, 5), frozenset({(0, 7)}), 2.5)], 7)
    study = shutil.copytree(ROOT / "evidence" / "bayes", work / "evidence" / "bayes")
    for name in ("run", "units"):
        shutil.copytree(study, work / "evidence" / name)
    scored = fuzz_results.played(work / "scored")
    for name in ("predicted", "playing"):
        shutil.copytree(work / "scored", work / name)
    playing = work / "playing" / "cells" / scored.name
    playing.unlink()
    # Some studies have their experiment beside them.
    shutil.copy(next((ROOT / "evidence").glob("*/experiment.yaml")), study)
    return [
        _yaml("schema files", 8, schemas, "schema.yaml", read_schema),
        _yaml("experiment files", 8, experiments, "experiments/one.yaml", read_experiment),
        _yaml("study.yaml", 4, studies, "evidence/bayes/study.yaml", _study),
        _yaml("fit spaces", 6, spaces, "space.yaml", read_search),
        _yaml("meta-trainings", 3, trainings, "experiments/training.yaml", read_training),
        *(
            _graph(name, share, FOREIGN.get(name, ()))
            for name, share in
            {"line": 6, "dot": 8, "gml": 7, "dagitty": 6, "node-link": 7}.items()
        ),
        Reader("networks", 5, [_network()], spoil_archive, "net.npz",
               _at("net.npz", read_network)),
        Reader("checkpoints", 4, _checkpoints(work), spoil_archive, "kept/cell.checkpoint",
               _resumed),
        Reader("training states", 1, [_training_state()], spoil_archive, "net.npz.training",
               _training_resumed),
        Reader("experiment.json", 5, [(folder / "experiment.json").read_bytes()], _spoil_sealed,
               "played/experiment.json", lambda work: Store(work / "played").record()),
        Reader("cells", 2, [cell.read_bytes()], spoil_table, f"cells/cells/{cell.name}",
               lambda work: Store(work / "cells").record(small=True)),
        Reader("reaction times", 1, [reaction.read_bytes()], spoil_table,
               f"played/reactions/{reaction.name}", _at("played", read_reactions)),
        Reader("people's answers", 1, [answers.read_bytes()], spoil_table,
               "asked/structures/one.parquet", _at("asked", read_answers)),
        *(
            Reader(f"imported {name}", share, [content], spoil, f"data{suffix}",
                   partial(_imported, f"data{suffix}"))
            for name, share, suffix, content, spoil in (
                ("CSV", 1, ".csv", _table(own), spoil_text),
                ("actions", 2, ".csv", _table(_actions(own)), spoil_text),
                ("jsPsych", 1, ".json", _jspsych(_actions(own)), _spoil_json_text),
            )
        ),
        Reader("logs of people", 2, [_log(work / "people")], spoil_log,
               "people/log.jsonl", _people),
        Reader("names of people", 1, [(work / "people" / RECRUITED).read_bytes()], spoil_log,
               f"people/{RECRUITED}", _people),
        Reader("replies of models", 1, [_replies(work / "replies")], _spoil_lines,
               "replies/one.jsonl", _replayed),
        Reader("transcripts", 1, [_transcript()], _spoil_lines, "spoken.jsonl",
               lambda work: list(_counts(work / "spoken.jsonl"))),
        Reader("fits", 1, [_fit(work)], _spoil_sealed, "fit/fit.json", _fitted),
        Reader("fits to actions", 1, [_fit_to_actions()], _spoil_sealed,
               f"fit/{FIT_TO_ACTIONS}", _fitted_to_actions),
        Reader("run.json", 1, [(study / "run.json").read_bytes()], _spoil_sealed,
               "evidence/run/run.json", _at("evidence/run", _run)),
        Reader("units.parquet", 1, [(study / "units.parquet").read_bytes()], spoil_table,
               "evidence/units/units.parquet", _at("evidence/units", _run)),
        Reader("scores", 2, [fuzz_results.scored(work / "scored")], spoil_table,
               f"scored/{FOLDER}/{ACTIONS}", _at("scored", fuzz_results.read_scores)),
        Reader("cells that are scored", 1, [scored.read_bytes()], spoil_table,
               f"predicted/cells/{scored.name}", _at("predicted", fuzz_results.predict)),
        Reader("fits that predict", 1, [fuzz_results.fitted(work / "scored")], _spoil_sealed,
               f"scored/fit/{FIT_TO_ACTIONS}", _at("scored", fuzz_results.predict_fitted)),
        Reader("progress", 1, [fuzz_results.reported(playing)], spoil_text,
               f"playing/cells/{playing.stem}.progress", _at("playing", fuzz_results.standing)),
    ]  # fmt: skip


def _texts(folder: Path, pattern: str) -> list[str]:
    return [path.read_text(encoding="utf-8") for path in sorted(folder.glob(pattern))]


def _at(place: str, read: Callable[[Path], object]) -> Callable[[Path], object]:
    return lambda work: read(work / place)


def _yaml(
    name: str, share: int, corpus: list[bytes], place: str, read: Callable[[Path], object]
) -> Reader:
    return Reader(name, share, corpus, partial(spoil_text, others=corpus), place, _at(place, read))


def _graph(name: str, share: int, more: Sequence[str]) -> Reader:
    corpus = [export_schema(one, name).encode() for one in bundled_schemas().values()]
    corpus += [one.encode() for one in more]
    place = f"graph{FORMATS[name].suffixes[0]}"
    return _yaml(name, share, corpus, place, read_schema)


FOREIGN = {
    "dot": (
        "strict digraph G { rankdir=LR; node [shape=circle]; a -> {b c} [strength=0.5];"
        ' b:n -> door; subgraph s { c -> "door" } /* x */ }',
    ),
    "dagitty": (
        'dag { bb="0,0,1,1" a [pos="0.1,0.2",exposure] y [outcome] a -> b [beta=0.3] y <- b }',
    ),
    "gml": (
        'graph [ directed 1 comment "x &quot; y" node [ id 0 label "a" graphics [ x 1.0 y -2.5 ] ]'
        ' node [ id 1 label "door" ] edge [ source 0 target 1 strength 0.5 ] ]',
    ),
    "node-link": (
        '{"directed": true, "multigraph": false, "nodes": [{"id": "a"}, {"id": "door"}],'
        ' "links": [{"source": "a", "target": "door", "strength": 0.5}]}',
    ),
    "line": ('safe "A safe": A (0.8) -> B, C\n# note\n2 of (B, C, D) -> door; inert lamp',),
}
"""Graphs as other programs write them."""


# -- files with checksums, and JSON ---------------------------------------------------------------


def _spoil_sealed(content: bytes, rng: random.Random) -> bytes:
    """Change values, and give the file the checksum that it needs; or change its bytes."""
    if rng.random() < 0.2:
        return spoil_bytes(content, rng)
    changed = spoil_json(read_json(content), rng)
    return json_bytes(changed) if isinstance(changed, dict) else json.dumps(changed).encode()


def _spoil_json_text(content: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.2:
        return spoil_text(content, rng)
    return json.dumps(spoil_json(json.loads(content), rng)).encode()


def _study(path: Path) -> object:
    study = read_study(path.parent)
    return study.faults() or study.declared


def _run(folder: Path) -> object:
    study = read_study(folder)
    return read_run(study), read_units(study)


# -- states of networks, cells and trainings ------------------------------------------------------


def _network() -> bytes:
    made = make_policy(Sizes(lever=4, room=4, reader=4), 7, [np.random.default_rng(1)])
    return _written(lambda path: write_network(path, made, 7, {"actions": 10}))


def _written(write: Callable[[Path], object]) -> bytes:
    """What is written to a file."""
    with TemporaryDirectory() as folder:
        write(Path(folder) / "file")
        return (Path(folder) / "file").read_bytes()


MADE_WITH = {"identity": "0", "Python": "3"}


def _session() -> Session:
    return Session(Condition.named("CC3", find_schema), PROTOCOLS["human"], 2, seed=1)


def _checkpoint(work: Path) -> Checkpoint:
    return Checkpoint(work / "kept" / "cell.parquet", MADE_WITH, 0.0)


def _checkpoints(work: Path) -> list[bytes]:
    """A cell's checkpoint, by a learner whose state has values of many kinds."""
    (work / "kept").mkdir()
    session, learner = _session(), create("bayes")
    session.begin(learner)
    for _ in range(8):
        learner.learn(session.step(learner.act(session.view)))
    kept = _checkpoint(work)
    kept.save(session, learner)
    return [kept.path.read_bytes()]


def _resumed(work: Path) -> object:
    session, learner = _session(), create("bayes")
    return _checkpoint(work).resume(session, learner)


TRAINING = {"rooms": {"schemas": {"CC3": 1.0}, "rewards": ["paper"]}, "at_once": 2}


@cache
def _training() -> MetaTraining:
    return MetaTraining(TrainingFile.model_validate(TRAINING))


def _training_state() -> bytes:
    def write(path: Path) -> None:
        with path.open("wb") as file:
            write_state(file, _training().state_dict())

    return _written(write)


def _training_resumed(work: Path) -> object:
    return resume(_training(), work / "net.npz.training")


# -- imported data --------------------------------------------------------------------------------


def _own_csv(work: Path) -> list[dict[str, str]]:
    """The rows of a person's first two trials, as `export` writes them."""
    write_csv(Store(work / "played"), work / "own.csv")
    with (work / "own.csv").open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))[:6]


def _actions(rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """The same, a row for each action."""
    names = ("subject", "condition", "trial", "attempt", "layout")
    return [
        {name: row[name] for name in names} | {"action": action, "moved": moved, "reaction": "0.5"}
        for row in rows
        for action, moved in zip(row["actions"].split(), row["moved"].split(), strict=True)
    ]


def _table(rows: Sequence[Mapping[str, str]]) -> bytes:
    file = io.StringIO(newline="")
    writer = csv.DictWriter(file, rows[0].keys())
    writer.writeheader()
    writer.writerows(rows)
    return file.getvalue().encode()


def _jspsych(actions: Sequence[Mapping[str, str]]) -> bytes:
    screens = [{"trial_type": "openlock", "rt": 250, **row} for row in actions]
    return json.dumps([{"trial_type": "instructions"}, *screens]).encode()


def _imported(name: str, work: Path) -> object:
    with TemporaryDirectory() as folder:
        return import_files([work / name], Path(folder) / "imported")


# -- people ---------------------------------------------------------------------------------------


def _opened_by(folder: Path) -> People:
    conditions = [Condition.named("CC3-CC4", find_schema)]
    return People(folder, conditions, PROTOCOLS["human"], recruiting=["PID"], clock=lambda: 1e9)


def _log(folder: Path) -> bytes:
    """The log of two people who left the practice room, took some turns, and came again."""
    people = _opened_by(folder)
    for number in range(2):
        name = people.join(recruited={"PID": f"person{number}"})
        for turn in range(4):
            people.act(name, turn, turn, 500)
        people.proceed(name, 4)
        for turn in range(5, 12):
            people.act(name, turn, turn % 15, None if turn % 2 else 300)
        people.readmit(f"person{number}")
        people.join(recruited={"PID": f"person{number}"})
    people.close()
    return (folder / "log.jsonl").read_bytes()


def _people(work: Path) -> object:
    people = _opened_by(work / "people")
    people.close()
    return people.number


# -- replies of language models -------------------------------------------------------------------

WORDS = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
CALL = {"id": "1", "function": {"name": "act", "arguments": '{"action": "push elm"}'}}
SAID: tuple[dict[str, Any], ...] = (
    {"content": "I try the first one.\nPush oak."},
    {"content": None, "tool_calls": [CALL]},
    {"content": "", "refusal": "I cannot."},
    {"content": '{"enables": [{"cause": "oak", "effect": "the door"}]}'},
)


def _replies(folder: Path) -> bytes:
    """What is kept of a model's replies: words, a call of a tool, a refusal, a structure."""
    about = {"finish": "stop", "model": "m", "server": "s", "fingerprint": None, "retries": 0}
    kept = Replay(folder)
    for number, message in enumerate(SAID):
        kept.put(str(number), {"message": message, **about, "tokens": [90, 9], "latency": 0.5})
    (path,) = folder.iterdir()
    content = path.read_bytes()
    path.unlink()
    return content


def _transcript() -> bytes:
    """A line of what was said, and the counts of a subject, as a cell keeps them."""
    counts = {"answers": 4, "tokens": [90, 9], "latency": 0.5, "faults": {"no action": 1}}
    counts |= {"unanswered": 1, "unreadable": 0}
    lines = [{"subject": 0, "role": "assistant", "content": "Push oak."}, {"subject": 0, **counts}]
    return b"".join(json.dumps(line).encode() + b"\n" for line in lines)


def _spoil_lines(content: bytes, rng: random.Random) -> bytes:
    """Change values in a line of JSON, or the text."""
    if rng.random() < 0.2:
        return spoil_text(content, rng)
    lines = content.splitlines()
    at = rng.randrange(len(lines))
    lines[at] = json.dumps(spoil_json(json.loads(lines[at]), rng)).encode()
    return b"".join(line + b"\n" for line in lines)


def _replayed(work: Path) -> object:
    """What the learner does with replies: it counts tokens and looks for actions and answers."""
    kept = Replay(work / "replies")
    kept.refresh()
    replies = [reply for number in range(len(SAID)) if (reply := kept.get(str(number)))]
    for reply in replies:
        read_answer(reply["message"], reply["finish"], WORDS)
        read_structure(reply["message"], WORDS, ("P0", "P1", "P2", "door"))
    if len(replies) < len(SAID):
        raise OpenLockError("it would be asked for again")
    return kept.spent


# -- fits -----------------------------------------------------------------------------------------


@cache
def _plan() -> Plan:
    space = bundled_search("bayes")
    assert space
    return Plan(space)


def _fit(work: Path) -> bytes:
    (work / "fit").mkdir()
    chosen = {name: one.low for name, one in _plan().space.searched.items()}
    done = [Candidate(number, chosen, 3.0) for number in range(3)]
    return _written(lambda path: _keep(Fit(_plan(), done, {0: 2.5}), path))


def _fitted(work: Path) -> object:
    return _opened(_plan(), work / "fit" / "fit.json")


SETTINGS = {"lapse": 0.01}
SOFTNESS = {"": {"softness": Range(0.1, 2.0)}}


def _fit_to_actions() -> bytes:
    done = [
        vars(Fitted("all", fold, {"softness": 0.5}, 30.5, 60, 31.0, 60, 0.5, 12, 65.1))
        for fold in (-1, 0, 1)
    ]
    return _written(lambda path: keep_fit(path, SETTINGS, done=done))


def _fitted_to_actions(work: Path) -> object:
    read = partial(fits_of, ranges=SOFTNESS)
    return fit_table(fit_of(work / "fit" / FIT_TO_ACTIONS, SETTINGS, read, "fit", "plans") or [])
