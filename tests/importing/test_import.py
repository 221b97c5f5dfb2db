"""Data in: what comes back is what went out, and what could not have happened is named."""

import csv
import gzip
import json

import numpy as np
import pandas as pd
import pytest

from causal_openlock import Results, Session, read_reactions
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.export.as_csv import write_csv
from causal_openlock.importing.folder import import_files
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.made_up_experiments import spec
from support.scores import score_actions


@pytest.fixture(scope="module")
def record():
    """What two subjects did in a transfer that one of them did not solve."""
    condition = find_condition("CC3-CE4")
    human = PROTOCOLS["human"]
    session = Session(condition, human, [0, 1], seed=4, learner="mixed", experiment="out")
    return session.play(create("win_stay"))


@pytest.fixture(scope="module")
def exported(record, tmp_path_factory):
    """The CSV that ``export`` writes of the record."""
    folder = tmp_path_factory.mktemp("exported")
    store = Store(folder / "results")
    conditions = (find_condition("CC3-CE4"),)
    experiment = Experiment(
        name="out",
        seed=4,
        cell_size=2,
        conditions=conditions,
        learners=(spec("mixed", subjects=2),),
    )
    store.open(experiment)
    (cell,) = experiment.cells()
    store.write(cell, record)
    store.close()
    for name in ("exported.csv", "exported.csv.gz"):
        assert write_csv(store, folder / name) == record.num_rows
    return folder / "exported.csv"


@pytest.fixture
def actions(record):
    """A table of actions, in which the people and their rooms have names of their own."""
    table = record.to_pandas()
    first = table["phase"].astype(str) == "train"
    table["trial"] = np.where(first, table["trial"], 6 + table["trial"])
    table = table.explode(["actions", "moved"]).rename(columns={"actions": "action"})
    table["subject"] = "P" + table["subject"].astype(str)
    table["moved"] = table["moved"].astype(int)
    return table[["subject", "condition", "trial", "attempt", "action", "layout", "moved"]]


def same(record, folder):
    """Whether a folder has this record, but for who it is said to be of."""
    without = ["experiment", "seed", "learner", "wall_time"]
    stored = Store(folder).record()[0].to_pandas().drop(columns=without)
    return stored.equals(record.to_pandas().drop(columns=without).astype(stored.dtypes))


def test_a_csv_has_every_attempt_and_every_column(record, exported):
    packed = exported.with_name("exported.csv.gz").read_bytes()
    assert gzip.decompress(packed) == exported.read_bytes()
    read = pd.read_csv(exported)
    assert list(read.columns) == record.column_names
    for name in ("learner", "condition", "layout", "category", "subject", "attempt", "solution"):
        assert read[name].tolist() == record[name].to_pylist()
    assert read["reward"].to_numpy() == pytest.approx(record["reward"].to_numpy())
    assert read["opened"].astype(bool).tolist() == record["opened"].to_pylist()
    for name, kind in (("actions", int), ("moved", "1".__eq__)):
        told = [[kind(part) for part in cell.split()] for cell in read[name]]
        assert told == record[name].to_pylist()


def test_an_exported_csv_comes_back_as_it_was(record, exported, tmp_path):
    made = import_files([exported], tmp_path / "in")
    assert (made.subjects, made.attempts, made.warnings) == (2, record.num_rows, ())
    back, experiment = Store(tmp_path / "in").record()
    assert back.equals(record)
    assert (experiment.name, experiment.seed) == ("out", 4)
    assert same(record, tmp_path / "in")
    table = pd.read_csv(exported, dtype=str)
    table["reward"] = table["reward"].str.replace(".", ",")
    table.to_csv(tmp_path / "decimal_commas.csv", sep=";", index=False)
    again = import_files([tmp_path / "decimal_commas.csv"], tmp_path / "commas")
    assert again.attempts == made.attempts


