"""A language model as a subject: a scripted one answers through a transport."""

import asyncio
import doctest
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
from causal_openlock.errors import CellsFailed, LearnerError
from causal_openlock.experiment.declare import Condition, Protocol, Trials
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.export.bundle import write_bundle
from causal_openlock.render.words import Wording
from causal_openlock.running.runner import run
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from causal_openlock.world.room import Layout
from openlock_learners.language import offered_actions, server
from openlock_learners.language.kept_replies import BUDGET, FOLDER, Replay, key_of
from openlock_learners.language.offered_actions import read_answer, read_structure
from openlock_learners.language.server import HEADERS, KEY, TRUSTED
from support.scripted_model import URL, ScriptedModel, call, choices, completion, says, some_action
from support.topics import section_on

CC3 = find_schema("CC3")
ROOMS = [Layout.of(CC3, "trial1"), Layout.of(CC3, "trial2")]
SECRET = "sk-very-secret-0123"
WHOLE = {"message": {"content": "push"}, "finish": "stop", "tokens": [5, 2], "latency": 0.5}
WORDS = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
NODES = ("P0", "P1", "P2", "door")
STRUCTURE = '{"enables": [{"cause": "oak", "effect": "the door"}]}'


@pytest.fixture(autouse=True)
def environment(tmp_path, monkeypatch):
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    for name in (KEY, TRUSTED, BUDGET, HEADERS):
        monkeypatch.delenv(name, raising=False)
    # Pauses between tries are the library's; here they only cost time.
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.001)
    monkeypatch.setattr(server, "TRANSPORT", None)


def scripted(script=some_action):
    """A model that is asked from now on."""
    server.TRANSPORT = ScriptedModel(script)
    return server.TRANSPORT


def session_of(subjects, attempts=2, rooms=1):
    condition = Condition("rooms", (Trials(CC3, tuple(ROOMS[:rooms]), shuffle=False),))
    protocol = Protocol("t", attempts, stop_when_solved=True, baseline_trials=rooms)
    return Session(condition, protocol, subjects, learner="llm")


def play(script=some_action, *, subjects=1, attempts=2, rooms=1, **parameters):
    """The model, the record as rows, the transcripts and the remarks."""
    model = scripted(script)
    learner = create("llm", {"model": "scripted", "base_url": URL, **parameters})
    record = (
        session_of(subjects, attempts, rooms).play(learner).drop_columns(["wall_time"]).to_pylist()
    )
    account = learner.account()
    return model, record, [*account.transcripts], account.remarks


def refused(script=some_action, **parameters):
    """Why a play fails, and the model."""
    with pytest.raises(LearnerError) as raised:
        play(script, **parameters)
    return str(raised.value), server.TRANSPORT


def actions(record):
    return [action for row in record for action in row["actions"]]


# -- what it is told, and what its answers are ----------------------------------------------------


def test_it_is_told_what_a_person_is_told_and_its_calls_are_its_actions():
    model, record, (said,), remarks = play(story="switches")
    head, *lines, _ = said
    words = Wording(head["story"], tuple(head["names"]), tuple(head["order"]))
    asked = model.asked[0]
    assert words.instructions(3, 2) in asked["messages"][0]["content"]
    assert choices(asked) == words.choices
    sent = asked["model"], asked["temperature"], asked["seed"]
    assert sent == ("scripted", 1.0, head["seed"])
    called = [line["reply"]["message"]["tool_calls"][0]["function"] for line in lines]
    chosen = [json.loads(function["arguments"])["action"] for function in called]
    assert actions(record) == [words.actions.index(name) for name in chosen]
    assert len(chosen) == 6
    assert not remarks
    # A call is followed by its result, which says what it did.
    first, call_, result = model.asked[1]["messages"]
    assert first["role"] == "user"
    assert call_["tool_calls"][0]["id"] == result["tool_call_id"]
    assert "Left:" in result["content"]
    # The transcript is the whole conversation, with what each answer took.
    assert (head["tokens"], head["model"], head["answers"]) == ([600, 30], "scripted", 6)
    kept = lines[0]["reply"]
    from_server = kept["model"], kept["server"], kept["fingerprint"], kept["retries"]
    assert from_server == ("scripted-1", "Scripted/1", "fp_7", 0)
    told = [message["content"] for line in said[1:] for message in line["told"]]
    assert len(told) == 7
    assert told[0] == first["content"]


