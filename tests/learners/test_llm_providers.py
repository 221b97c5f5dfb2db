"""Language models as providers really answer: each server here has one of their habits."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, NotAvailableError
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.render.words import Wording
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout
from openlock_learners.language.kept_replies import BUDGET, FOLDER, key_of
from openlock_learners.language.offered_actions import read_answer, read_structure
from openlock_learners.language.reply import was_cut
from openlock_learners.language.server import HEADERS, KEY, TRUSTED, Server
from support.scripted_server import Body, Ended, Script, Status, call, choices, says, scripted

CC3 = find_schema("CC3")
ROOM = Condition("room", (Trials(CC3, (Layout.of(CC3, "trial1"),)),))
WORDS = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
PROXIES = [f"{name}_proxy" for name in ("http", "https", "all", "no")]
NOTHING = Status(400, json.dumps({"error": {"message": "either content or tool_calls, not none"}}))


@pytest.fixture(autouse=True)
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(FOLDER, str(tmp_path / "replay"))
    for name in (KEY, TRUSTED, BUDGET, HEADERS, *PROXIES, *map(str.upper, PROXIES)):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.001)


def play(script: Script, path: str = "/v1", **parameters: Any) -> tuple[Any, Any]:
    """The server, and what was said, as one subject plays an attempt."""
    with scripted(script) as (server, url):
        given = {"model": "m", "base_url": url.removesuffix("/v1") + path, **parameters}
        learner = create("openlock_learners.llm:LanguageModel", given)
        short = Protocol("t", 2, stop_when_solved=True, baseline_trials=1)
        Session(ROOM, short, 1, learner="llm").play(learner)
    return server, learner.account()


def first(body: Body) -> str:
    return choices(body)[0]


def as_object(body: Body, _: int) -> Body:
    said = call(first(body))
    said["tool_calls"][0]["function"]["arguments"] = {"action": first(body)}
    return said


def twice_in_text(body: Body, _: int) -> Body:
    said = call(first(body))
    function = said["tool_calls"][0]["function"]
    function["arguments"] = json.dumps(function["arguments"])
    return said


def older(body: Body, _: int) -> Body:
    return {"role": "assistant", "function_call": call(first(body))["tool_calls"][0]["function"]}


def in_parts(body: Body, _: int) -> Body:
    thought = {"type": "thinking", "thinking": [{"type": "text", "text": "hm"}]}
    return says([thought, {"type": "text", "text": first(body)}])  # type: ignore[arg-type]


def tagged(opened: str, closed: str) -> Script:
    return lambda body, _: says(f"{opened}\nperhaps the other\n{closed}\n{first(body)}")


HABITS: dict[str, Script] = {
    "arguments as an object": as_object,
    "arguments twice in text": twice_in_text,
    "a call of the older interface": older,
    "content in parts": in_parts,
    "no list of calls": lambda body, _: says(first(body), tool_calls=None),
    "a thought": tagged("<think>", "</think>"),
    "a thought that began before": tagged("", "</think>"),
    "a thought in brackets": tagged("[THINK]", "[/THINK]"),
    "channels": tagged("<|channel|>analysis<|message|>", "<|end|><|channel|>final<|message|>"),
}


@pytest.mark.parametrize("habit", HABITS)
def test_a_proper_answer_is_read_however_it_is_written(habit: str) -> None:
    server, account = play(HABITS[habit])
    assert account.transcripts[0][0]["faults"] == {}
    assert len(server.asked) == 6
    assert not account.remarks
    for message in server.asked[-1]["messages"]:
        for one in message.get("tool_calls", ()):
            assert isinstance(one["function"]["arguments"], str)


@pytest.mark.parametrize(
    "said",
    [
        Ended(says("<think>\nI could begin with\npush oak"), "length"),
        Ended(says("<think>\nI could begin with\npush oak"), "stop"),
        Ended(says("push oak"), "length"),
        Ended(says(None, reasoning_content="push oak"), "length"),
        Ended(says("<|channel|>analysis<|message|>push oak"), "stop"),
        Ended(says("[THINK]push oak"), "stop"),
    ],
)
def test_the_last_line_of_a_thought_is_no_action(said: Ended) -> None:
    answer = read_answer(said.message, said.finish, WORDS)
    assert (answer.action, answer.fault) == (None, "cut off")


def test_who_is_cut_off_hears_what_helps() -> None:
    with pytest.raises(LearnerError, match=r"3 cut off.* larger max_tokens in settings"):
        play(lambda *_: Ended(says("<think>\nhm"), "length"), unanswered=0)


@pytest.mark.parametrize("extra", ["message", "call"])
def test_a_call_goes_back_with_all_its_own_fields(extra: str) -> None:
    """DeepSeek wants its reasoning, Gemini its thought's signature."""

    def script(body: Body, _: int) -> Any:
        given = [one for one in body["messages"] if one["role"] == "assistant"]
        parts = given if extra == "message" else [one["tool_calls"][0] for one in given]
        if any("extra" not in part for part in parts):
            return Status(400, '{"error": {"message": "must be passed back"}}')
        said = call(first(body))
        (said if extra == "message" else said["tool_calls"][0])["extra"] = {"signature": "c2ln"}
        return said

    server, account = play(script)
    assert account.transcripts[0][0]["faults"] == {}
    assert len(server.asked) == 6


