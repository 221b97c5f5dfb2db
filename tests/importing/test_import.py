"""Data in: what comes back is what went out, and what could not have happened is named."""

from __future__ import annotations

import csv
import gzip
import json
import os
import random
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from causal_openlock import Condition, Results, Session, find_schema, read_reactions
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.export.as_csv import write_csv
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes
from causal_openlock.importing.folder import BESIDE, _beside, import_files
from causal_openlock.schemas.finding import bundled
from causal_openlock.scoring.teacher_forcing import score_actions
from causal_openlock.storage.store import Store
from support.command import at_once
from support.made_up_experiments import spec

HUMAN = PROTOCOLS["human"]


@pytest.fixture(scope="module")
def record() -> Any:
    """What two subjects did in a transfer that one of them did not solve."""
    condition = Condition.named("CC3-CE4", find_schema)
    session = Session(condition, HUMAN, [0, 1], seed=4, learner="mixed", experiment="out")
    return session.play(create("win_stay"))


def stored(record: Any, folder: Path) -> Store:
    """A results folder of a record."""
    store = Store(folder)
    conditions = (Condition.named("CC3-CE4", find_schema),)
    one = spec("mixed", subjects=2)
    experiment = Experiment("out", "Out", 4, 2, conditions, (one,))
    store.open(experiment)
    (cell,) = experiment.cells()
    store.write(cell, record)
    store.close()
    return store


@pytest.fixture(scope="module")
def own(record: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("own")
    write_csv(stored(record, folder / "results"), folder / "own.csv")
    return folder / "own.csv"


def actions_of(record: Any) -> pd.DataFrame:
    """A table of actions, in which the people and their rooms have names of their own."""
    table = record.to_pandas()
    first = table["phase"].astype(str) == "train"
    table["trial"] = np.where(first, table["trial"], 6 + table["trial"])
    table = table.explode(["actions", "moved"]).rename(columns={"actions": "action"})
    table["subject"] = "P" + table["subject"].astype(str)
    table["moved"] = table["moved"].astype(int)
    return table[["subject", "condition", "trial", "attempt", "action", "layout", "moved"]]


WITHOUT = ["experiment", "seed", "learner", "wall_time"]


def same(record: Any, folder: Path) -> bool:
    """Whether a folder has this record, but for who it is said to be of."""
    found = Store(folder).record()[0].to_pandas().drop(columns=WITHOUT)
    return found.equals(record.to_pandas().drop(columns=WITHOUT).astype(found.dtypes))


def test_our_own_csv_comes_back_as_it_was(record: Any, own: Path, tmp_path: Path) -> None:
    made = import_files([own], tmp_path / "in")
    assert (made.subjects, made.attempts, made.left_out) == (2, record.num_rows, ())
    back, experiment = Store(tmp_path / "in").record()
    assert back.equals(record)
    assert (experiment.name, experiment.seed) == ("out", 4)
    assert same(record, tmp_path / "in")


def test_a_table_of_actions_in_rooms_that_it_names_is_reported_and_scored(
    record: Any, tmp_path: Path
) -> None:
    table = actions_of(record)
    # In an order of rooms that no seed would draw: the trials of training, the last one first.
    rows = dict(iter(table.groupby(["subject", "trial"])))
    parts = []
    for subject in ("P0", "P1"):
        for trial, old in enumerate([6, 5, 4, 3, 2, 1, 7], start=1):
            parts.append(rows[subject, old].assign(trial=trial))
    table = pd.concat(parts)
    table.to_csv(tmp_path / "data.csv", index=False)
    import_files([tmp_path / "data.csv"], tmp_path / "in", learner="visitor")
    played, experiment = Store(tmp_path / "in").record()
    told = table.drop_duplicates(["subject", "trial"])["layout"].tolist()
    first = played.to_pandas().drop_duplicates(["subject", "phase", "trial"])
    assert first["layout"].tolist() == told
    scored = score_actions(played, experiment, spec("random", learner="random"))
    assert len(scored) == len(table)
    results = Results.read(tmp_path / "in")
    assert results.learners == ("visitor",)
    assert len(results.trials) == 14


def test_what_jspsych_saves_is_read_with_its_times(record: Any, tmp_path: Path) -> None:
    table = actions_of(record)
    files = []
    for subject, rows in table.groupby("subject"):
        screens: list[dict[str, Any]] = [{"trial_type": "html-button-response", "rt": 900}]
        for number, row in enumerate(rows.drop(columns="subject").to_dict("records")):
            times = {"rt": 250 + number, "time_elapsed": 1000 * number, "response": {"x": [1]}}
            screens.append({"trial_type": "openlock", **row, **times})
        files.append(tmp_path / f"{subject}.json")
        files[-1].write_text(json.dumps(screens, indent=random.Random(1).choice([None, 1])))
    import_files(files, tmp_path / "in")
    assert same(record, tmp_path / "in")
    reactions = read_reactions(tmp_path / "in").to_pandas()
    assert len(reactions) == len(table)
    own = reactions[reactions["subject"] == 1]
    assert own["reaction"].tolist() == pytest.approx([0.25 + n / 1000 for n in range(len(own))])
    assert own["time"].tolist() == pytest.approx([float(n) for n in range(len(own))])


def test_a_trial_that_is_not_over_is_left_out_and_said_to_be(record: Any, tmp_path: Path) -> None:
    table = actions_of(record)
    table[:-2].to_csv(tmp_path / "data.csv", index=False)
    ended = at_once("import", f"{tmp_path / 'data.csv'}", "-o", f"{tmp_path / 'in'}")
    assert ended.status == 0
    assert f"data.csv:{len(table) - 1}: the last trial of subject P1 is not over" in ended.stderr
    trials = Results.read(tmp_path / "in").trials
    assert len(trials) == 13


def changed(text: str, line: int, old: str, new: str) -> str:
    lines = text.splitlines()
    assert old in lines[line - 1], lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new, 1)
    return "\n".join(lines)