def test_actions_in_rooms_that_the_file_names_are_reported_and_scored(actions, tmp_path):
    # In an order of rooms that no seed would draw: the trials of training, the last one first.
    rows = dict(iter(actions.groupby(["subject", "trial"])))
    table = pd.concat(
        rows[subject, old].assign(trial=trial)
        for subject in ("P0", "P1")
        for trial, old in enumerate([6, 5, 4, 3, 2, 1, 7], start=1)
    )
    table.to_csv(tmp_path / "data.csv", index=False)
    import_files([tmp_path / "data.csv"], tmp_path / "in", learner="visitor")
    played, experiment = Store(tmp_path / "in").record()
    first = played.to_pandas().drop_duplicates(["subject", "phase", "trial"])
    layouts = table.drop_duplicates(["subject", "trial"])["layout"].tolist()
    assert first["layout"].tolist() == layouts
    scored = score_actions(played, experiment, spec("random", learner="random"))
    assert len(scored) == len(table)
    results = Results.read(tmp_path / "in")
    assert results.learners == ("visitor",)
    assert len(results.trials) == 14


def test_files_of_jspsych_are_read_with_their_times(record, actions, tmp_path):
    files = []
    for subject, rows in actions.groupby("subject"):
        screens = [{"trial_type": "html-button-response", "rt": 900, "action": None}]
        for number, row in enumerate(rows.drop(columns="subject").to_dict("records")):
            times = {"rt": 250 + number, "time_elapsed": 1000 * number, "response": {"x": [1]}}
            screens.append({"trial_type": "openlock", **row, **times})
        files.append(tmp_path / f"{subject}.json")
        files[-1].write_text(json.dumps(screens))
    import_files(files, tmp_path / "in")
    assert same(record, tmp_path / "in")
    reactions = read_reactions(tmp_path / "in").to_pandas()
    assert len(reactions) == len(actions)
    own = reactions[reactions["subject"] == 1]
    assert own["reaction"].tolist() == pytest.approx([0.25 + n / 1000 for n in range(len(own))])
    assert own["time"].tolist() == pytest.approx([float(n) for n in range(len(own))])


def test_a_trial_that_is_not_over_is_left_out_and_named(actions, tmp_path):
    actions[:-2].to_csv(tmp_path / "data.csv", index=False)
    ended = at_once("import", tmp_path / "data.csv", "-o", tmp_path / "in")
    assert ended.status == 0
    assert f"data.csv:{len(actions) - 1}: the last trial of subject P1" in ended.stderr
    assert len(Results.read(tmp_path / "in").trials) == 13


def refused(table, folder):
    """The refusal of a table, without the folder's name; nothing is written for it."""
    text = table if isinstance(table, str) else table.to_csv(index=False)
    (folder / "data.csv").write_text(text)
    with pytest.raises(OpenLockError) as caught:
        import_files([folder / "data.csv"], folder / "in")
    assert [*folder.iterdir()] == [folder / "data.csv"]
    return str(caught.value).replace(f"{folder}/", "")


def test_a_row_that_could_not_have_happened_is_named(actions, tmp_path):
    actions = actions.reset_index(drop=True)
    wrong = actions.copy()
    wrong.loc[1, "moved"] = 1 - wrong.loc[1, "moved"]
    answer = refused(wrong, tmp_path)
    assert answer.startswith("data.csv:3: ")
    assert f"moved = {actions.loc[1, 'moved']}" in answer
    later = int(np.flatnonzero(actions["attempt"] == 2)[0])
    wrong = actions.copy()
    wrong.loc[later, "attempt"] = 3
    assert refused(wrong, tmp_path).startswith(
        f"data.csv:{later + 2}: this says trial 1, attempt 3"
    )
    answer = refused(actions.drop(index=2), tmp_path)
    assert answer.startswith("data.csv:4: this says trial 1, attempt 2")
    assert answer.endswith("actions left: 1 and solutions left: 2")
    answer = refused(pd.concat([actions, actions[-1:]]), tmp_path)
    assert answer.startswith(f"data.csv:{len(actions) + 2}: all trials of this subject were over")


