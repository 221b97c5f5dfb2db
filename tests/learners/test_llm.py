"""A language model as a subject, over a server whose model follows a script."""

from __future__ import annotations

import builtins
import doctest
import json
import sys
import zipfile
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causal_openlock.analysis.topics import language_models
from causal_openlock.comparison.results import Results
from causal_openlock.contract.registry import create
from causal_openlock.errors import CellsFailed, LearnerError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.export.bundle import write_bundle
from causal_openlock.render.words import Wording
from causal_openlock.running.runner import run
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout
from openlock_learners.language import offered_actions as answers
from openlock_learners.language.kept_replies import BUDGET, FOLDER, Replay
from openlock_learners.language.offered_actions import read_answer, read_structure
from openlock_learners.language.server import KEY, TRUSTED
from support.scripted_server import (
    Body,
    Cut,
    Drip,
    Script,
    Status,
    call,
    choices,
    says,
    scripted,
    some_action,
)
from support.topics import section_on

pytestmark = pytest.mark.slow

CC3 = find_schema("CC3")
LAYOUT = Layout.of(CC3, "trial1")
ONE_ROOM = Condition("room", (Trials(CC3, (LAYOUT,)),))
TWO_ROOMS = Condition("rooms", (Trials(CC3, (LAYOUT, Layout.of(CC3, "trial2")), shuffle=False),))
SECRET = "sk-very-secret-0123"
SOON = {"retry_after_ms": "1"}
WHOLE = {"message": {"content": "push"}, "finish": "stop", "tokens": [5, 2], "latency": 0.5}


@pytest.fixture(autouse=True)
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    for name in (KEY, TRUSTED, BUDGET):
        monkeypatch.delenv(name, raising=False)
    # Pauses between tries are the library's; here they only cost time.
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.001)


def protocol(attempts: int = 2, trials: int = 1) -> Protocol:
    return Protocol("t", attempts, stop_when_solved=True, baseline_trials=trials)


def made(url: str, **parameters: Any) -> Any:
    given = {"model": "scripted", "base_url": url, **parameters}
    return create("openlock_learners.llm:LanguageModel", given)


def declared(folder: Path, url: str, subjects: int, **parameters: Any) -> Experiment:
    """An experiment with a single attempt, two subjects in a cell, as its file declares it."""
    (folder / "words.yaml").write_text(
        f"{{name: words, seed: 1, subjects: {subjects}, cell_size: 2, conditions: [CC3], "
        "protocols: {short: {based_on: human, attempt_limit: 1, baseline_trials: 1}}, "
        "learners: [{learner: llm, protocol: short, parameters: "
        f"{json.dumps({'model': 'scripted', 'base_url': url, **parameters})}}}]}}"
    )
    return read_experiment(folder / "words.yaml")


def play(
    script: Script = some_action,
    *,
    subjects: Any = 1,
    attempts: int = 2,
    condition: Condition = ONE_ROOM,
    **parameters: Any,
) -> tuple[Any, Any, list[Any], tuple[str, ...]]:
    """The server, the record as rows, the transcripts and the remarks."""
    trials = 2 if condition is TWO_ROOMS else 1
    with scripted(script) as (server, url):
        learner = made(url, **parameters)
        session = Session(condition, protocol(attempts, trials), subjects, learner="llm")
        record = session.play(learner).drop_columns(["wall_time"]).to_pylist()
    account = learner.account()
    return server, record, [*account.transcripts], account.remarks


def actions(record: list[dict[str, Any]]) -> list[int]:
    return [action for row in record for action in row["actions"]]


