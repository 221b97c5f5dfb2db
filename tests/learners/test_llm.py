"""A language model as a subject: a scripted one answers in the place of the network."""

import itertools
import json
import os
import re
import sys
import zipfile

import httpx2
import numpy as np
import pytest

from causal_openlock.analysis.topics import language_models
from causal_openlock.comparison.results import Results
from causal_openlock.contract.registry import create
from causal_openlock.errors import CellsFailed, LearnerError, Stopped
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.making import read_experiment
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.export.bundle import write_bundle
from causal_openlock.render.words import Wording
from causal_openlock.running.runner import run
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from causal_openlock.world.room import Layout
from openlock_learners.language.answers import read_structure
from openlock_learners.language.replies import FOLDER, Replies
from openlock_learners.language.server import KEY, TRUSTED
from support.scripted_model import (
    NETWORK,
    URL,
    USAGE,
    ScriptedModel,
    call,
    choices,
    completion,
    says,
    some_action,
)
from support.topics import section_on

CC3 = find_schema("CC3")
ROOMS = [Layout.of(CC3, "trial1"), Layout.of(CC3, "trial2")]
HEADERS = "OPENAI_CUSTOM_HEADERS"
SECRET = "sk-very-secret-0123"
WORDS = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
NODES = ("P0", "P1", "P2", "door")
STRUCTURE = '{"enables": [{"cause": "oak", "effect": "the door"}]}'


@pytest.fixture(autouse=True)
def environment(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    for name in (KEY, TRUSTED, HEADERS):
        monkeypatch.delenv(name, raising=False)
    # Pauses between tries are the library's; here they only cost time.
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.001)


@pytest.fixture
def scripted(monkeypatch):
    def made(script=some_action):
        """A model that is asked from now on."""
        model = ScriptedModel(script)
        monkeypatch.setattr(NETWORK, model)
        return model

    return made


def session_of(subjects, attempts=2, rooms=1):
    condition = Condition("rooms", (Trials(CC3, tuple(ROOMS[:rooms]), shuffle=False),))
    protocol = Protocol("t", attempts, stop_when_solved=True, baseline_trials=rooms)
    return Session(condition, protocol, subjects, learner="llm")


@pytest.fixture
def play(scripted):
    def played(script=some_action, *, subjects=1, attempts=2, rooms=1, **parameters):
        """The model, the record as rows, the transcripts and the remarks."""
        model = scripted(script)
        learner = create("llm", {"model": "scripted", "base_url": URL, **parameters})
        session = session_of(subjects, attempts, rooms)
        record = session.play(learner).drop_columns(["wall_time"]).to_pylist()
        account = learner.account()
        return model, record, [*account.transcripts], account.remarks

    return played


@pytest.fixture
def refused(scripted, play):
    def why(script=some_action, **parameters):
        """Why a play fails."""
        with pytest.raises(LearnerError) as raised:
            play(script, **parameters)
        return str(raised.value)

    return why


def actions(record):
    return [action for row in record for action in row["actions"]]


def first(body):
    return choices(body)[0]


# -- what it is told, and what its answers are ----------------------------------------------------


def test_it_is_told_what_a_person_is_told_and_its_calls_are_its_actions(play):
    def script(body, number):
        """Fields that go back: DeepSeek wants its reasoning, Gemini its thought's signature."""
        said = some_action(body, number)
        said["tool_calls"][0]["extra"] = {"signature": "c2ln"}
        return {**said, "reasoning": "hm"}

    model, record, (said,), remarks = play(script, story="switches")
    head, *lines, _ = said
    words = Wording(head["story"], tuple(head["names"]), tuple(head["order"]))
    asked = model.asked[0]
    assert words.instructions(3, 2) in asked["messages"][0]["content"]
    assert choices(asked) == words.choices
    assert asked["parallel_tool_calls"] is False
    sent = asked["model"], asked["temperature"], asked["seed"]
    assert sent == ("scripted", 1.0, head["seed"])
    called = [line["reply"]["message"]["tool_calls"][0]["function"] for line in lines]
    chosen = [json.loads(function["arguments"])["action"] for function in called]
    assert actions(record) == [words.actions.index(name) for name in chosen]
    assert not remarks
    # A call goes back as it was, followed by its result, which says what it did.
    begin, back, result = model.asked[1]["messages"]
    assert (begin["role"], back["reasoning"]) == ("user", "hm")
    assert back["tool_calls"][0]["id"] == result["tool_call_id"]
    assert "extra" in back["tool_calls"][0]
    assert "Left:" in result["content"]
    # The transcript is the whole conversation, with what each answer took.
    assert (head["tokens"], head["model"], head["answers"]) == ([600, 30], "scripted", 6)
    kept = lines[0]["reply"]
    from_server = kept["model"], kept["server"], kept["fingerprint"], kept["retries"]
    assert from_server == ("scripted-1", "Scripted/1", "fp_7", 0)
    told = [message["content"] for line in said[1:] for message in line["told"]]
    assert (len(told), told[0]) == (7, begin["content"])