def refused(content: str, folder: Path, name: str = "data.csv") -> str:
    """The one sentence with which a file is refused; nothing is written for it."""
    (folder / name).write_text(content)
    with pytest.raises(OpenLockError) as caught:
        import_files([folder / name], folder / "in")
    assert [*folder.iterdir()] == [folder / name]
    said = str(caught.value)
    assert "\n" not in said
    return said.replace(f"{folder}/", "")


def test_a_row_that_could_not_have_happened_is_named(record: Any, tmp_path: Path) -> None:
    text = actions_of(record).to_csv(index=False)
    rows = [line.split(",") for line in text.splitlines()]
    lines = text.splitlines()
    lines[2] = f"{lines[2][:-1]}{1 - int(lines[2][-1])}"
    said = refused("\n".join(lines), tmp_path)
    assert said.startswith("data.csv:3: push_")
    assert said.endswith(f"moved = {rows[2][6]}, and this row says {1 - int(rows[2][6])}")
    late = next(n for n, row in enumerate(rows[1:], 2) if row[3] == "2")
    said = refused(changed(text, late, ",2,", ",3,"), tmp_path)
    assert said.startswith(f"data.csv:{late}: this says trial 1, attempt 3, and after the rows")
    without = text.splitlines()
    del without[3]
    assert refused("\n".join(without), tmp_path).startswith("data.csv:4: this says trial 1, att")
    last = text.splitlines()[-1]
    said = refused(f"{text}{last}", tmp_path)
    assert said.startswith(f"data.csv:{len(rows) + 1}: all trials of this subject were over before")
    said = refused(text.replace(f",{rows[1][5]},", ",trial8,"), tmp_path)
    assert "the layout trial8 places 4 levers and CC3 has 3" in said
    one = text.splitlines()[1].split(",")
    one[4] = "push_UPER"
    said = refused("\n".join([text.splitlines()[0], ",".join(one)]), tmp_path)
    assert said.startswith("data.csv:2: there is no action 'push_UPER'; did you mean push_UPPER?")