def test_it_is_told_what_a_person_is_told_and_its_calls_are_its_actions() -> None:
    server, record, (said,), remarks = play(story="switches")
    head, *lines, _ = said
    words = Wording(head["story"], tuple(head["names"]), tuple(head["order"]))
    asked = server.asked[0]
    assert words.instructions(3, 2) in asked["messages"][0]["content"]
    assert choices(asked) == words.choices
    assert (asked["model"], asked["temperature"], asked["seed"]) == (
        "scripted", 1.0, head["seed"],
    )  # fmt: skip
    done = [
        choices(body).index(_called(line)) for body, line in zip(server.asked, lines, strict=True)
    ]
    named = [words.actions.index(words.choices[place]) for place in done]
    assert actions(record) == named
    assert len(named) == 6
    assert not remarks
    # A call is followed by its result, which says what it did.
    first, call_, result = server.asked[1]["messages"]
    assert first["role"] == "user"
    assert call_["tool_calls"][0]["id"] == result["tool_call_id"]
    assert "Left:" in result["content"]


def _called(line: dict[str, Any]) -> str:
    function = line["reply"]["message"]["tool_calls"][0]["function"]
    return json.loads(function["arguments"])["action"]


def test_all_is_kept_of_each_answer() -> None:
    _, _, (said,), _ = play()
    head, *lines, _ = said
    assert head["tokens"] == [600, 30]
    assert head["model"] == "scripted"
    reply = lines[0]["reply"]
    assert (reply["model"], reply["server"], reply["fingerprint"]) == (
        "scripted-1", "Scripted/1", "fp_7",
    )  # fmt: skip
    assert reply["latency"] >= 0
    assert reply["retries"] == 0
    # The transcript is the whole conversation.
    told = [message["content"] for line in said[1:] for message in line["told"]]
    assert len(told) == 7
    assert told[-1].endswith(("stayed hidden.", "attempts."))
    assert told[0].startswith(("You", "Before"))


def test_names_and_order_and_stories_differ_between_subjects() -> None:
    _, _, said, _ = play(subjects=12, attempts=1)
    heads = [head for head, *_ in said]
    assert {head["story"] for head in heads} == {"levers", "switches", "symbols"}
    assert len({tuple(head["names"]) for head in heads}) == 12
    assert len({tuple(head["order"]) for head in heads}) == 12


def test_text_is_read_where_no_tool_is_called() -> None:
    def text(body: Body, number: int) -> Body:
        return says(f"Let me see.\n\n**{choices(body)[0]}**")

    server, record, (said,), remarks = play(text)
    head = said[0]
    assert set(actions(record)) == {head["order"][0]}
    assert not remarks
    assert server.asked[1]["messages"][1]["content"].startswith("Let me see.")


def test_without_tools_none_is_offered() -> None:
    server, record, _, _ = play(lambda body, _: says("push the door"), tools=False, story="levers")
    assert "tools" not in server.asked[0]
    assert set(actions(record)) == {14}


BAD: dict[str, tuple[Any, str]] = {
    "prose": (says("I would rather not say."), "malformed"),
    "nothing": (says(None), "malformed"),
    "two calls": (
        says("", tool_calls=[*call("push oak")["tool_calls"], *call("push elm")["tool_calls"]]),
        "malformed",
    ),
    "another tool": (call("push oak", name="open"), "malformed"),
    "no arguments": (
        says(None, tool_calls=[{"id": "1", "type": "function",
                                "function": {"name": "act", "arguments": "{oak"}}]),
        "malformed",
    ),
    "nested arguments": (
        says(None, tool_calls=[{"id": "1", "type": "function",
                                "function": {"name": "act", "arguments": "[" * 100_000}}]),
        "malformed",
    ),
    "half a sign": (says("No \ud800."), "malformed"),
    "another lever": (call("push the moon"), "out of range"),
    "refused": (says(None, refusal="I cannot help with locks."), "refused"),
}  # fmt: skip