def with_arguments(change):
    def script(body, _):
        said = call(first(body))
        function = said["tool_calls"][0]["function"]
        function["arguments"] = change(function["arguments"])
        return said

    return script


HABITS = {
    "text": lambda body, _: says(f"Let me see.\n\n**{first(body)}**"),
    "arguments as an object": with_arguments(json.loads),
    "arguments twice in text": with_arguments(json.dumps),
    "several calls": lambda body, _: says(
        "", tool_calls=call(first(body))["tool_calls"] + call("push the door")["tool_calls"]
    ),
    "a tool of a namespace": lambda body, _: call(first(body), "functions.act"),
    "a tool of a channel": lambda body, _: call(first(body), "act<|channel|>commentary"),
    "content in parts": lambda body, _: says(
        [{"type": "thinking", "thinking": []}, {"type": "text", "text": first(body)}]
    ),
    "a thought": lambda body, _: says(f"<think>\nhm\n</think>\n{first(body)}"),
    "another reason": lambda body, _: completion(says(first(body)), "STOP"),
    "no reason": lambda body, _: completion(says(first(body)), None),
}


@pytest.mark.parametrize("habit", HABITS)
def test_an_action_is_read_however_a_server_writes_it(habit, play):
    model, record, (said,), remarks = play(HABITS[habit])
    assert said[0]["faults"] == {}
    assert set(actions(record)) == {said[0]["order"][0]}
    assert not remarks
    for message in model.asked[-1]["messages"]:
        for made in message.get("tool_calls", ()):
            assert made["function"]["name"] == "act"
            assert isinstance(made["function"]["arguments"], str)


def test_without_tools_none_is_offered_and_a_call_is_no_action(play):
    model, record, _, _ = play(lambda *_: says("push the door"), tools=False, story="levers")
    assert not {"tools", "parallel_tool_calls"} & {*model.asked[0]}
    assert set(actions(record)) == {14}
    _, _, (said,), _ = play(lambda *_: call("push the door"), attempts=1, tools=False)
    assert said[0]["faults"] == {"malformed": 9}


PARTS = ["length", "LENGTH", "model_length", "error", "insufficient_system_resource", "abort"]
PARTS += ["network_error", "incomplete", "max_tokens"]
FILTERED = 400, json.dumps({"error": {"message": "policy", "code": "content_filter"}}), {}
BAD = {
    "prose": (says("I would rather not say."), "malformed"),
    "nested": (with_arguments(lambda _: "[" * 100_000), "malformed"),
    "half a sign": (says("No \ud800."), "malformed"),
    "another lever": (call("push the moon"), "out of range"),
    "refused": (says(None, refusal="I cannot help with locks."), "refused"),
    "a filter": (completion(says("push oak"), "content_filter"), "refused"),
    "a filter of Gemini": (completion(says("push oak"), "SAFETY"), "refused"),
    "a filter of the question": (FILTERED, "refused"),
    "still thinking": (says("<think>\nI could begin with\npush oak"), "cut off"),
    **{part: (completion(says("push oak"), part), "cut off") for part in PARTS},
}


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_action_has_a_name_and_is_asked_again(bad, play):
    message, fault = BAD[bad]

    def script(body, number):
        if number:
            return some_action(body, number)
        return message(body, number) if callable(message) else message

    model, record, (said,), remarks = play(script)
    assert [line["fault"] for line in said[1:3]] == [fault, None]
    assert (said[0]["faults"], said[0]["unanswered"]) == ({fault: 1}, 0)
    assert f"1 {fault}" in remarks[0]
    assert len(actions(record)) == 6
    assert "The actions are:" in model.asked[1]["messages"][-1]["content"]
    # A call that is no proper one goes back as text, and nothing as words: servers refuse others.
    back = model.asked[1]["messages"][1]
    assert ("tool_calls" in back) == (fault == "out of range")
    assert back["content"] or "tool_calls" in back
    assert ("max_tokens" in " ".join(remarks)) == (fault == "cut off")