def test_a_row_after_the_end_of_its_trial_hears_why_the_trial_ended(
    record: Any, tmp_path: Path
) -> None:
    table = actions_of(record)
    own = table[table["subject"] == table["subject"].iloc[0]].reset_index(drop=True)
    last = int(np.flatnonzero(own["trial"] == 1)[-1])
    attempts = int(own["attempt"][last])
    longer = own.copy()
    longer.loc[last + 1, ["trial", "attempt"]] = [1, attempts + 1]
    said = refused(longer.to_csv(index=False), tmp_path)
    assert said.startswith(f"data.csv:{last + 3}: this says trial 1, attempt {attempts + 1}, and")
    because = f"trial 1 ended with attempt {attempts}, because all 2 solutions had been found"
    assert said.endswith(because)
    shorter = own.drop(index=range(last - 2, last + 1))
    said = refused(shorter.to_csv(index=False), tmp_path)
    assert "this says trial 2, attempt 1" in said
    assert said.endswith("solutions left: 1")
    drawn = own.drop(columns="layout")
    (tmp_path / "drawn.csv").write_text(drawn.to_csv(index=False))
    with pytest.raises(OpenLockError, match="the rooms were drawn by --seed 9, and this subject"):
        import_files([tmp_path / "drawn.csv"], tmp_path / "in", seed=9, layouts="drawn")


def test_an_attempt_of_ours_that_came_to_something_else_is_named(own: Path, tmp_path: Path) -> None:
    text = own.read_text()
    frame = pd.read_csv(own)
    solved = int(np.flatnonzero(frame["opened"])[0])
    row = text.splitlines()[solved + 1]
    number = solved + 2
    for old, new, what in [
        (',"open1",', ',"open2",', "category of this attempt is open1, and this row says open2"),
        (f",{frame['reward'][solved]:g},", ",7,", "name the experiment with --from"),
        (',"train",', ',"test",', "this is trial 7 of CC3-CE4, and there is no row of trial 2"),
    ]:
        assert old in row
        said = refused(changed(text, number, old, new), tmp_path)
        assert said.startswith(f"data.csv:{number}: ")
        assert what in said


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("data.csv", "", "there is no column subject; it is empty"),
        (
            "data.csv",
            "subject;condition;trial\na;CC3;1\n",
            "data.csv:1: there is no column attempt; found: subject, condition, trial; rename",
        ),
        ("data.csv", '"subject";"condition"\n"a";"CC3"\n', "found: subject, condition; rename"),
        ("data.csv", "subject\tcondition\na\tCC3\n", "there is no column trial; found: subject"),
        (
            "data.csv",
            "participant,condition,trial,attempt,action\n",
            "there is no column subject; "
            "found: participant, condition, trial, attempt, action; rename the column",
        ),
        ("data.csv", "subject,subject,condition\n", "data.csv:1: the column subject is there"),
        ("data.csv", "subject,condition,trial,attempt,action\n", "there is no trial that is over"),
        ("data.csv", "subject,condition,trial,attempt,action\na,CC3,1\n", "3 cells and 5 columns"),
        ("data.csv", "subject,condition,trial,attempt,action\na,CC3,x,1,0\n", "csv:2: trial must"),
        ("data.csv", "subject,condition,trial,attempt,action\na,,1,1,0\n", "condition is missing"),
        ("data.csv", "subject,condition,trial,attempt,action\na,CX9,1,1,0\n", "csv:2: "),
        ("data.csv", "subject,condition,trial,attempt,action\na,CC3,9,1,0\n", "has 5 trials"),
        (
            "data.csv",
            "subject,condition,trial,attempt,action,learner\na,CC3,1,1,0,../x\n",
            "'../x' is not a label",
        ),
        ("data.csv", 'subject,condition,trial,attempt,action\n"a,CC3', "this is not CSV"),
        ("data.json", "[{", "data.json:1 (entry 1): this is not JSON; is the file whole?"),
        ("data.json", '[\n{"a": 1},\n{"b": 2}', "does not end; is the file whole?"),
        ("data.json", "[1, 2]", "this is not a list of entries"),
        ("data.json", '[{"action": 1, "action": 2}]', "the key 'action' is there twice; take one"),
        ("data.json", '[{"a":1},\n{"action":3}]', "data.json:2 (entry 2): condition is missing"),
        ("data.json", "[" * 5000, "this is not a list"),
    ],
)
def test_what_is_no_data_is_refused_in_a_sentence(
    name: str, content: str, what: str, tmp_path: Path
) -> None:
    assert what in refused(content, tmp_path, name)