def first(body):
    return choices(body)[0]


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
    "content in parts": lambda body, _: says(
        [{"type": "thinking", "thinking": []}, {"type": "text", "text": first(body)}]
    ),
    "a thought": lambda body, _: says(f"<think>\nhm\n</think>\n{first(body)}"),
}


@pytest.mark.parametrize("habit", HABITS)
def test_an_action_is_read_however_a_server_writes_it(habit):
    model, record, (said,), remarks = play(HABITS[habit])
    assert said[0]["faults"] == {}
    assert set(actions(record)) == {said[0]["order"][0]}
    assert not remarks
    for message in model.asked[-1]["messages"]:
        for one in message.get("tool_calls", ()):
            assert isinstance(one["function"]["arguments"], str)


def test_without_tools_none_is_offered_and_a_call_is_no_action():
    model, record, _, _ = play(lambda *_: says("push the door"), tools=False, story="levers")
    assert "tools" not in model.asked[0]
    assert set(actions(record)) == {14}
    _, _, (said,), _ = play(lambda *_: call("push the door"), attempts=1, tools=False)
    assert said[0]["faults"] == {"malformed": 9}


BAD = {
    "prose": (says("I would rather not say."), "malformed"),
    "two calls": (says("", tool_calls=2 * call("push oak")["tool_calls"]), "malformed"),
    "nested": (with_arguments(lambda _: "[" * 100_000), "malformed"),
    "half a sign": (says("No \ud800."), "malformed"),
    "another lever": (call("push the moon"), "out of range"),
    "refused": (says(None, refusal="I cannot help with locks."), "refused"),
    "cut off": (completion(says("push oak"), "length"), "cut off"),
    "still thinking": (says("<think>\nI could begin with\npush oak"), "cut off"),
}


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_action_has_a_name_and_is_asked_again(bad):
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


def test_an_unanswered_action_changes_nothing_and_too_many_are_an_error():
    def script(body, number):
        return says("Hm.") if number < 3 else some_action(body, number)

    model, record, (said,), remarks = play(script, ask_again=2)
    assert record[0]["moved"][0] is False
    assert said[0]["unanswered"] == 1
    assert next(line["unanswered"] for line in said[1:] if "unanswered" in line).startswith("pull_")
    told = ["this one is spent" in body["messages"][-1]["content"] for body in model.asked[3:5]]
    assert told == [True, False]
    assert "1 action stayed unanswered" in remarks[0]
    said, model = refused(lambda *_: says("Hm."), ask_again=1, unanswered=1, recent=9)
    assert "left 2 actions unanswered" in said
    assert "4 malformed" in said


@pytest.mark.parametrize("tools", [True, False])
def test_in_the_place_of_another_it_is_told_what_that_one_did(tools):
    def conversation(done, asked):
        """What a subject was told that did this, and was asked before some of it; its answers."""
        scripted(
            lambda body, _: (
                call(choices(body)[len(body["messages"]) % 15]) if tools else says("push the door")
            )
        )
        learner = create("llm", {"model": "m", "base_url": URL, "story": "levers", "tools": tools})
        session = session_of(1)
        learner.begin(session.brief)
        answers = []
        for moment, action in enumerate(done):
            if moment in asked:
                answers.append(int(learner.act(session.view)[0]))
            learner.learn(session.step(np.array([action])))
        (transcript,) = learner.account().transcripts
        (subject,) = learner._subjects
        talk = subject.talk
        for message in talk:
            message.pop("tool_call_id", None)
            for one in message.get("tool_calls", []):
                del one["id"]
        words = Wording("levers", tuple(transcript[0]["names"]), tuple(transcript[0]["order"]))
        return words, talk, answers

    _, _, answers = conversation([14] * 6, range(6))
    _, own, again = conversation(answers, range(6))
    assert again == answers
    assert conversation(answers, ())[1] == own
    # It answers something else, and is not always asked.
    words, told, _ = conversation([1, 2, 3], (1,))
    said = [json.dumps(message) for message in told if message["role"] == "assistant"]
    assert [words.actions[a] in one for a, one in zip((1, 2, 3), said, strict=True)] == [True] * 3
    assert told[0] == own[0]