def test_an_unanswered_action_changes_nothing_and_too_many_are_an_error(play, refused):
    def script(body, number):
        return says("Hm.") if number < 3 else some_action(body, number)

    model, record, (said,), remarks = play(script, ask_again=2)
    assert record[0]["moved"][0] is False
    assert said[0]["unanswered"] == 1
    assert next(line["unanswered"] for line in said[1:] if "unanswered" in line).startswith("pull_")
    told = ["this one is spent" in body["messages"][-1]["content"] for body in model.asked[3:5]]
    assert told == [True, False]
    assert "1 action stayed unanswered" in remarks[0]
    why = refused(lambda *_: says("Hm."), ask_again=1, unanswered=1, recent=9)
    assert "left 2 actions unanswered" in why
    assert "4 malformed" in why


@pytest.mark.parametrize("tools", [True, False])
def test_in_the_place_of_another_it_is_told_what_that_one_did(tools, scripted):
    def conversation(done, asked):
        """What a subject is told that does this, and is asked before some of it."""
        scripted(lambda *_: call("push the door") if tools else says("push the door"))
        learner = create("llm", {"model": "m", "base_url": URL, "story": "levers", "tools": tools})
        session = session_of(1)
        learner.begin(session.brief)
        for moment, action in enumerate(done):
            if moment in asked:
                assert learner.act(session.view).tolist() == [14]
            learner.learn(session.step(np.array([action])))
        (subject,) = learner._subjects
        return subject.words, json.loads(json.dumps(subject.talk).replace('"c1"', '"call"'))

    assert conversation([14] * 6, range(6)) == conversation([14] * 6, ())
    # It answers something else, and is not always asked.
    words, told = conversation([1, 2, 3], (1,))
    said = [json.dumps(message) for message in told if message["role"] == "assistant"]
    assert [words.actions[a] in text for a, text in zip((1, 2, 3), said, strict=True)] == [True] * 3


def test_it_is_reminded_of_recent_answers_alone(play):
    model, *_ = play(attempts=3, recent=2)
    assert [len(body["messages"]) for body in model.asked] == [1, 3, 5, 5, 5, 5, 5, 5, 5]
    last = model.asked[-1]["messages"]
    assert "left out" in last[0]["content"]
    roles = [message["role"] for message in last]
    assert roles == ["user", "assistant", "tool", "assistant", "tool"]
    # A short memory makes no two questions one.
    model, _, (said,), _ = play(lambda *_: says("Hm."), attempts=1, recent=1)
    assert (len(model.asked), said[0]["answers"]) == (9, 9)


def test_it_is_asked_which_enables_which_and_plays_as_if_it_were_not(play):
    def script(body, number):
        if body.get("tool_choice") != "none":
            return some_action({k: v for k, v in body.items() if k != "seed"}, 0)
        return says(STRUCTURE.replace("oak", first(body).removeprefix("push ")))

    _, plain, _, _ = play(script, rooms=2, story="levers")
    model, asked, (said,), _ = play(script, rooms=2, story="levers", ask_structure=True)
    assert plain == asked
    lines = [line for line in said if line.get("asked") == "structure"]
    assert [line["trial"] for line in lines] == [1, 2]
    (pair,) = lines[0]["enables"]
    assert pair[1] == "door"
    assert sum('"enables"' in str(body["messages"]) for body in model.asked) == 2
    _, _, (said,), remarks = play(ask_structure=True, temperature=0.5)  # a call is no structure
    assert said[0]["unreadable"] == 1
    assert "could not be read" in remarks[0]


READ = (
    STRUCTURE,
    f"<think>elm?</think>\n```json\n{STRUCTURE}\n```",
    f"I believe {{so}}:\n```json\n{STRUCTURE}\n```\nThat is all {{I know}}.",
    STRUCTURE.replace("oak", "Oak").replace("the door", "door"),
)
NOT_READ = (
    *("[" * 100_000, "<think>" * 14_000, "[]", '{"enables": [1]}'),
    *(STRUCTURE.replace("oak", "x"), STRUCTURE.replace("oak", "door")),
)


