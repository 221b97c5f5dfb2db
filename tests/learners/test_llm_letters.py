"""A language model that predicts others, by the letters that stand for actions."""

import json
import math
import string

import httpx2
import numpy as np
import pyarrow.compute as pc
import pytest

from causal_openlock.analysis.topics import language_models
from causal_openlock.comparison.results import Results
from causal_openlock.contract.registry import create
from causal_openlock.errors import NotAvailableError
from causal_openlock.experiment.condition import Condition, Trials, find_condition
from causal_openlock.experiment.making import make_experiment
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.render.words import Wording
from causal_openlock.running.runner import run
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from causal_openlock.world.room import Layout
from openlock_learners.language.answers import read_letters
from openlock_learners.language.replies import FOLDER
from openlock_learners.language.server import KEY, TRUSTED
from support.command import at_once
from support.scores import score_actions
from support.scripted_model import (
    NETWORK,
    URL,
    ScriptedModel,
    completion,
    letters_in,
    logprobs,
    says,
    some_action,
)
from support.topics import section_on

CC3 = find_schema("CC3")
PROTOCOL = Protocol("short", 2, stop_when_solved=True, baseline_trials=1)
LETTERS = string.ascii_uppercase[:15]
CUT = httpx2.ReadError("the connection is cut")


@pytest.fixture(autouse=True)
def environment(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    for name in (KEY, TRUSTED):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def scripted(monkeypatch):
    def made(script):
        """A model that is asked from now on."""
        model = ScriptedModel(script)
        monkeypatch.setattr(NETWORK, model)
        return model

    return made


def llm(**parameters):
    chosen = {"model": "scripted", "base_url": URL, "retries": 0, **parameters}
    return [{"learner": "llm", "parameters": chosen}]


@pytest.fixture
def folder(tmp_path):
    """Three subjects who push at random, and are to be predicted."""
    return played(tmp_path / "played", "CC3")


def played(folder, condition):
    made = make_experiment([condition], ["random"], subjects=3, protocol=PROTOCOL, seed=5)
    run(made, folder, workers=0)
    return folder


def answering(chances):
    """A script that answers with one token, by its chances after so many actions."""

    def script(body, _):
        taken = sum(message["role"] == "assistant" for message in body["messages"])
        given = chances(taken) if callable(chances) else chances
        return completion(says(next(iter(given))), "length", logprobs=logprobs(given))

    return script


def growing(taken):
    """A first letter that is likelier after each action, and others that share the rest."""
    first = 0.9 - 0.5 / (taken + 1)
    return {LETTERS[0]: first, **dict.fromkeys(LETTERS[1:], (1 - first) / 14)}


def constant(_):
    """A chance of its own for each letter."""
    return dict(zip(LETTERS, (np.arange(15) + 1) / 120, strict=True))


def said_in(folder):
    """The transcript of the scores."""
    return [json.loads(line) for line in (folder / "scores/transcripts.jsonl").open()]


@pytest.mark.parametrize("tools", [True, False])
def test_the_score_is_the_sum_by_hand_with_one_request_for_each_action(tools, folder, scripted):
    results, chances = Results.read(folder), growing if tools else constant
    model = scripted(answering(chances))
    recent = {} if tools else {"recent": 1}
    scores = results.score(llm(story="levers", tools=tools, **recent), lapse=0.01)
    scores.save(folder / "scores")
    rows, by_hand = results.record.to_pandas(), []
    for subject in range(3):
        head, *own = [line for line in said_in(folder) if line["subject"] == subject]
        words = Wording("levers", tuple(head["names"]), tuple(head["order"]))
        done = [action for row in rows[rows["subject"] == subject]["actions"] for action in row]
        asked = [line for line in own if "asked" in line]
        nats = 0.0
        for taken, (action, line) in enumerate(zip(done, asked, strict=True)):
            letter_of = {text: letter for letter, text in letters_in(line["told"]).items()}
            chance = chances(taken)[letter_of[words.actions[action]]]
            nats -= math.log(0.99 * chance + 0.01 / 15)
        by_hand.append(nats)
    assert scores.subjects["nll"].tolist() == pytest.approx(by_hand, abs=1e-9)
    assert not scores.subjects["standard_error"].any()
    assert len(model.asked) == len(scores.actions)
    # Each request ends with the only question, in roles that alternate, and asks for one token.
    for body in model.asked:
        assert (body["max_tokens"], body["logprobs"], body["top_logprobs"]) == (1, True, 20)
        assert "".join(letters_in(body["messages"])) == LETTERS
        assert str(body["messages"]).count(" alone.\\n") == 1
        assert (body.get("tool_choice") == "none") == tools
        spoken = [message["role"] == "assistant" for message in body["messages"]]
        assert spoken == [bool(place % 2) for place in range(len(spoken))]


def test_a_preference_for_a_letter_shows_and_favours_no_action(folder, scripted):
    scripted(answering({"A": 1 - 1e-9, "B": 1e-9}))
    learner = create("llm", llm()[0]["parameters"])
    room = Condition("room", (Trials(CC3, (Layout.of(CC3, "trial1"),)),))
    session = Session(room, PROTOCOL, 90, learner="llm")
    learner.begin(session.brief)
    first = learner.predictions(session.view)
    assert first.max(axis=1) == pytest.approx(1, abs=1e-6)
    assert first.mean(axis=0).max() < 0.2  # 15 actions
    assert len({*first.argmax(axis=1).tolist()}) == 15
    learner.learn(session.step(np.zeros(90, np.int64)))
    assert (learner.predictions(session.view).argmax(axis=1) == first.argmax(axis=1)).all()
    # The report has the mean of each letter, where only scores have spoken.
    Results.read(folder).score([*llm(), "random"]).save(folder / "scores")
    (table,) = section_on(language_models.TOPIC, Results.read(folder)).tables
    assert table.heads == ["learner", "actions", "subjects", "missing", *LETTERS]
    assert table.rows == [["llm", "15", "3", "0%", "100%", *["0%"] * 14]]
    # Scores in which no model speaks have no transcript of others.
    Results.read(folder).score(["random"]).save(folder / "scores")
    assert section_on(language_models.TOPIC, Results.read(folder)) is None


NAMING = {"A": ["A", " A", "a", "A)", "(a"], "B": ["**B", "ĠB"], "C": ["▁C.", "\nC"]}
NAMING[""] = ["AB", "I'd", "Push", "", "1", "É", "Z"]


@pytest.mark.parametrize(
    ("token", "letter"), [(token, letter) for letter in NAMING for token in NAMING[letter]]
)
def test_a_token_is_a_letter_whatever_is_around_it(token, letter):
    odds, missing = read_letters({token: math.log(0.6), "?": math.log(0.01)}, 3)
    assert missing == pytest.approx(0.4 if letter else 1)
    if letter:
        assert odds["ABC".index(letter)] == pytest.approx(0.6 / 0.62)
    else:
        assert odds.tolist() == pytest.approx([1 / 3] * 3)


def test_a_letter_without_a_token_shares_what_is_missing_up_to_the_least_token():
    assert read_letters({}, 4)[0].tolist() == [0.25] * 4
    assert read_letters({"A": -1e4}, 4)[0].tolist() == [0.25] * 4
    odds, missing = read_letters({"A": math.log(0.5), "a": math.log(0.4)}, 3)
    assert (odds.tolist(), missing) == (pytest.approx([0.9, 0.05, 0.05]), pytest.approx(0.1))
    odds, missing = read_letters({"A": math.log(0.5), "Well": math.log(0.01)}, 3)
    shared = [0.5 / 0.52, 0.01 / 0.52, 0.01 / 0.52]
    assert (odds.tolist(), missing) == (pytest.approx(shared), pytest.approx(0.5))


@pytest.mark.parametrize(("beside", "warned"), [(0.04, False), (0.06, True)])
def test_what_is_on_no_letter_is_kept_and_above_five_percent_said(beside, warned, folder, scripted):
    scripted(answering({"I'd": beside, **dict.fromkeys(LETTERS, (1 - beside) / 15)}))
    (folder / "one.yaml").write_text(
        f"{{name: one, conditions: [CC3], learners: {json.dumps(llm())}}}"
    )
    done = at_once("score", folder, "--from", folder / "one.yaml", "--workers", 1)
    assert done.status == 0, done.stderr
    assert ("than 5% of the probability" in " ".join(done.stdout.split())) == warned
    asked = [line for line in said_in(folder) if "asked" in line]
    assert {line["missing"] for line in asked} == {beside}
    (table,) = section_on(language_models.TOPIC, Results.read(folder)).tables
    assert table.rows[0][3:5] == [f"{beside:.0%}", "7%"]


def test_scoring_again_asks_nobody(folder, scripted, tmp_path, monkeypatch):
    scripted(answering(growing))
    scores = Results.read(folder).score(llm())
    scores.save(folder / "scores")
    again = scripted(lambda *_: CUT)
    for replay in (tmp_path / "replay", folder / "scores"):
        monkeypatch.setenv(FOLDER, str(replay))
        repeated = Results.read(folder).score(llm())
        assert repeated.actions.equals(scores.actions)
        assert "had been given before" in repeated.accounts[0].remarks[0]
    assert not again.asked


REFUSES = 400, json.dumps({"error": {"message": "'logprobs' is not supported"}}), {}
OTHER_FORMS = {"content": [{"token": "A", "logprob": 0.0}]}, {"tokens": ["A"]}, [], "A"
WITHOUT = {
    "none": completion(says("A")),
    **{f"in {form}": completion(says("A"), logprobs=form) for form in OTHER_FORMS},
    "refused": REFUSES,
}


@pytest.mark.parametrize("server", WITHOUT)
def test_a_server_without_logprobs_is_a_sentence_and_draws_need_none(server, folder, scripted):
    scripted(lambda *_: WITHOUT[server])
    with pytest.raises(NotAvailableError, match=r"logprobs.* another server .*--draws 200\)$"):
        Results.read(folder).score(llm())
    # Nothing of that is kept: the same server may give them later.
    scripted(answering(growing))
    assert Results.read(folder).score(llm()).subjects["standard_error"].eq(0).all()
    asked = scripted(some_action)
    drawn = Results.read(folder).score(llm(), draws=2, lapse=0.5)
    assert drawn.subjects["at_limit"].any()
    assert {body.get("tool_choice") for body in asked.asked} == {None}
    assert not any("logprobs" in body for body in asked.asked)


def test_an_answer_that_a_filter_stops_says_nothing_of_the_action(folder, scripted):
    scripted(lambda *_: completion(says(""), "content_filter"))
    scores = Results.read(folder).score(llm())
    assert scores.subjects["bits"].tolist() == pytest.approx([math.log2(15)] * 3)


@pytest.mark.parametrize(
    ("settings", "sent"),
    [
        ({"max_completion_tokens": 300}, {"max_completion_tokens": 1, "top_logprobs": 20}),
        ({"max_tokens": 300, "top_logprobs": 5}, {"max_tokens": 1, "top_logprobs": 5}),
        ({"max_tokens": 300, "max_completion_tokens": None}, {"max_tokens": 1}),
    ],
)
def test_settings_say_how_one_token_is_asked_for(settings, sent, folder, scripted):
    model = scripted(answering(growing))
    Results.read(folder).score(llm(settings=settings))
    names = ("max_tokens", "max_completion_tokens", "top_logprobs")
    found = [{name: body[name] for name in names if name in body} for body in model.asked]
    assert all(one == {"top_logprobs": 20} | sent for one in found)


SHOWN = "shown-CC3-CC4"


def test_actions_that_were_shown_or_not_done_are_not_asked_for(tmp_path, scripted):
    record, experiment = Store(played(tmp_path / "shown", SHOWN)).record()
    early = pc.and_(pc.equal(record["subject"], 0), pc.equal(record["attempt"], 2))
    left = record.filter(pc.or_(pc.equal(record["phase"], "shown"), pc.invert(early)))
    assert len(left) < len(record)
    model = scripted(answering(growing))
    (spec,) = make_experiment([SHOWN], llm()).learners
    scores = score_actions(left, experiment, spec)
    assert len(model.asked) == len(scores) > 0


def test_who_plays_is_asked_for_no_letter_and_draws_what_it_drew(scripted):
    model = scripted(some_action)
    played, same = (Session(find_condition(SHOWN), PROTOCOL, 2, learner="llm") for _ in range(2))
    learner = create("llm", llm(story="levers")[0]["parameters"])
    rows = played.play(learner).to_pylist()
    assert len(model.asked) == sum(len(row["actions"]) for row in rows if row["phase"] != "shown")
    assert not any("logprobs" in body for body in model.asked)
    said = learner.account().transcripts
    for (head, *_), generator in zip(said, same.brief.generators, strict=True):
        words = Wording.draw(same.brief.positions, generator, "levers")
        assert (head["names"], head["order"]) == (words.names, words.order)
        assert head["seed"] == int(generator.integers(2**31))
        assert "letters" not in head