def test_it_is_reminded_of_recent_answers_alone():
    model, *_ = play(attempts=3, recent=2)
    assert [len(body["messages"]) for body in model.asked] == [1, 3, 5, 5, 5, 5, 5, 5, 5]
    last = model.asked[-1]["messages"]
    assert "left out" in last[0]["content"]
    roles = [message["role"] for message in last]
    assert roles == ["user", "assistant", "tool", "assistant", "tool"]
    # A short memory makes no two questions one.
    model, _, (said,), _ = play(lambda *_: says("Hm."), attempts=1, recent=1)
    assert (len(model.asked), said[0]["answers"]) == (9, 9)


def test_it_is_asked_which_enables_which_and_plays_as_if_it_were_not():
    def script(body, number):
        if "response_format" not in body:
            return some_action({k: v for k, v in body.items() if k != "seed"}, 0)
        pair = body["response_format"]["json_schema"]["schema"]["properties"]["enables"]["items"]
        cause, effect = (pair["properties"][of]["enum"] for of in ("cause", "effect"))
        return says(json.dumps({"enables": [{"cause": cause[0], "effect": effect[-1]}]}))

    _, plain, _, _ = play(script, rooms=2)
    model, asked, (said,), _ = play(script, rooms=2, ask_structure=True)
    assert plain == asked
    answers = [line for line in said if line.get("asked") == "structure"]
    assert [line["trial"] for line in answers] == [1, 2]
    assert answers[0]["enables"] == [["UPPERRIGHT", "door"]]
    question = next(body for body in model.asked if "response_format" in body)
    assert question["tool_choice"] == "none"
    _, _, (said,), remarks = play(ask_structure=True, temperature=0.5)  # a call is no structure
    assert said[0]["unreadable"] == 1
    assert "could not be read" in remarks[0]


def test_a_structure_is_read_or_is_none():
    for content in (STRUCTURE, f"<think>elm?</think>\n```json\n{STRUCTURE}\n```"):
        assert read_structure({"content": content}, WORDS, NODES) == [["P0", "door"]]
    for content in ("[" * 100_000, "<think>" * 14_000, "[]", STRUCTURE.replace("oak", "x")):
        assert read_structure({"content": content}, WORDS, NODES) is None


# -- a server in trouble --------------------------------------------------------------------------


CUT = httpx2.ReadError("the connection is cut")
BUSY = 200, json.dumps({"error": {"message": "slow down", "code": 503}}), {}


async def drip():
    """Blanks, now and then, and never an answer."""
    while True:
        await asyncio.sleep(0.02)
        yield b" "


@pytest.mark.parametrize(
    "trouble", [(429, "", {"retry-after-ms": "1"}), (503, "<html>", {}), CUT, BUSY], ids=str
)
def test_trouble_passes_and_changes_nothing(trouble):
    _, plain, _, _ = play(temperature=0.5)
    model, troubled, (said,), _ = play(lambda b, n: trouble if n in (0, 2) else some_action(b, n))
    assert len(troubled) == len(plain)
    assert len(model.asked) == 8
    assert model.asked[0] == model.asked[1]
    assert [line["reply"]["retries"] for line in said[1:-1]] == [1, 1, 0, 0, 0, 0]


def test_a_server_that_stalls_is_asked_again_after_the_time_limit():
    said, model = refused(lambda *_: (200, drip(), {}), seconds=0.1, retries=1)
    assert "in time" in said
    assert len(model.asked) == 2


ESCAPED = "".join(f"\\u{ord(sign):04x}" for sign in SECRET)


def raw(message, **more):
    return 200, json.dumps({"choices": [{"message": "?"}], **more}).replace('"?"', message), {}


@pytest.mark.parametrize(
    "said",
    [
        (401, f'{{"error": {{"message": "no: {SECRET}"}}}}', {}),
        (400, json.dumps({"error": {"message": "x" * 178 + SECRET}}), {}),  # where it is shortened
        (200, raw('{"content": "no"}')[1], {"Server": f"proxy of {SECRET}"}),
        raw(f'{{"content": "{ESCAPED}", "{ESCAPED}": [["{ESCAPED}"]]}}'),
    ],
)
@pytest.mark.parametrize("of", [KEY, HEADERS])
def test_no_part_of_a_secret_is_kept_however_it_comes_back(said, of, monkeypatch, tmp_path):
    monkeypatch.setenv(of, SECRET if of == KEY else f"X-Api-Key: {SECRET}")
    monkeypatch.setenv(TRUSTED, URL)
    model = scripted(lambda *_: said)
    learner = create("llm", {"model": "m", "base_url": URL, "retries": 1, "unanswered": 0})
    with pytest.raises(LearnerError) as raised:
        session_of(1).play(learner)
    assert SECRET in str([*model.requests[0].headers.items()])
    kept = json.dumps([learner.account().transcripts, str(learner.__getstate__())])
    kept += "".join(path.read_text() for path in tmp_path.rglob("*.jsonl"))
    assert SECRET[:5] not in f"{raised.value} {kept}"
    assert ("[key]" in kept) == (said[0] == 200)