def test_spoiled_bytes_are_refused_and_a_folder_is_not_overwritten(
    own: Path, tmp_path: Path
) -> None:
    generator = random.Random(7)
    whole = own.read_bytes()
    for number in range(40):
        spoiled = bytearray(whole[: generator.randrange(len(whole))] if number % 2 else whole)
        for _ in range(8):
            spoiled[generator.randrange(len(spoiled))] = generator.randrange(256)
        path = tmp_path / "spoiled.csv"
        path.write_bytes(spoiled)
        try:
            import_files([path], tmp_path / f"in{number}")
        except OpenLockError:
            assert not (tmp_path / f"in{number}").exists()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("kept")
    with pytest.raises(OpenLockError, match="is there already; choose another folder"):
        import_files([own], tmp_path / "mine")
    with pytest.raises(OpenLockError, match="is a file; choose a folder"):
        import_files([own], tmp_path / "mine" / "notes.txt")
    assert (tmp_path / "mine" / "notes.txt").read_text() == "kept"


HEADER = "subject,condition,trial,attempt,action\n"


def solved(*subjects: str) -> str:
    """A table in which subjects open the door of one room twice."""
    table = HEADER.replace("action", "action,layout")
    for subject in subjects:
        for attempt, first in ((1, "LOWERLEFT"), (2, "UPPERLEFT")):
            for action in (first, "UPPERRIGHT", "door"):
                table += f"{subject},CE3,1,{attempt},push_{action},trial1\n"
    return table


def test_nothing_keeps_what_people_and_their_files_are_called(tmp_path: Path) -> None:
    table = pd.read_csv(csv_of(tmp_path / "5f3a_anna.csv", solved("70012345", "3000000")))
    own = table[table["subject"] == 3000000].drop(columns="subject").to_dict("records")
    (tmp_path / "5f3a_ben.json").write_text(json.dumps(own))
    import_files([tmp_path / "5f3a_anna.csv", tmp_path / "5f3a_ben.json"], tmp_path / "in")
    record, experiment = Store(tmp_path / "in").record()
    assert sorted({*record["subject"].to_pylist()}) == [0, 1, 2]
    assert experiment.name == "in"
    files = [path for path in (tmp_path / "in").rglob("*") if path.is_file()]
    told = b"".join(path.read_bytes() + path.name.encode() for path in files)
    for word in (b"5f3a", b"anna", b"ben", b"70012345", b"3000000"):
        assert word not in told


def csv_of(path: Path, content: str) -> Path:
    path.write_text(content)
    return path


def test_numbers_of_our_own_that_are_far_apart_are_dealt_anew(own: Path, tmp_path: Path) -> None:
    frame = pd.read_csv(own, dtype=str)
    frame["subject"] = frame["subject"].map({"0": "7", "1": "3000000"})
    frame.to_csv(tmp_path / "far.csv", index=False, quoting=csv.QUOTE_NONNUMERIC)
    import_files([tmp_path / "far.csv"], tmp_path / "in")
    assert {*Store(tmp_path / "in").record()[0]["subject"].to_pylist()} == {0, 1}
    frame["subject"] = frame["subject"].replace({"3000000": "9999"})
    frame.to_csv(tmp_path / "near.csv", index=False, quoting=csv.QUOTE_NONNUMERIC)
    import_files([tmp_path / "near.csv"], tmp_path / "near")
    assert {*Store(tmp_path / "near").record()[0]["subject"].to_pylist()} == {7, 9999}