@pytest.mark.parametrize("content", [*READ, *NOT_READ])
def test_a_structure_is_read_and_never_guessed(content):
    expected = [["P0", "door"]] if content in READ else None
    assert read_structure({"content": content}, WORDS, NODES) == expected


# -- the server -----------------------------------------------------------------------------------


CUT = httpx2.ReadError("the connection is cut")


@pytest.mark.parametrize(
    "trouble", [(429, "", {"retry-after-ms": "1"}), (503, "<html>", {}), CUT], ids=str
)
def test_trouble_passes(trouble, play):
    model, record, (said,), _ = play(lambda b, n: trouble if n in (0, 2) else some_action(b, n))
    assert (len(actions(record)), len(model.asked)) == (6, 8)
    assert model.asked[0] == model.asked[1]
    assert [line["reply"]["retries"] for line in said[1:-1]] == [1, 1, 0, 0, 0, 0]


def raw(message, **more):
    return 200, json.dumps({"choices": [{"message": "?"}], **more}).replace('"?"', message), {}


def test_the_key_is_in_no_message_if_the_server_names_it(scripted, monkeypatch, tmp_path):
    monkeypatch.setenv(KEY, SECRET)
    monkeypatch.setenv(TRUSTED, URL)
    model = scripted(lambda *_: (401, f'{{"error": {{"message": "no: {SECRET}"}}}}', {}))
    learner = create("llm", {"model": "m", "base_url": URL})
    with pytest.raises(LearnerError) as raised:
        session_of(1).play(learner)
    assert model.keys == {f"Bearer {SECRET}"}
    kept = json.dumps([learner.account().transcripts, str(learner.__getstate__())])
    kept += "".join(path.read_text() for path in tmp_path.rglob("*.jsonl"))
    assert SECRET not in f"{raised.value} {kept}"


def test_secrets_of_the_environment_go_only_where_it_says(play, monkeypatch):
    monkeypatch.setenv(KEY, f"{SECRET}\n")  # as a file ends
    for name in (HEADERS, "OPENAI_ORG_ID", "OPENAI_PROJECT_ID", "OPENAI_ADMIN_KEY"):
        monkeypatch.setenv(name, f"X-Own: {SECRET}" if name == HEADERS else SECRET)
    for trusted in (None, "http://localhost:8001/v1", "https://localhost:8000/v1"):
        if trusted:
            monkeypatch.setenv(TRUSTED, trusted)
        (request, *_) = play(settings={"for": str(trusted)})[0].requests
        assert SECRET not in str([*request.headers.items()])
    monkeypatch.setenv(TRUSTED, URL)
    (request, *_) = play()[0].requests
    assert request.headers["X-Own"] == SECRET
    assert request.headers["Authorization"] == f"Bearer {SECRET}"


def test_there_is_no_server_without_a_key_or_an_address(refused, monkeypatch):
    assert KEY in refused(base_url="https://api.openai.com/v1")
    monkeypatch.setenv(TRUSTED, URL)
    for key in ("sk-very\nsecret", "sk-very\x1bsecret", "sk-very-sécret"):
        monkeypatch.setenv(KEY, key)
        assert KEY in refused()
        assert "cret" not in refused()


NESTED = f'{{"content": "no", "more": {"[" * 400}{"]" * 400}}}'
NONE_AT_ALL = "no chat completion"


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ((400, '{"error": {"message": "maximum context length"}}', {}), "maximum context length"),
        ((404, "<html>404 page not found</html>", {}), "404"),
        ((307, "", {"Location": "http://else/v1"}), "307"),
        ((429, "", {"retry-after-ms": "1"}), "429"),
        (CUT, "the connection is cut"),
        (httpx2.ReadTimeout("slow"), "in time"),
        ((200, "<!doctype html>", {}), NONE_AT_ALL),
        ((200, "[]", {}), NONE_AT_ALL),
        ((200, '{"choices": [{"message": {}, "finish_reason": 7}]}', {}), NONE_AT_ALL),
        (raw("{}", usage={"prompt_tokens": float("inf")}), NONE_AT_ALL),
        (raw("{}", usage={"prompt_tokens": -100}), NONE_AT_ALL),
        (raw('{"x": NaN}'), NONE_AT_ALL),
        (raw(NESTED), NONE_AT_ALL),
    ],
)
def test_a_server_that_gives_no_answer_is_named(said, words, refused, scripted, tmp_path):
    asked = []
    told = refused(lambda *_: asked.append(1) or said, retries=0)
    assert f"the server at {URL} " in told
    assert words in told
    assert len(asked) == 1  # a redirection is not followed
    assert not "".join(path.read_text() for path in tmp_path.rglob("*.jsonl"))