def test_a_key_that_no_header_can_hold_is_not_shown(monkeypatch):
    monkeypatch.setenv(TRUSTED, URL)
    for key in ("sk-very\nsecret", "sk-very\x1bsecret", "sk-very-sécret"):
        monkeypatch.setenv(KEY, key)
        said, model = refused()
        assert KEY in said
        assert "cret" not in said
        assert not model.asked
    monkeypatch.setenv(KEY, f"{SECRET}\n")  # as a file ends
    assert play()[0].keys == {f"Bearer {SECRET}"}


def test_secrets_of_the_environment_go_only_where_it_says(monkeypatch):
    monkeypatch.setenv(KEY, SECRET)
    monkeypatch.setenv(HEADERS, f"X-Own: {SECRET}")
    for trusted in (None, "http://localhost:8001/v1", "https://localhost:8000/v1"):
        if trusted:
            monkeypatch.setenv(TRUSTED, trusted)
        (request, *_) = play(settings={"for": trusted})[0].requests
        assert SECRET not in str([*request.headers.items()])
    monkeypatch.setenv(TRUSTED, URL)
    (request, *_) = play()[0].requests
    assert request.headers["X-Own"] == SECRET
    assert request.headers["Authorization"] == f"Bearer {SECRET}"


def test_there_is_no_server_without_a_key_or_an_address(monkeypatch):
    assert KEY in refused(base_url="https://api.openai.com/v1")[0]
    monkeypatch.setenv(TRUSTED, "http://host:99999/v1")
    assert "http://host:99999/v1" in refused()[0]


@pytest.mark.parametrize(
    ("said", "words", "path"),
    [
        ((400, '{"error": {"message": "not none"}}', {}), "not none", "/v1"),
        ((404, "<html>404 page not found</html>", {}), "base_url is http://localhost:8000/v1", ""),
        ((404, "nothing", {}), "base_url", "/v1"),
        ((200, "<!doctype html>", {}), "base_url is http://localhost:8000/v1", ""),
        ((400, '{"error": {"message": "maximum context length"}}', {}), "recent: 20", "/v1"),
        ((400, '{"error": {"message": "no support for tools"}}', {}), "tools: false", "/v1"),
        ((307, "", {"Location": "http://else/v1"}), "307", "/v1"),
        (CUT, "the connection is cut", "/v1"),
        ((429, "", {"retry-after-ms": "1"}), "429", "/v1"),
    ],
)
def test_a_server_that_refuses_is_named_with_what_may_help(said, words, path):
    url = URL.removesuffix("/v1") + path
    told, model = refused(lambda *_: said, base_url=url, retries=0)
    assert f"the server at {url} " in told
    assert words in told
    assert len(model.asked) == 1  # a redirection is not followed


NESTED = f'{{"content": "no", "more": {"[" * 400}{"]" * 400}}}'


@pytest.mark.parametrize(
    "said",
    [
        raw("{}", usage={"prompt_tokens": float("inf")}),
        raw("{}", usage={"prompt_tokens": -100}),
        raw('{"x": NaN}'),
        raw(NESTED),
        (200, '{"choices": [{"message": {}, "finish_reason": 7}]}', {}),
        (200, "[]", {}),
    ],
)
def test_a_reply_that_could_not_be_kept_is_none(said, tmp_path):
    assert "no chat completion" in refused(lambda *_: said, retries=0)[0]
    assert not [*tmp_path.rglob("*.jsonl")]


def test_an_endless_reply_is_not_read_to_its_end():
    assert "too large" in refused(lambda *_: says("a" * server.LARGEST), retries=0)[0]


def test_fields_of_a_call_go_back_unless_the_server_refuses_them():
    """DeepSeek wants its reasoning, Gemini its thought's signature; others know no such fields."""

    def script(body, _):
        given = [one for one in body["messages"] if one["role"] == "assistant"]
        if any(("reasoning" in one) != wanted for one in given):
            return 400, '{"error": {"message": "property reasoning"}}', {}
        said = call(first(body))
        said["tool_calls"][0]["extra"] = {"signature": "c2ln"}
        return {**said, "reasoning": "hm"}

    for wanted, requests in ((True, 6), (False, 7)):  # the seventh is asked in vain
        model, _, (said,), _ = play(script, temperature=wanted / 2)
        assert (said[0]["faults"], len(model.asked)) == ({}, requests)
        for body in model.asked[-1:]:
            calls = [m["tool_calls"][0] for m in body["messages"] if m["role"] == "assistant"]
            assert ["extra" in one for one in calls] == [wanted] * 5