@pytest.mark.parametrize("bad", BAD)
def test_what_is_no_action_is_named_and_asked_again(bad: str) -> None:
    message, fault = BAD[bad]

    def script(body: Body, number: int) -> Body:
        return message if number == 0 else some_action(body, number)

    server, record, (said,), remarks = play(script)
    assert [line["fault"] for line in said[1:3]] == [fault, None]
    assert said[0]["faults"] == {fault: 1}
    assert said[0]["unanswered"] == 0
    assert remarks == (f"1 answer was no action (1 {fault}); 0 actions stayed unanswered, and each "
                       "was spent on what changes nothing",)  # fmt: skip
    assert len(actions(record)) == 6
    complaint = server.asked[1]["messages"][-1]["content"]
    assert "The actions are:" in complaint
    # A call that is no proper one goes back as text, which every server takes.
    if fault != "out of range":
        assert "tool_calls" not in server.asked[1]["messages"][1]


def test_an_unanswered_action_changes_nothing_and_says_so() -> None:
    def script(body: Body, number: int) -> Body:
        return says("Hm.") if number < 3 else some_action(body, number)

    server, record, (said,), remarks = play(script, ask_again=2)
    spent = next(line for line in said if "unanswered" in line and "asked" not in line
                 and "tokens" not in line)  # fmt: skip
    assert record[0]["moved"][0] is False
    assert spent["unanswered"].startswith("pull_")
    assert "this one is spent" in server.asked[3]["messages"][-1]["content"]
    assert "1 action stayed unanswered" in remarks[0]


def test_too_many_unanswered_actions_are_an_error_that_counts_them() -> None:
    with pytest.raises(LearnerError, match=r"left 2 actions unanswered .*\(4 malformed\)"):
        play(lambda *_: says("Hm."), ask_again=1, unanswered=1)