ROWS = (
    "anna,CE3,1,1,push_LOWERLEFT,trial1,0.51",
    "anna,CE3,1,1,push_UPPERRIGHT,trial1,0.7",
    "anna,CE3,1,1,push_door,trial1,0.2",
    "anna,CE3,1,2,push_UPPERLEFT,trial1,0.3",
    "anna,CE3,1,2,push_UPPERRIGHT,trial1,0.4",
    "anna,CE3,1,2,push_door,trial1,1.1",
)
COLUMNS = "subject,condition,trial,attempt,action,layout,reaction"
TIMED = "\n".join((COLUMNS, *ROWS))
SECONDS = [0.51, 0.7, 0.2, 0.3, 0.4, 1.1]


def seconds_of(folder):
    return [round(one, 3) for one in read_reactions(folder)["reaction"].to_pylist()]


def test_names_of_people_and_of_their_files_are_not_stored(tmp_path):
    table = pd.read_csv(tmp_path / written(tmp_path, TIMED))
    two = pd.concat([table.assign(subject=70012345), table.assign(subject=3000000)])
    two.to_csv(tmp_path / "5f3a_anna.csv", index=False)
    own = table.drop(columns="subject").to_dict("records")
    (tmp_path / "5f3a_ben.json").write_text(json.dumps(own))
    import_files([tmp_path / "5f3a_anna.csv", tmp_path / "5f3a_ben.json"], tmp_path / "in")
    record, experiment = Store(tmp_path / "in").record()
    assert sorted({*record["subject"].to_pylist()}) == [0, 1, 2]
    assert experiment.name == "in"
    files = [path for path in (tmp_path / "in").rglob("*") if path.is_file()]
    stored = b"".join(path.read_bytes() + path.name.encode() for path in files)
    for name in (b"5f3a", b"anna", b"ben", b"70012345", b"3000000"):
        assert name not in stored


def written(folder, text, name="data.csv"):
    (folder / name).write_bytes(text.encode())
    return name


def test_exported_numbers_of_subjects_are_kept_unless_they_are_far_apart(exported, tmp_path):
    table = pd.read_csv(exported, dtype=str)
    for name, second, numbers in (("far", "3000000", {0, 1}), ("near", "9999", {7, 9999})):
        own = table.assign(subject=table["subject"].map({"0": "7", "1": second}))
        own.to_csv(tmp_path / f"{name}.csv", index=False, quoting=csv.QUOTE_NONNUMERIC)
        import_files([tmp_path / f"{name}.csv"], tmp_path / name)
        assert {*Store(tmp_path / name).record()[0]["subject"].to_pylist()} == numbers


def test_files_of_one_name_are_of_one_person_if_they_say_so(tmp_path):
    rows = pd.read_csv(tmp_path / written(tmp_path, TIMED)).to_dict("records")
    for folder, own in (("a", rows[:3]), ("b", rows[3:])):
        (tmp_path / folder).mkdir()
        timed = [{**row, "time": second} for second, row in enumerate(own)]  # from 0 in each file
        (tmp_path / folder / "data.json").write_text(json.dumps(timed))
    paths = [tmp_path / "a" / "data.json", tmp_path / "b" / "data.json"]
    made = import_files(paths, tmp_path / "in")
    assert (made.subjects, made.attempts) == (1, 2)


SEMICOLONS = TIMED.replace(",", ";")
AGES = "\n".join(
    (f'{COLUMNS.replace(",", ";")};"age, years"', *(f"{row.replace(',', ';')};30" for row in ROWS))
)