@pytest.mark.parametrize(("counted", "cut"), [(700, True), (10**6, False), (40, False)])
def test_a_server_that_cuts_prompts_is_named(counted, cut):
    def script(body, number):
        read = sum(len(str(one["content"])) for one in body["messages"]) // 4
        tokens = min(counted, read) if number else read  # some servers count what is new alone
        return completion(says(f"{'Well. ' * 300}\n{first(body)}"), "stop", tokens)

    assert any("recent" in remark for remark in play(script)[3]) == cut


def test_a_proxy_that_is_in_the_way_is_named_without_its_password(monkeypatch):
    monkeypatch.setenv("HTTP_PROXY", "http://me:secret@127.0.0.1:9")
    for name in ("NO_PROXY", "no_proxy", "http_proxy"):
        monkeypatch.delenv(name, raising=False)
    learner = create("llm", {"model": "m", "base_url": "http://models.invalid/v1", "retries": 0})
    with pytest.raises(LearnerError, match=r"127.0.0.1:9") as told:
        session_of(1).play(learner)
    assert "secret" not in str(told.value)


# -- what is kept ---------------------------------------------------------------------------------


def test_a_repetition_asks_nobody_and_is_the_same_byte_for_byte(monkeypatch):
    _, record, said, _ = play(lambda b, n: call(choices(b)[n % 15]), subjects=3)
    monkeypatch.setitem(sys.modules, "openlock_learners.language.server", None)
    model, again, told, remarks = play(subjects=3)
    assert not model.asked
    assert again == record
    assert json.dumps(told) == json.dumps(said)
    assert "18 answers had been given before" in remarks[-1]
    # Another setting is another question, and there the package is needed.
    assert "pip install 'causal-openlock[llm]'" in refused(temperature=0.5)[0]


def test_a_transcript_of_results_is_a_replay_to_which_nothing_is_added(tmp_path, monkeypatch):
    _, record, said, _ = play(subjects=2)
    folder = tmp_path / "transcripts"
    folder.mkdir()
    lines = [json.dumps({"subject": 0, **line}) for one in said for line in one]
    (folder / "cell.jsonl").write_text("\n".join([*lines, '{"cut off']))
    monkeypatch.setenv(FOLDER, str(folder))
    model, again, *_ = play(subjects=2)
    assert (again, model.asked) == (record, [])
    (tmp_path / "experiment.json").touch()
    said, model = refused(subjects=2, temperature=0.4)
    assert str(folder) in said
    assert not model.asked
    assert [*folder.iterdir()] == [folder / "cell.jsonl"]