def test_files_of_one_name_are_of_two_people_or_say_whose_they_are(tmp_path: Path) -> None:
    table = pd.read_csv(csv_of(tmp_path / "all.csv", solved("x"))).to_dict("records")
    paths = [tmp_path / folder / "data.json" for folder in "ab"]
    for path, rows in zip(paths, (table[:3], table[3:]), strict=True):
        path.parent.mkdir()
        path.write_text(
            json.dumps([{k: v for k, v in row.items() if k != "subject"} for row in rows])
        )
    with pytest.raises(OpenLockError, match=r"neither this file nor .* says whose it is"):
        import_files(paths, tmp_path / "in")
    for path, rows in zip(paths, (table[:3], table[3:]), strict=True):
        path.write_text(json.dumps(rows))
    assert import_files(paths, tmp_path / "in").subjects == 1


def test_a_cell_that_is_too_long_is_refused_in_a_sentence(tmp_path: Path) -> None:
    for content in (f"{HEADER}{'x' * 140_000},CE3,1,1,0\n", "x" * 140_000):
        assert "this is not CSV (field larger than" in refused(content, tmp_path)


def test_data_opens_no_schema_of_this_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = bundled("schemas") / "CE3.yaml"
    (tmp_path / "mine").mkdir()
    for name in ("mine/x.yaml", "mine/secret.yaml"):
        (tmp_path / name).write_text(made.read_text())
    monkeypatch.chdir(tmp_path / "mine")
    for number, name in enumerate((f"{tmp_path}/mine/x.yaml", "secret", "x.yaml", "CE3-secret")):
        path = csv_of(tmp_path / f"{number}.csv", solved("a").replace("CE3", name))
        with pytest.raises(OpenLockError, match=r"csv:2: .*(there is no schema|name it with)"):
            import_files([path], tmp_path / "in")


def test_the_working_directory_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = csv_of(tmp_path / "data.csv", solved("a"))
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    for out in (".", "../empty", f"{tmp_path}/empty"):
        with pytest.raises(OpenLockError, match="is the folder that you work in; name a new"):
            import_files([path], out)
    import_files([path], "new/in")
    assert Store(tmp_path / "empty" / "new" / "in").files()[0]


KILLED = """
import os, sys
from causal_openlock.storage.store import Store
from causal_openlock.importing.folder import import_files
Store.close = lambda self: os._exit(9)
import_files([sys.argv[1]], sys.argv[2])
"""


def test_what_a_killed_import_has_left_is_removed_by_the_next_one(tmp_path: Path) -> None:
    path = csv_of(tmp_path / "data.csv", solved("a"))
    words = [sys.executable, "-c", KILLED, str(path), str(tmp_path / "in")]
    assert subprocess.run(words, env=os.environ, check=False).returncode == 9
    assert [*tmp_path.glob(f"{BESIDE}*")]
    with _beside(tmp_path / "third") as busy:  # another import is at work
        import_files([path], tmp_path / "other")
        assert [*tmp_path.glob(f"{BESIDE}*")] == [busy]
    assert not [*tmp_path.glob(f"{BESIDE}*")]


def test_without_layouts_nobody_is_placed_in_rooms_by_chance(tmp_path: Path) -> None:
    rows = ["subject,condition,trial,attempt,action"]
    rows += [f"ann,CC3,1,1,{action}" for action in (0, 7, 14)]
    said = refused("\n".join(rows), tmp_path)
    assert said.startswith("data.csv:2: there is no layout, so it is not known where")
    assert "--layouts drawn" in said
    ended = at_once(
        "import", f"{tmp_path / 'data.csv'}", "-o", f"{tmp_path / 'in'}", "--layouts", "drawn"
    )
    assert "is not over" in ended.stderr or ended.status == 0 or "no trial" in ended.stderr