@pytest.mark.parametrize(
    "content",
    [
        f"{TIMED}\n,,,,,,\n,,,,,,\n",
        TIMED.replace(",", "\t"),
        SEMICOLONS.replace("0.", "0,").replace("1.1", "1,1").replace("\n", "\r\n"),
        f"\n \n{TIMED}",
        AGES,
        TIMED.replace(",1,", ",1.0,"),
        "\n".join((f"{COLUMNS},phase,moved", *(f"{row},NA,NULL" for row in ROWS))),
    ],
    ids=["empty rows", "tabs", "decimal commas", "empty first", "comma in header", "1.0", "R"],
)
def test_tables_saved_by_other_programs_are_read(content, tmp_path):
    (tmp_path / "data.csv").write_bytes(content.encode("utf-8-sig"))
    made = import_files([tmp_path / "data.csv"], tmp_path / "in")
    assert (made.attempts, made.warnings) == (2, ())
    assert seconds_of(tmp_path / "in") == SECONDS


def test_times_in_milliseconds_are_asked_about(tmp_path):
    rows = (f"{row.rpartition(',')[0]},70000" for row in ROWS)
    name = written(tmp_path, "\n".join((COLUMNS, *rows)))
    (warning,) = import_files([tmp_path / name], tmp_path / "in").warnings
    assert "divide the column by 1,000" in warning


def screens(elapsed=(1000, 2000, 3000, 4000, 5000, 6000)):
    """The screens of jsPsych for the six rows, with an instruction before them."""
    rows = [{"trial_type": "instructions", "rt": 900, "time_elapsed": 900}]
    for row, passed in zip(ROWS, elapsed, strict=True):
        values = dict(zip(COLUMNS.split(","), row.split(","), strict=True))
        values |= {"rt": round(1000 * float(values.pop("reaction"))), "time_elapsed": passed}
        rows.append({"trial_type": "html-button-response", **values})
    return rows


def test_csv_and_json_of_jspsych_are_the_same_in_every_form(tmp_path):
    text = pd.DataFrame(screens()).to_csv(index=False, quoting=csv.QUOTE_ALL)
    alone = pd.DataFrame(screens()).drop(columns="subject").to_csv(index=False, sep=";")
    forms = {
        "table.csv": text.encode(),
        "list.json": json.dumps(screens()).encode(),
        "jatos.txt": f"{json.dumps(screens())}\n".encode(),
        "nulls.csv": text.replace('""', '"null"').encode(),
        "named_wrong.CSV": json.dumps(screens()).encode(),
        "packed.CSV.GZ": gzip.compress(text.encode()),
        "anna.csv": alone.encode(),
    }
    tables = []
    for name, content in forms.items():
        out = tmp_path / name.partition(".")[0]
        (tmp_path / name).write_bytes(content)
        assert import_files([tmp_path / name], out).attempts == 2
        assert seconds_of(out) == SECONDS
        tables.append(Store(out).record()[0].drop(["experiment"]))
    assert all(table.equals(tables[0]) for table in tables)


def test_time_continues_where_a_page_was_loaded_again(tmp_path):
    path = tmp_path / "data.json"
    path.write_text(json.dumps(screens((1000, 2000, 3000, 500, 900, 1500))))
    import_files([path], tmp_path / "in")
    times = Store(tmp_path / "in").record()[0]["wall_time"].to_pylist()
    assert times == pytest.approx([3.0, 4.5])


def test_a_time_that_a_screen_gives_itself_counts_before_that_of_jspsych(tmp_path):
    path = tmp_path / "data.json"
    path.write_text(json.dumps([{**row, "time": n} for n, row in enumerate(screens())]))
    import_files([path], tmp_path / "in")
    assert Store(tmp_path / "in").record()[0]["wall_time"].to_pylist() == [3.0, 6.0]


def test_code_that_an_experiment_names_is_told_before_it_runs(tmp_path):
    (tmp_path / "mine.py").write_text("def paid(step, cost):\n    return step.reward * 0\n")
    (tmp_path / "data.csv").write_text(TIMED)
    (tmp_path / "own.yaml").write_text(
        "name: own\ntitle: Own\nconditions: [CE3]\n"
        "learners: [{learner: random, reward: mine:paid, subjects: 1}]\n"
    )
    with modules_of(tmp_path):
        done = at_once("import", "data.csv", "-o", "in", "--from", "own.yaml", cwd=tmp_path)
    assert "mine" in done.stdout.partition("in written")[0]