@pytest.mark.parametrize(
    ("usage", "tokens"),
    [
        (USAGE | {"total_tokens": 1105}, [600, 6030]),  # thoughts are in the total alone
        ({"prompt_tokens": 0, "completion_tokens": 5, "total_tokens": 105}, [600, 30]),
        ({"prompt_tokens": 0, "completion_tokens": 5}, [0, 30]),
        (None, [0, 0]),
    ],
)
def test_tokens_are_at_least_the_total_of_the_server(usage, tokens, play):
    _, _, (said,), remarks = play(lambda b, n: completion(some_action(b, n), "stop", usage))
    assert said[0]["tokens"] == tokens
    assert ("did not count the tokens of 6 questions" in " ".join(remarks)) == (not tokens[0])


@pytest.mark.parametrize(("counted", "cut"), [(700, True), (10**6, False), (40, False)])
def test_a_server_that_cuts_prompts_is_named(counted, cut, play):
    def script(body, number):
        read = sum(len(str(message["content"])) for message in body["messages"]) // 4
        tokens = min(counted, read) if number else read  # some servers count what is new alone
        usage = {"prompt_tokens": tokens}
        return completion(says(f"{'Well. ' * 300}\n{first(body)}"), "stop", usage)

    assert any("recent" in remark for remark in play(script)[3]) == cut


# -- what is kept ---------------------------------------------------------------------------------


def test_a_repetition_asks_nobody_and_is_the_same_byte_for_byte(play, refused, monkeypatch):
    _, record, said, _ = play(lambda b, n: call(choices(b)[n % 15]), subjects=3)
    monkeypatch.setitem(sys.modules, "openlock_learners.language.server", None)
    model, again, told, remarks = play(subjects=3)
    assert not model.asked
    assert again == record
    assert json.dumps(told) == json.dumps(said)
    assert "18 answers had been given before" in remarks[-1]
    # Another setting is another question, and there the package is needed.
    assert "pip install 'causal-openlock[llm]'" in refused(temperature=0.5)


def test_a_transcript_of_results_is_a_replay_to_which_nothing_is_added(
    play, refused, tmp_path, monkeypatch
):
    _, record, said, _ = play(subjects=2)
    folder = tmp_path / "transcripts"
    folder.mkdir()
    lines = [json.dumps({"subject": 0, **line}) for transcript in said for line in transcript]
    (folder / "cell.jsonl").write_text("\n".join([*lines, '{"cut off']))
    monkeypatch.setenv(FOLDER, str(folder))
    model, again, *_ = play(subjects=2)
    assert (again, model.asked) == (record, [])
    (tmp_path / "experiment.json").touch()
    assert str(folder) in refused(subjects=2, temperature=0.4)
    assert [*folder.iterdir()] == [folder / "cell.jsonl"]


WHOLE = {"message": {"content": "push \ud800"}, "finish": "stop", "tokens": [5, 2], "latency": 0.5}
NO_REPLIES = [{"message": {}, "tokens": [5, 2]}, WHOLE | {"message": "push"}]
NO_REPLIES += [WHOLE | {"latency": float("nan")}, WHOLE | {"tokens": [5]}]


def test_damaged_lines_are_passed_over(tmp_path, monkeypatch):
    """The folder may be somebody else's: what is no whole reply was never given."""
    monkeypatch.setenv(FOLDER, str(tmp_path))
    kept = [{"key": str(i), "reply": reply} for i, reply in enumerate([WHOLE, *NO_REPLIES])]
    lines = [json.dumps(line) + "\n" for line in [*kept, {"key": "two"}]]
    (tmp_path / "said.jsonl").write_text("".join(lines))
    (reply,) = Replies(dict)._kept.values()
    assert reply["message"] == {"content": "push ?"}