def test_the_same_file_twice_is_refused_by_both_names(record: Any, tmp_path: Path) -> None:
    table = actions_of(record)
    for name in ("data.csv", "data (1).csv"):
        table.to_csv(tmp_path / name, index=False)
    with pytest.raises(OpenLockError, match=r"data\.csv and .*1\)\.csv have the same"):
        import_files([tmp_path / "data.csv", tmp_path / "data (1).csv"], tmp_path / "in")
    assert not (tmp_path / "in").exists()


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".json"])
def test_what_is_too_large_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, suffix: str
) -> None:
    monkeypatch.setattr("causal_openlock.importing.text.MOST_LINES", 1000)
    content = b"subject,condition,trial,attempt,action\n" + b"1,CC3,1,1,0\n" * 2000
    path = tmp_path / f"data{suffix}"
    path.write_bytes(gzip.compress(content) if suffix == ".csv.gz" else content)
    with pytest.raises(OpenLockError, match="more than 128 MB or 1,000 lines; import it in parts"):
        import_files([path], tmp_path / "in")
    monkeypatch.setattr("causal_openlock.importing.text.MOST_BYTES", 1000)
    with pytest.raises(OpenLockError, match="import it in parts"):
        import_files([path], tmp_path / "in")


def test_a_small_file_of_very_many_values_is_refused_before_they_are_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    content = table_bytes(pa.table({"x": pa.array([1] * 5000)}))
    assert read_table(content).num_rows == 5000
    monkeypatch.setattr("causal_openlock.files.checksums.MOST_VALUES", 4999)
    with pytest.raises(ChecksumError, match="it holds 5,000 values, more than 4,999"):
        read_table(content)
    within = table_bytes(pa.table({"x": pa.array([[1] * 5000]), "y": pa.array([2])}))
    with pytest.raises(ChecksumError, match="it holds 5,001 values, more than 4,999"):
        read_table(within)

    # Malformed metadata of a column end the process where they are looked at before it is scanned.
    def malformed(*_: object) -> None:
        raise OSError("histogram size mismatch")

    monkeypatch.setattr("pyarrow.parquet.ParquetFile.scan_contents", malformed)
    with pytest.raises(ChecksumError, match="histogram size mismatch"):
        read_table(within)


def test_screens_without_an_action_are_passed_over_and_hidden_actions_named(
    record: Any, tmp_path: Path
) -> None:
    rows = json.loads(actions_of(record).to_json(orient="records"))
    path = tmp_path / "data.json"
    path.write_text(json.dumps([{"trial_type": "instructions", "action": None}, *rows]))
    assert import_files([path], tmp_path / "in").subjects > 0
    path.write_text(json.dumps([{"response": row} for row in rows]))
    with pytest.raises(OpenLockError, match="the action stands within 'response'"):
        import_files([path], tmp_path / "other")


ROWS = (
    "anna,CE3,1,1,push_LOWERLEFT,trial1,0.51",
    "anna,CE3,1,1,push_UPPERRIGHT,trial1,0.7",
    "anna,CE3,1,1,push_door,trial1,0.2",
    "anna,CE3,1,2,push_UPPERLEFT,trial1,0.3",
    "anna,CE3,1,2,push_UPPERRIGHT,trial1,0.4",
    "anna,CE3,1,2,push_door,trial1,1.1",
)
TIMED = ("subject,condition,trial,attempt,action,layout,reaction", *ROWS)


def seconds_of(folder: Path) -> list[float]:
    return [round(one, 3) for one in read_reactions(folder)["reaction"].to_pylist()]