def test_who_takes_no_other_fields_gets_none() -> None:
    def script(body: Body, _: int) -> Any:
        if any("reasoning" in one for one in body["messages"]):
            return Status(400, '{"error": {"message": "property reasoning is unsupported"}}')
        return {**call(first(body)), "reasoning": "hm"}

    server, account = play(script)
    assert account.transcripts[0][0]["faults"] == {}
    assert len(server.asked) == 7  # it is asked once in vain


def test_an_empty_answer_goes_back_with_words() -> None:
    def script(body: Body, number: int) -> Any:
        for one in body["messages"]:
            if one["role"] == "assistant" and not (one.get("content") or one.get("tool_calls")):
                return NOTHING
        return says("") if number == 1 else call(first(body))

    _, account = play(script)
    assert account.transcripts[0][0]["faults"] == {"malformed": 1}


@pytest.mark.parametrize(
    ("said", "words", "path"),
    [
        (NOTHING, r"not none\); what was answered", "/v1"),
        (Status(404, "<html>404 page not found</html>"), "perhaps base_url is .*/v1", ""),
        (Status(404, '{"detail": "Not Found"}'), "perhaps base_url is .*/api/v1", "/api"),
        (Status(404, "nothing"), "without /chat/completions", "/v1"),
        (Status(200, '{"error": "Unexpected endpoint"}'), "perhaps base_url is .*/v1", ""),
        (Status(200, "<!doctype html>"), "perhaps base_url is .*/v1", ""),
        (
            Status(400, '{"error": {"message": "maximum context length is 4096 tokens"}}'),
            "perhaps it takes recent: 20 among",
            "/v1",
        ),
        (
            Status(400, '{"error": {"message": "m does not support tools"}}'),
            "perhaps it takes tools: false",
            "/v1",
        ),
    ],
)
def test_a_refusal_says_what_may_help(said: Status, words: str, path: str) -> None:
    with pytest.raises(LearnerError, match=words):
        play(lambda *_: said, path)


@pytest.mark.parametrize("code", [429, 503])
def test_a_failure_that_is_said_with_200_is_asked_again(code: int) -> None:
    busy = Status(200, json.dumps({"error": {"message": "slow down", "code": code}}))
    server, account = play(lambda body, n: busy if n == 0 else call(first(body)))
    assert len(server.asked) == 7
    assert account.transcripts[0][1]["reply"]["retries"] == 1


def test_replies_of_the_last_release_are_found() -> None:
    """A key is made of what every server knows, as it was before fields were given back."""
    said = {**call("push oak"), "content": None, "reasoning_content": "hm"}
    now = read_answer(said, "tool_calls", WORDS).message
    before = {**call("push oak"), "content": ""}
    assert now["reasoning_content"] == "hm"
    assert len({key_of({"messages": [one]}, 1, 1) for one in (now, before)}) == 1
    empty = read_answer(says(""), "stop", WORDS).message
    assert empty["content"]
    assert len({key_of({"messages": [one]}, 1, 1) for one in (empty, says(""))}) == 1