def test_requests_are_limited_and_names_order_and_stories_differ_between_subjects(play):
    model, _, said, _ = play(subjects=12, attempts=1, requests=3)
    assert model.most == 3
    heads = [head for head, *_ in said]
    assert {head["story"] for head in heads} == {"levers", "switches", "symbols"}
    assert len({tuple(head["names"]) for head in heads}) == 12
    assert len({tuple(head["order"]) for head in heads}) == 12


def declared(folder, **parameters):
    """An experiment with a single attempt, two subjects in a cell."""
    chosen = {"model": "scripted", "base_url": URL, **parameters}
    (folder / "words.yaml").write_text(
        "{name: words, seed: 1, subjects: 3, cell_size: 2, conditions: [CC3], "
        "protocols: {short: {based_on: human, attempt_limit: 1, baseline_trials: 1}}, "
        f"learners: [{{learner: llm, protocol: short, parameters: {json.dumps(chosen)}}}]}}"
    )
    return read_experiment(folder / "words.yaml")


def test_what_was_said_is_in_the_results_and_in_their_bundle(scripted, tmp_path, monkeypatch):
    monkeypatch.setenv(KEY, SECRET)
    monkeypatch.setenv(TRUSTED, URL)
    scripted(lambda body, n: says("Hm.") if n == 0 else some_action(body, n))
    warned, out = [], tmp_path / "out"
    store = run(declared(tmp_path), out, workers=0, warn=warned.append)
    assert "llm: 1 answer was no action" in "".join(warned)
    paths = sorted((out / "transcripts").iterdir())
    lines = [json.loads(line) for path in paths for line in path.read_text().splitlines()]
    assert [line["subject"] for line in lines if "names" in line] == [0, 1, 2]
    assert sum(line.get("fault") == "malformed" for line in lines) == 1
    assert all(SECRET.encode() not in path.read_bytes() for path in out.rglob("*.*"))
    (out / "report.html").write_text("<html></html>")
    write_bundle(store, tmp_path / "out.zip")
    names = zipfile.ZipFile(tmp_path / "out.zip").namelist()
    assert sum(name.startswith("words/results/transcripts/llm_CC3_") for name in names) == 2
    # The report has the sums, whatever else is among the transcripts.
    for path in paths:
        path.write_bytes(path.read_bytes() + b'{"answers": -1}\n\xff\n[]\n')
    row = section_on(language_models.TOPIC, Results.read(out)).tables[0].rows[0]
    assert (row[:6], row[7:]) == (["llm", "CC3", "3", "10", "1,000", "50"], ["1", "0", "0"])


class Killed(Stopped):
    """Stands for the end of a process."""


@pytest.mark.parametrize("end", [1, 2, 3])
def test_a_killed_cell_continues_and_sends_no_request_twice(end, scripted, tmp_path, monkeypatch):
    def played(model, folder):
        said = play_cell(cell, str(tmp_path / folder), Watching(checkpoint_every=0))
        assert "begins again" not in str(said)
        store = Store(tmp_path / folder)
        (transcript,) = (store.folder / "transcripts").iterdir()
        lines = re.sub(r'"latency": [0-9.e-]+', "", transcript.read_text())
        return lines, store.read(store.path(cell)).drop_columns("wall_time"), len(model.asked)

    def killed(descriptor):
        if next(syncs) == end:
            raise Killed(9)

    (cell, _), syncs = declared(tmp_path).cells(), itertools.count(1)
    model = scripted()
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", killed)
        with pytest.raises(Killed):
            played(model, "killed")
    *found, asked = played(model, "killed")
    monkeypatch.setenv(FOLDER, str(tmp_path / "another"))
    *expected, whole = played(scripted(), "whole")
    assert (found[0], asked) == (expected[0], whole)
    assert found[1].equals(expected[1])


def test_a_server_that_is_away_can_be_tried_again_and_again(scripted, tmp_path):
    away, out, warned = declared(tmp_path, retries=0), tmp_path / "out", []
    scripted(lambda *_: CUT)
    for _ in range(4):
        with pytest.raises(CellsFailed, match="cut") as error:
            run(away, out, workers=0)
        assert "retry-failed" not in str(error.value)
    scripted(lambda *_: says("hello"))
    run(away, out, workers=0)
    assert not Results.read(out).trials["solved"].any()
    # A repetition says that nobody was asked.
    scripted(lambda *_: CUT)
    run(away, tmp_path / "again", workers=0, warn=warned.append)
    assert "answers had been given before" in warned[-1]