@pytest.mark.parametrize(
    ("content", "remarks"),
    [
        ("\n".join((*TIMED, ",,,,,,", ",,,,,,", "")), ()),
        ("\n".join(TIMED).replace(",", "\t"), ("separated by tabs",)),
        (
            "\n".join(TIMED).replace(",", ";").replace("0.", "0,").replace("1.1", "1,1"),
            ("separated by semicolons, and 0,5 is read as 0.5",),
        ),
        ("\n \n" + "\n".join(TIMED), ()),
        ('"SEP=|"\r' + "\n".join(TIMED).replace(",", "|"), ("separated by strokes",)),
        ("sep=;\r\n" + "\r\n".join(TIMED).replace(",", ";"), ("separated by semicolons",)),
        (
            TIMED[0].replace(",", ";") + ';"age, years"\n'
            + "\n".join(f"{row.replace(',', ';')};30" for row in ROWS),
            ("separated by semicolons", "passed over: age, years"),
        ),
    ],
    ids=["empty rows", "tabs", "decimal commas", "empty first", "SEP", "sep", "comma in header"],
)  # fmt: skip
def test_what_a_spreadsheet_saves_is_read_and_said(
    content: str, remarks: tuple[str, ...], tmp_path: Path
) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(content.encode("utf-8-sig"))
    made = import_files([path], tmp_path / "in")
    assert made.attempts == 2
    assert seconds_of(tmp_path / "in") == [0.51, 0.7, 0.2, 0.3, 0.4, 1.1]
    assert len(made.remarks) == len(remarks)
    assert all(what in said for what, said in zip(remarks, made.remarks, strict=True))


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("0.51", "1_0", "data.csv:2: reaction must be a number, and this is the text '1_0'"),
        ("0.51", "nan", "reaction must be a number"),
        ("0.51", "\u0661", "reaction must be a number"),
        ("0.51", "-1", "reaction must be a number of at least 0"),
        ("trial1", "Trial1", "data.csv:2: there is no layout 'Trial1' in the record; did you mean"),
        ("push_LOWERLEFT", "push_l0", "'push_l0' names a lever by its role, which rooms deal anew"),
        ("0.51", '"0\n\n1"', "data.csv:2: reaction must be a number"),
        ("anna,CE3,1,1,push_door", '"\n\n",CE3,1,1,push_door', "data.csv:4: subject is missing"),
        ("push_UPPERRIGHT", '"\nx"', "data.csv:3: there is no action"),
        ("reaction", "time", "data.csv:4: time is 0.2, and was 0.7 before; it is seconds since"),
    ],
)
def test_what_is_nearly_right_is_refused_with_what_was_meant(
    old: str, new: str, what: str, tmp_path: Path
) -> None:
    assert what in refused("\n".join(TIMED).replace(old, new), tmp_path)


def screens(
    elapsed: tuple[int, ...] = (1000, 2000, 3000, 4000, 5000, 6000),
) -> list[dict[str, Any]]:
    """What jsPsych says of six screens, with an instruction before them."""
    names = TIMED[0].split(",")
    found: list[dict[str, Any]] = [{"trial_type": "instructions", "rt": 900, "time_elapsed": 900}]
    for row, passed in zip(ROWS, elapsed, strict=True):
        values: dict[str, Any] = dict(zip(names, row.split(","), strict=True))
        values |= {"rt": round(1000 * float(values.pop("reaction"))), "time_elapsed": passed}
        found.append({"trial_type": "html-button-response", **values})
    return found