STRUCTURE = '{"enables": [{"cause": "oak", "effect": "the door"}]}'


@pytest.mark.parametrize(
    "content",
    [
        STRUCTURE,
        f"<think>elm?</think>\n{STRUCTURE}",
        f"```json\n{STRUCTURE}\n```",
        [{"type": "thinking", "thinking": "hm"}, {"type": "text", "text": STRUCTURE}],
    ],
)
def test_a_structure_is_read_however_it_is_written(content: Any) -> None:
    found = read_structure({"content": content}, WORDS, ("P0", "P1", "P2", "door"))
    assert found == [["P0", "door"]]


def growing(limit: int) -> Iterator[tuple[int, int]]:
    for characters in range(2000, 20000, 1000):
        yield characters, min(limit, characters // 4)


@pytest.mark.parametrize(
    ("sizes", "cut"),
    [
        ([*growing(2048)], True),
        ([*growing(600)], True),
        ([*growing(10**6)], False),
        ([(size, 0) for size, _ in growing(9)], False),  # nothing is counted
        ([(size, 5) for size, _ in growing(9)], False),  # nor here
        ([(2000, 500), *((size, 40) for size, _ in growing(9))], False),  # what is new is counted
        ([(5000, 1200)] * 50, False),  # `recent` keeps it short
        ([], False),
    ],
)
def test_prompts_that_a_server_cuts_are_noticed(sizes: list[tuple[int, int]], cut: bool) -> None:
    assert was_cut(sizes) is cut


def test_a_server_that_cuts_prompts_is_named() -> None:
    def script(body: Body, _: int) -> Any:
        read = sum(len(str(one["content"])) for one in body["messages"]) // 4
        return Ended(says(f"{'Well. ' * 300}\n{first(body)}"), "stop", min(700, read))

    _, account = play(script)
    assert any("seems to have read only a part" in remark for remark in account.remarks)


# -- proxies and addresses ------------------------------------------------------------------------


def test_what_runs_here_is_asked_without_a_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    monkeypatch.setenv("ALL_PROXY", "socks5://127.0.0.1:9")
    server, _ = play(lambda body, _: call(first(body)))
    assert len(server.asked) == 6


def test_a_proxy_that_is_in_the_way_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://me:secret@127.0.0.1:9")
    learner = create(
        "openlock_learners.llm:LanguageModel",
        {"model": "m", "base_url": "http://models.invalid/v1", "retries": 0},
    )
    with pytest.raises(LearnerError, match=r"through the proxy 127.0.0.1:9 of") as told:
        Session(ROOM, Protocol("t", 1, True, 1), 1, learner="llm").play(learner)
    assert "secret" not in str(told.value)


def test_a_socks_proxy_that_cannot_be_used_is_a_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def absent(*_: Any, **__: Any) -> None:
        raise ImportError("Using SOCKS proxy, but the 'socksio' package is not installed.")

    monkeypatch.setattr("openlock_learners.language.server._Client.__init__", absent)
    with pytest.raises(NotAvailableError, match=r"unset ALL_PROXY.* install socksio"):
        Server("http://models.invalid/v1", 1.0, 0, 1)


def test_an_address_may_have_a_version_and_no_key() -> None:
    seen: list[str] = []
    make: Callable[[str], Any] = lambda url: create(  # noqa: E731
        "openlock_learners.llm:LanguageModel", {"model": "m", "base_url": url}
    )
    for wrong in ("http://x/v1?key=sk-1", "http://x/v1?api-version=1&sig=2"):
        with pytest.raises(LearnerError, match="put a key in OPENAI_API_KEY"):
            make(wrong)
    make("http://x/v1?api-version=2024-06-01")
    server, _ = play(lambda body, _: call(first(body)), "/v1?api-version=2024-06-01")
    seen += server.paths
    assert seen[0] == "/v1/chat/completions?api-version=2024-06-01"