@pytest.mark.parametrize(
    "damaged",
    [
        {"key": ["a", "list"], "reply": WHOLE},
        {"key": "one", "reply": {"message": {}, "tokens": [5, 2]}},
        *(
            {"key": "one", "reply": WHOLE | changed}
            for changed in (
                {"message": "push"},
                {"message": json.loads(NESTED)},
                {"finish": ["stop"]},
                {"latency": "soon"},
                {"latency": float("nan")},
                {"tokens": [5]},
                {"tokens": [-5, 2]},
            )
        ),
    ],
)
def test_a_damaged_line_is_passed_over(tmp_path, damaged):
    """The folder may be somebody else's: what is no whole reply was never given."""
    half = WHOLE | {"message": {"content": "push \ud800"}}
    lines = [{"key": "zero", "reply": half}, damaged, {"key": "two", "reply": half}]
    (tmp_path / "said.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    kept = Replay(tmp_path)
    kept.refresh()
    fixed = WHOLE | {"message": {"content": "push ?"}}
    assert [kept.get(key) for key in ("zero", "one", "two")] == [fixed, None, fixed]
    assert kept.spent == 14


def test_replies_of_the_last_release_are_found():
    """A key is made of what every server knows, as it was before fields were given back."""
    said = {**call("push oak"), "content": None, "reasoning_content": "hm"}
    now = read_answer(said, "tool_calls", WORDS).message
    assert now["reasoning_content"] == "hm"
    empty = read_answer(says(""), "stop", WORDS).message
    for one, before in ((now, {**call("push oak"), "content": ""}), (empty, says(""))):
        assert key_of({"messages": [one]}, 1, 1) == key_of({"messages": [before]}, 1, 1)


def test_a_budget_stops_between_attempts_and_a_larger_one_goes_on(monkeypatch):
    _, whole, _, _ = play(attempts=4, temperature=0.2)
    monkeypatch.setenv(BUDGET, str(12 * 105 + 400))  # the first play's, and four answers more
    said, model = refused(attempts=4, temperature=0.3)
    assert f"1,890 of 1,660 tokens ({BUDGET})" in said
    assert len(model.asked) == 6  # two whole attempts
    monkeypatch.setenv(BUDGET, "100000")
    model, record, _, _ = play(attempts=4, temperature=0.3)
    assert len(model.asked) == 6  # the other two
    assert len(actions(record)) == len(actions(whole)) == 12
    monkeypatch.setenv(BUDGET, "much")
    assert "'much'" in refused(temperature=0.4)[0]


def test_a_budget_counts_what_others_spent_when_a_request_has_its_turn(monkeypatch, tmp_path):
    monkeypatch.setenv(BUDGET, "200")
    monkeypatch.setenv(FOLDER, str(tmp_path / "other"))
    said, model = refused(subjects=20, requests=1)
    assert "210 of 200 tokens" in said
    assert len(model.asked) == 2
    # A server that counts none is an error, as no budget can be kept.
    monkeypatch.setenv(BUDGET, "100000")
    said, _ = refused(lambda *_: raw(json.dumps(call("push the door"))))
    assert BUDGET in said


def test_requests_are_limited_and_names_order_and_stories_differ_between_subjects():
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


def test_what_was_said_is_in_the_results_and_in_their_bundle(tmp_path, monkeypatch):
    monkeypatch.setenv(KEY, SECRET)
    monkeypatch.setenv(TRUSTED, URL)
    scripted(lambda body, n: says("Hm.") if n == 0 else some_action(body, n))
    warned, out = [], tmp_path / "out"
    store = run(declared(tmp_path), out, workers=0, warn=warned.append)
    assert len(warned) == 1
    assert "llm: 1 answer was no action" in warned[0]
    lines = [
        json.loads(line)
        for path in sorted((out / "transcripts").iterdir())
        for line in path.read_text().splitlines()
    ]
    assert [line["subject"] for line in lines if "names" in line] == [0, 1, 2]
    assert sum(line.get("fault") == "malformed" for line in lines) == 1
    assert all(SECRET.encode() not in path.read_bytes() for path in out.rglob("*.*"))
    (out / "report.html").write_text("<html></html>")
    write_bundle(store, tmp_path / "out.zip")
    names = zipfile.ZipFile(tmp_path / "out.zip").namelist()
    assert sum(name.startswith("words/results/transcripts/llm_CC3_") for name in names) == 2
    # The report has the sums, whatever else is among the transcripts.
    for path in (out / "transcripts").iterdir():
        path.write_bytes(path.read_bytes() + b'{"answers": -1}\n\xff\n[]\n')
    shown = section_on(language_models.TOPIC, Results.read(out))
    row = shown.tables[0].rows[0]
    assert (row[:6], row[7:]) == (["llm", "CC3", "3", "10", "1,000", "50"], ["1", "0", "0"])


class Killed(BaseException):
    """Stands for the end of a process."""


@pytest.mark.parametrize("end", [1, 2, 3])
def test_a_killed_cell_continues_and_sends_no_request_twice(end, tmp_path, monkeypatch):
    def played(model, folder):
        said = play_cell(cell, str(tmp_path / folder), Watching(checkpoint_every=0))
        assert "begins again" not in str(said)
        store = Store(tmp_path / folder)
        (transcript,) = (store.folder / "transcripts").iterdir()
        lines = re.sub(r'"latency": [0-9.e-]+', "", transcript.read_text())
        return lines, store.read(store.path(cell)).drop_columns("wall_time"), len(model.asked)

    def killed(descriptor):
        if next(syncs) == end:
            raise Killed

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


def test_a_server_that_is_away_can_be_tried_again_and_again(tmp_path):
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


def test_the_examples_come_out_as_shown():
    failed, tried = doctest.testmod(offered_actions)
    assert (failed, tried > 0) == (0, True)