@pytest.mark.parametrize(
    "trouble",
    [Status(429, **SOON), Status(503), Status(500, "<html>"), Cut(), Drip()],
    ids=["429", "503", "500", "cut", "drip"],
)
def test_trouble_passes_and_changes_nothing(trouble: Any) -> None:
    def script(body: Body, number: int) -> Any:
        return trouble if number in (0, 2) else some_action(body, number)

    stalls = isinstance(trouble, Drip)
    _, troubled, (said,), _ = play(script, seconds=0.3 if stalls else 60)
    _, plain, _, _ = play()
    assert troubled == plain
    first, second, *others = [line["reply"]["retries"] for line in said[1:-1]]
    if stalls:  # a busy machine may miss the limit again
        assert first
        assert second
    else:
        assert [first, second, *others] == [1, 1, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("trouble", "why"),
    [
        (Status(401, f'{{"error": {{"message": "no: {SECRET}"}}}}'), r"refuses .*\[key\]"),
        (Status(429, **SOON), "refuses"),
        (Cut(), "cannot be asked"),
        (Drip(), "did not answer in time"),
        (says("x", role=7) | {"content": SECRET}, None),
    ],
)
def test_trouble_that_stays_is_one_sentence_without_the_key(
    trouble: Any, why: str | None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(KEY, SECRET)
    with scripted(lambda *_: trouble) as (server, url):
        monkeypatch.setenv(TRUSTED, url)
        given = {"model": "m", "base_url": url, "retries": 1, "seconds": 0.2, "unanswered": 0}
        learner = create("openlock_learners.llm:LanguageModel", given)
        with pytest.raises(LearnerError, match=why or "unanswered") as raised:
            Session(ONE_ROOM, protocol(), 1).play(learner)
    assert server.keys[0] == f"Bearer {SECRET}"
    assert SECRET not in str(raised.value)
    kept = json.dumps(learner.account().transcripts)
    kept += "".join(path.read_text() for path in tmp_path.rglob("*.jsonl"))
    assert SECRET not in kept


def completion(message: str, **headers: str) -> Status:
    """A reply whose message is this text of JSON, escapes and all."""
    return Status(200, f'{{"choices": [{{"message": {message}}}]}}', **headers)


ESCAPED = "".join(f"\\u{ord(sign):04x}" for sign in SECRET)


@pytest.mark.parametrize(
    "said",
    [
        completion('{"content": "no"}', Server=f"proxy of {SECRET}"),
        completion(f'{{"content": "{ESCAPED}", "{ESCAPED}": [["{ESCAPED}"]]}}'),
        *(
            Status(400, json.dumps({"error": {"message": "x" * many + SECRET}}))
            for many in range(160, 185, 6)
        ),
    ],
    ids=["header", "escaped", *(f"cut {many}" for many in range(160, 185, 6))],
)
def test_no_part_of_the_key_is_kept_however_it_comes_back(
    said: Status, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv(KEY, SECRET)
    with scripted(lambda *_: said) as (_, url):
        monkeypatch.setenv(TRUSTED, url)
        learner = create("openlock_learners.llm:LanguageModel", {"model": "m", "base_url": url,
                                                        "unanswered": 0})  # fmt: skip
        with pytest.raises(LearnerError, match=r"unanswered|\[ke|xxx( …)?\)") as raised:
            Session(ONE_ROOM, protocol(), 1).play(learner)
    account = json.dumps([learner.account().transcripts, learner.state_dict()])
    kept = account + "".join(path.read_text() for path in tmp_path.rglob("*.jsonl"))
    assert SECRET[:5] not in f"{raised.value} {kept}"
    assert ("[key]" in kept) == (said.code == 200)


@pytest.mark.parametrize("key", ["sk-very\nsecret", "sk-very\x1bsecret", "sk-very-sécret"])
def test_a_key_that_no_header_can_hold_is_not_shown(
    key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with scripted() as (server, url):
        monkeypatch.setenv(TRUSTED, url)
        learner = create("openlock_learners.llm:LanguageModel", {"model": "m", "base_url": url})
        monkeypatch.setenv(KEY, key)
        with pytest.raises(LearnerError, match="is not a key") as raised:
            Session(ONE_ROOM, protocol(), 1).play(learner)
        assert "cret" not in str(raised.value)
        monkeypatch.setenv(KEY, f"{SECRET}\n")  # as a file ends
        Session(ONE_ROOM, protocol(), 1).play(learner)
    assert set(server.keys) == {f"Bearer {SECRET}"}


def test_headers_of_the_environment_go_only_where_it_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_CUSTOM_HEADERS", f"Authorization: {SECRET}")
    server, *_ = play()
    assert not any(SECRET in str(key) for key in server.keys)
    with scripted() as (server, url):
        monkeypatch.setenv(TRUSTED, url)
        learner = create(
            "openlock_learners.llm:LanguageModel",
            {"model": "m", "base_url": url, "temperature": 0.5},
        )
        Session(ONE_ROOM, protocol(), 1).play(learner)
    assert set(server.keys) == {SECRET}


def test_the_key_goes_only_where_the_environment_says(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY, SECRET)
    server, *_ = play()
    assert not any(SECRET in str(key) for key in server.keys)


def test_there_is_no_server_without_a_key_or_a_model(monkeypatch: pytest.MonkeyPatch) -> None:
    session = Session(ONE_ROOM, protocol(), 1)
    with pytest.raises(LearnerError, match="set OPENAI_API_KEY in the environment"):
        session.play(create("openlock_learners.llm:LanguageModel", {"model": "m"}))
    with pytest.raises(LearnerError, match="needs the name of a model"):
        session.play(create("openlock_learners.llm:LanguageModel", {}))
    monkeypatch.setenv(TRUSTED, "http://host:99999/v1")
    with pytest.raises(
        LearnerError, match="in the environment is not an address: http://host:99999"
    ):
        session.play(create("openlock_learners.llm:LanguageModel", {"model": "m"}))


@pytest.mark.parametrize(
    ("parameters", "why"),
    [
        ({"base_url": "http://me:key@host/v1"}, "cannot hold a key"),
        ({"base_url": "host"}, "is the address of a server"),
        ({"base_url": "http://h:99999/v1"}, "is the address of a server"),
        ({"base_url": "http://h:port/v1"}, "is the address of a server"),
        ({"settings": {"messages": []}}, "cannot hold 'messages'"),
        ({"settings": {"top_p": float("inf")}}, "and no infinity"),
        ({"temperature": float("inf")}, "should be a finite number"),
    ],
)
def test_parameters_that_cannot_be(parameters: dict[str, Any], why: str) -> None:
    with pytest.raises(LearnerError, match=why):
        create("openlock_learners.llm:LanguageModel", parameters)


def test_a_repetition_asks_nobody_and_is_the_same_byte_for_byte(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def luck(body: Body, number: int) -> Body:  # a model at a high temperature
        return call(choices(body)[number % 15])

    _, record, said, _ = play(luck, subjects=3)
    real = builtins.__import__

    def absent(name: str, *rest: Any, **named: Any) -> Any:
        if name.startswith(("openai", "openlock_learners.language.server")):
            raise ImportError(name)
        return real(name, *rest, **named)

    monkeypatch.delitem(sys.modules, "openlock_learners.language.server")
    monkeypatch.setattr(builtins, "__import__", absent)
    server, again, told, _ = play(subjects=3)
    assert not server.asked
    assert again == record
    for one in (said, told):
        for head, *_ in one:
            del head["base_url"]  # which has another port
    assert json.dumps(told) == json.dumps(said)
    # Another setting is another question, and there the package is needed.
    with pytest.raises(LearnerError, match=r"pip install 'causal-openlock\[llm\]'"):
        play(temperature=0.5)


def conversation(
    done: list[int], asked: Container[int], tools: bool
) -> tuple[Wording, list[dict[str, Any]], list[int]]:
    """What a subject was told that did this, and was asked before some of it; and its answers."""

    def script(body: Body, number: int) -> Body:
        return call(choices(body)[len(body["messages"]) % 15]) if tools else says("push the door")

    with scripted(script) as (_, url):
        learner = made(url, story="levers", tools=tools)
        session = Session(ONE_ROOM, protocol(2), 1, learner="llm")
        learner.begin(session.brief)
        answers = []
        for moment, action in enumerate(done):
            if moment in asked:
                answers.append(int(learner.act(session.view)[0]))
            learner.learn(session.step(np.array([action])))
    (subject,) = learner._subjects
    for message in subject.talk:
        message.pop("tool_call_id", None)
        for one in message.get("tool_calls", []):
            del one["id"]
    return subject.words, subject.talk, answers


@pytest.mark.parametrize("tools", [True, False])
def test_in_another_s_place_it_is_told_what_that_one_did(tools: bool) -> None:
    _, _, answers = conversation([14] * 6, range(6), tools)
    _, own, again = conversation(answers, range(6), tools)
    assert again == answers
    _, watched, _ = conversation(answers, (), tools)
    assert watched == own
    # It answers something else, and is not always asked.
    words, told, _ = conversation([1, 2, 3], (1,), tools)
    said = [json.dumps(message) for message in told if message["role"] == "assistant"]
    assert len(said) == 3
    assert all(words.actions[action] in one for action, one in zip((1, 2, 3), said, strict=True))
    assert told[0] == own[0]


def test_a_transcript_of_results_is_a_replay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, record, said, _ = play(subjects=2)
    folder = tmp_path / "transcripts"
    folder.mkdir()
    lines = [json.dumps({"subject": 0, **line}) for one in said for line in one]
    (folder / "cell.jsonl").write_text("\n".join([*lines, '{"cut off']))
    monkeypatch.setenv(FOLDER, str(folder))
    server, again, *_ = play(subjects=2)
    assert (again, server.asked) == (record, [])
    # What is missing there is not added to results.
    (tmp_path / "experiment.json").touch()
    with pytest.raises(LearnerError, match="belongs to results, to which no replies are added"):
        play(subjects=2, temperature=0.4)
    assert [*folder.iterdir()] == [folder / "cell.jsonl"]


@pytest.mark.parametrize(
    "damaged",
    [
        {"key": ["a", "list"], "reply": WHOLE},
        {"key": "one", "reply": {"message": {}, "tokens": [5, 2]}},
        {"key": "one", "reply": WHOLE | {"message": "push"}},
        {"key": "one", "reply": WHOLE | {"finish": ["stop"]}},
        {"key": "one", "reply": WHOLE | {"latency": "soon"}},
        {"key": "one", "reply": WHOLE | {"latency": float("nan")}},
        {"key": "one", "reply": WHOLE | {"tokens": "x"}},
        {"key": "one", "reply": WHOLE | {"tokens": [5]}},
        {"key": "one", "reply": WHOLE | {"tokens": [-5, "2"]}},
    ],
)
def test_a_damaged_line_is_passed_over(tmp_path: Path, damaged: dict[str, Any]) -> None:
    """The folder may be somebody else's: what is no whole reply was never given."""
    lines = [damaged, {"key": "two", "reply": WHOLE}]
    (tmp_path / "said.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    kept = Replay(tmp_path)
    kept.refresh()
    assert (kept.get("one"), kept.get("two"), kept.spent) == (None, WHOLE, 7)


def test_a_reply_of_endlessly_many_tokens_is_none() -> None:
    body = '{"choices": [{"message": {}}], "usage": {"prompt_tokens": Infinity}}'
    with pytest.raises(LearnerError, match="gives no chat completion"):
        play(lambda *_: Status(200, body))


def test_a_kept_reply_with_half_a_sign_is_mended(tmp_path: Path) -> None:
    reply = WHOLE | {"message": {"content": "push \ud800"}}
    (tmp_path / "said.jsonl").write_text(json.dumps({"key": "one", "reply": reply}) + "\n")
    kept = Replay(tmp_path)
    kept.refresh()
    assert kept.get("one") == WHOLE | {"message": {"content": "push ?"}}


@pytest.mark.parametrize("levels", [150, 400, 100_000])
def test_what_is_nested_too_deeply_is_no_reply_and_is_not_kept(levels: int, tmp_path: Path) -> None:
    """A reply of some hundred levels can be read, but not written with the conversation."""
    nested = f'{{"content": "no", "more": {"[" * levels}{"]" * levels}}}'
    with pytest.raises(
        LearnerError, match=r"gives no chat completion \(\{.*\); what was answered is kept"
    ):
        play(lambda *_: completion(nested))
    assert not [*tmp_path.rglob("*.jsonl")]
    # Nor is one used that is in a folder all the same.
    kept = json.dumps({"key": "one", "reply": WHOLE}).replace('{"content": "push"}', nested)
    (tmp_path / "said.jsonl").write_text(f"{kept}\n")
    replies = Replay(tmp_path)
    replies.refresh()
    assert replies.get("one") is None


def test_a_budget_stops_between_attempts_and_a_larger_one_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _, whole, _, _ = play(attempts=4, temperature=0.2)
    monkeypatch.setenv(BUDGET, str(12 * 105 + 400))  # the first play's, and four answers more
    with scripted() as (server, url):
        learner = made(url, temperature=0.3)
        session = Session(ONE_ROOM, protocol(4), 1, learner="llm")
        with pytest.raises(LearnerError, match=r"1,890 of 1,660 tokens \(OPENLOCK_LLM_BUDGET\)"):
            session.play(learner)
    assert len(server.asked) == 6  # two whole attempts
    monkeypatch.setenv(BUDGET, "100000")
    server, record, _, _ = play(attempts=4, temperature=0.3)
    assert len(server.asked) == 6  # the other two
    assert len(actions(record)) == len(actions(whole)) == 12
    monkeypatch.setenv(BUDGET, "much")
    with pytest.raises(LearnerError, match="is a number of tokens, and this is 'much'"):
        play(temperature=0.4)


def test_without_counted_tokens_no_budget_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    body = {"choices": [{"message": call("push the door"), "finish_reason": "stop"}]}
    answer = Status(200, json.dumps(body))
    server, *_ = play(lambda *_: answer)
    assert len(server.asked) == 18  # which is no action in every story, and is asked again
    monkeypatch.setenv(BUDGET, "100000")
    with pytest.raises(LearnerError, match="does not say how many tokens it took"):
        play(lambda *_: answer, temperature=0.5)


def test_no_more_requests_than_the_limit_are_under_way() -> None:
    import time

    def slow(body: Body, number: int) -> Body:
        time.sleep(0.02)
        return some_action(body, number)

    server, *_ = play(slow, subjects=6, attempts=1, requests=3)
    assert server.most == 3


def test_it_is_reminded_of_recent_answers_alone() -> None:
    server, *_ = play(attempts=3, recent=2)
    lengths = [len(body["messages"]) for body in server.asked]
    assert lengths == [1, 3, 5, 5, 5, 5, 5, 5, 5]
    last = server.asked[-1]["messages"]
    assert "left out" in last[0]["content"]
    roles = [message["role"] for message in last]
    assert roles == ["user", "assistant", "tool", "assistant", "tool"]


def test_it_is_asked_which_enables_which_and_plays_as_if_it_were_not() -> None:
    def script(body: Body, number: int) -> Body:
        if "response_format" not in body:
            return some_action({k: v for k, v in body.items() if k != "seed"}, 0)
        pair = body["response_format"]["json_schema"]["schema"]["properties"]["enables"]["items"]
        cause, effect = (pair["properties"][of]["enum"] for of in ("cause", "effect"))
        return says(json.dumps({"enables": [{"cause": cause[0], "effect": effect[-1]}]}))

    _, plain, _, _ = play(script, condition=TWO_ROOMS)
    server, asked, (said,), _ = play(script, condition=TWO_ROOMS, ask_structure=True)
    assert plain == asked
    answers = [line for line in said if line.get("asked") == "structure"]
    assert [line["trial"] for line in answers] == [1, 2]
    assert answers[0]["enables"] == [["UPPERRIGHT", "door"]]
    assert "another one could be moved" in answers[0]["told"][0]["content"]
    question = next(body for body in server.asked if "response_format" in body)
    assert question["tool_choice"] == "none"


def test_an_answer_to_which_enables_which_that_cannot_be_read_is_none() -> None:
    words, nodes = Wording("levers", ("oak", "elm"), (0, 1)), ("P0", "P1", "door")
    for said in (
        "[" * 100_000,
        "<think>" * 14_000,
        "```" + " " * 100_000 + "x",
        "no",
        "[]",
        '{"enables": [{"cause": "oak", "effect": "moon"}]}',
        "{}",
        "7",
    ):
        assert read_structure({"content": said}, words, nodes) is None
    assert read_answer({"content": ["odd"], "tool_calls": "odd"}, None, words).fault == "malformed"


def test_what_was_said_is_in_the_results_and_in_their_bundle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(KEY, SECRET)
    with scripted(lambda body, n: says("Hm.") if n == 0 else some_action(body, n)) as (_, url):
        monkeypatch.setenv(TRUSTED, url)
        experiment = declared(tmp_path, url, subjects=3)
        warned: list[str] = []
        store = run(experiment, tmp_path / "out", workers=0, warn=warned.append)
    assert len(warned) == 1
    assert "llm: 1 answer was no action (1 malformed); 0 actions stayed" in warned[0]
    out = tmp_path / "out"
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
    assert shown is not None
    assert len(shown.text) == 1
    assert shown.tables[0].rows[0][:6] == ["llm", "CC3", "3", "10", "1,000", "50"]
    assert shown.tables[0].rows[0][7:] == ["1", "0", "0"]


def test_a_server_that_is_away_can_be_tried_again_and_again(tmp_path: Path) -> None:
    with scripted(lambda *_: says("hello")) as (_, url):
        experiment = declared(tmp_path, url, subjects=1, retries=0)
        nobody = f"{url.rpartition(':')[0]}:9/v1"
        away = declared(tmp_path, nobody, subjects=1, retries=0)
        for _ in range(4):
            with pytest.raises(CellsFailed, match="cannot be asked") as error:
                run(away, tmp_path / "out", workers=0)
            assert "retry-failed" not in str(error.value)
        warned: list[str] = []
        run(experiment, tmp_path / "out", workers=0, warn=warned.append)
    (silent,) = section_on(language_models.TOPIC, Results.read(tmp_path / "out")).text[1:]  # type: ignore[union-attr]
    assert "3 actions of llm. How these learners fare" in silent
    # A repetition says that nobody was asked.
    run(away, tmp_path / "again", workers=0, warn=warned.append)
    assert "9 answers had been given before" in warned[-1]


def test_a_budget_is_looked_at_when_a_request_has_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(BUDGET, "200")
    with scripted() as (server, url):
        learner = made(url, requests=1)
        session = Session(ONE_ROOM, protocol(), 20, learner="llm")
        with pytest.raises(LearnerError, match="210 of 200 tokens"):
            session.play(learner)
    assert len(server.asked) == 2


def test_nothing_is_asked_where_nothing_can_be_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "experiment.json").touch()
    monkeypatch.setenv(FOLDER, str(tmp_path / "transcripts"))
    with scripted() as (server, url):
        learner = made(url)
        with pytest.raises(LearnerError, match="belongs to results"):
            Session(ONE_ROOM, protocol(), 3, learner="llm").play(learner)
    assert not server.asked


def test_a_short_memory_makes_no_two_questions_one() -> None:
    server, _, (said,), _ = play(lambda *_: says("Hm."), attempts=1, recent=1)
    assert len(server.asked) == 9
    assert said[0]["answers"] == 9


@pytest.mark.parametrize(
    "body",
    [
        '{"choices": [{"message": {}}], "usage": {"prompt_tokens": -100}}',
        '{"choices": [{"message": {}, "finish_reason": 7}]}',
        '{"choices": [{"message": {"x": NaN}}]}',
    ],
)
def test_a_reply_that_could_not_be_kept_is_none(body: str, tmp_path: Path) -> None:
    with pytest.raises(LearnerError, match=r"gives no chat completion \(\{"):
        play(lambda *_: Status(200, body))
    assert not [*tmp_path.rglob("*.jsonl")]


def test_it_goes_nowhere_else_and_takes_no_endless_reply(monkeypatch: pytest.MonkeyPatch) -> None:
    with scripted() as (other, url):
        with pytest.raises(LearnerError, match="refuses"):
            play(lambda *_: Status(307, "", Location=f"{url}/chat/completions"))
        assert not other.asked
    monkeypatch.setattr("openlock_learners.language.server.LARGEST", 1000)
    with pytest.raises(LearnerError, match="too large"):
        play(lambda *_: says("a" * 2000), retries=0)


def test_what_else_is_secret_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_CUSTOM_HEADERS", f"X-Api-Key: {SECRET}")
    with scripted(lambda *_: says(f"You sent {SECRET}")) as (_, url):
        monkeypatch.setenv(TRUSTED, url)
        learner = made(url)
        session = Session(ONE_ROOM, protocol(1), 1, learner="llm")
        session.play(learner)
    assert SECRET not in json.dumps(learner.account().transcripts)


def test_without_tools_a_call_is_no_action() -> None:
    _, _, (said,), _ = play(lambda *_: call("push the door"), attempts=1, tools=False)
    assert said[0]["faults"] == {"malformed": 9}


def test_a_refusal_names_what_may_help() -> None:
    refused = Status(400, '{"error": {"message": "this model supports no tools"}}')
    with pytest.raises(LearnerError, match="perhaps it takes tools: false among the parameters"):
        play(lambda *_: refused)


def test_the_examples_come_out_as_shown() -> None:
    failed, tried = doctest.testmod(answers)
    assert (failed, tried > 0) == (0, True)