def test_the_table_of_jspsych_says_what_its_json_says(tmp_path: Path) -> None:
    pd.DataFrame(screens()).to_csv(tmp_path / "data.csv", index=False, quoting=csv.QUOTE_ALL)
    (tmp_path / "data.json").write_text(json.dumps(screens()))
    (tmp_path / "jatos.txt").write_text(json.dumps(screens()) + "\n")
    tables = []
    for name in ("data.csv", "data.json", "jatos.txt"):
        made = import_files([tmp_path / name], tmp_path / name.replace(".", "_"))
        assert (made.attempts, made.remarks) == (2, ())
        assert seconds_of(tmp_path / name.replace(".", "_")) == [0.51, 0.7, 0.2, 0.3, 0.4, 1.1]
        tables.append(Store(tmp_path / name.replace(".", "_")).record()[0].drop(["experiment"]))
    text = (tmp_path / "data.csv").read_text().replace('""', '"null"')
    (tmp_path / "nulls.csv").write_text(text)
    assert import_files([tmp_path / "nulls.csv"], tmp_path / "nulls").attempts == 2
    (tmp_path / "called.CSV").write_text(json.dumps(screens()))
    assert import_files([tmp_path / "called.CSV"], tmp_path / "called").attempts == 2
    (tmp_path / "packed.CSV.GZ").write_bytes(gzip.compress(text.encode()))
    assert import_files([tmp_path / "packed.CSV.GZ"], tmp_path / "packed").attempts == 2
    assert tables[0].equals(tables[1])
    assert tables[1].equals(tables[2])
    alone = pd.DataFrame(screens()).drop(columns="subject")
    alone.to_csv(tmp_path / "anna.csv", index=False, sep=";")
    assert import_files([tmp_path / "anna.csv"], tmp_path / "anna").attempts == 2


def test_time_goes_on_where_a_page_was_loaded_again(tmp_path: Path) -> None:
    path = tmp_path / "data.json"
    path.write_text(json.dumps(screens((1000, 2000, 3000, 500, 900, 1500))))
    import_files([path], tmp_path / "in")
    times = Store(tmp_path / "in").record()[0]["wall_time"].to_pylist()
    assert times == pytest.approx([3.0, 4.5])


@pytest.mark.parametrize(
    "hide",
    [
        lambda row: {"trialdata": row},
        lambda row: {"response": {"answers": [row]}},
        lambda row: {"response": json.dumps(row)},
    ],
)
def test_an_action_that_is_hidden_is_named(hide: Any, tmp_path: Path) -> None:
    hidden = [hide(row) for row in screens()]
    assert "the action stands within '" in refused(json.dumps(hidden), tmp_path, "data.json")
    path = tmp_path / "mixed.json"
    path.write_text(json.dumps([hidden[1], *screens()]))
    assert import_files([path], tmp_path / "mixed").attempts == 2


def test_other_encodings_are_named(tmp_path: Path) -> None:
    path = tmp_path / "data.csv"
    for name in ("UTF-16", "UTF-32"):
        path.write_bytes("\n".join(TIMED).encode(name))
        with pytest.raises(OpenLockError, match=rf"is not UTF-8 \(it is {name}\); save it as"):
            import_files([path], tmp_path / "in")


def test_a_long_header_is_read_in_no_time(tmp_path: Path) -> None:
    wide = ",".join(f"c{number}" for number in range(50_000))
    assert "is the file whole?" in refused(f"{TIMED[0]},{wide}\na,b\n", tmp_path)


def test_losses_have_a_decimal_comma_too(own: Path, tmp_path: Path) -> None:
    rows = [line.split(",") for line in own.read_text().splitlines()]
    path = tmp_path / "own.csv"
    table = pd.read_csv(own, dtype=str)
    table["reward"] = table["reward"].str.replace(".", ",")
    table.to_csv(path, sep=";", index=False)
    assert import_files([path], tmp_path / "in").attempts == len(rows) - 1


def test_what_an_experiment_runs_is_said_before_it_is_read(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def paid(step, cost):\n    return step.reward * 0\n")
    (tmp_path / "data.csv").write_text("\n".join(TIMED))
    (tmp_path / "own.yaml").write_text(
        "name: own\ntitle: Own\nconditions: [CE3]\n"
        "learners: [{learner: random, reward: mine:paid, subjects: 1}]\n"
    )
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "causal_openlock",
            *["import", "data.csv", "-o", "in", "--from", "own.yaml"],
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert "mine" in done.stdout.partition("in written")[0]
