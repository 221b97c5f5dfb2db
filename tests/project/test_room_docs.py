"""The pages on the physical room and on people: what they say is so, and their example is whole."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.reactions import read_reactions
from causal_openlock.play.game import Game
from causal_openlock.play.log import Log
from causal_openlock.render.filmed_trial import recorded_trial
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from support.documents import DOCS, code

PAGES = {
    name: (DOCS / name).read_text(encoding="utf-8") for name in ("physical_room.md", "play.md")
}
EXAMPLE = DOCS / "example_play"


def blocks(page: str, language: str) -> list[str]:
    return code(PAGES[page], language)


def test_the_environment_with_bodies_is_made_as_shown() -> None:
    names: dict[str, Any] = {}
    (block,) = blocks("physical_room.md", "python")
    exec(block, names)
    (said,) = re.findall(r"print\(info\[\"physics\"\]\)  # (.*)", block)
    told, shown = names["info"]["physics"], eval(said)
    assert {**told, "steps": 0} == {**shown, "steps": 0}
    assert told["steps"] == pytest.approx(shown["steps"], rel=0.1)  # another machine rounds apart
    assert len(names["poses"]) == names["info"]["physics"]["steps"]
    assert names["picture"].shape[0] == 720


def test_people_are_read_as_shown() -> None:
    (block,) = blocks("play.md", "python")
    names: dict[str, Any] = {}
    exec(block.replace("results/people", EXAMPLE.as_posix()), names)
    assert set(names["attempts"]["learner"]) == {"person"}
    assert len(names["reactions"]) == names["attempts"]["actions"].map(len).sum()


def test_the_example_took_as_many_attempts_as_the_page_says() -> None:
    record = Store(EXAMPLE).record()[0].to_pandas()
    solved = record.groupby(["phase", "trial"], observed=True)["attempt"].max()
    assert solved["train"].tolist() == [3, 3, 3, 2, 3, 2]
    assert solved["test"].tolist() == [4]
    assert "3, 3, 3, 2, 3 and 2 attempts in the six training rooms" in PAGES["play.md"]
    trial = recorded_trial(EXAMPLE, "person", "CC3-CC4", trial=7)
    assert (trial.found, len(trial.attempts)) == (3, 4)
    size = sum(path.stat().st_size for path in EXAMPLE.rglob("*") if path.is_file())
    assert size < 200_000


def test_the_examples_record_is_what_its_log_says(tmp_path: Path) -> None:
    # The log alone, played again, gives every attempt and every reaction time that is on file.
    log = tmp_path / "log.jsonl"
    log.write_bytes((EXAMPLE / "log.jsonl").read_bytes())
    _, joined, *turns = Log(log).entries
    held = json.loads((EXAMPLE / "experiment.json").read_text(encoding="utf-8"))
    condition = Condition.named("CC3-CC4", find_schema)
    game = Game(condition, PROTOCOLS["human"], 0, held["seed"], joined["practice"])
    for number, turn in enumerate(turns):
        assert turn["turn"] == number
        if "action" in turn:
            game.act(turn["action"], turn["reaction"] / 1000, turn["at"] - joined["at"])
        else:
            game.proceed()
    assert game.stage == "end"
    kept = Store(EXAMPLE).record()[0].drop_columns(["wall_time"])
    assert game.session.record().drop_columns(["wall_time"]).to_pylist() == kept.to_pylist()
    rows = read_reactions(EXAMPLE).to_pylist()
    assert [(row["action"], row["reaction"]) for row in rows] == [
        (one.action, one.reaction) for one in game.done
    ]
