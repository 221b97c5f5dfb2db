"""A language model as a subject, over the OpenAI-compatible chat interface (extra ``llm``).

It gets in words what a person gets in the browser (:mod:`causal_openlock.render.words`), in a
story, with names and in an order that are drawn for each subject, and answers with one action at a
time. One conversation, through all rooms of a condition, is the model's whole memory.

An answer that is not an action is never replaced by a guess. The model is informed and asked again,
up to a limit. After that the action counts as *unanswered*: it is spent on a lever that is moved to
where it is, which changes nothing, the model is informed, and it is counted. A subject that leaves
too many actions unanswered ends its cell with an error that says how many and why.

It gives no probabilities: the chat interface has none of whole answers. Some servers would give
them by another way (``prompt_logprobs``), which is not used here. Asking again and again what it
would do (inverse binomial sampling) works, and costs as many requests.

Everything that was said is kept in ``transcripts/`` of the results folder: for each subject a line
about it, and one for each answer, with tokens, latency, and model and server as the reply named
them.
"""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any
from urllib.parse import parse_qs, urlsplit

import numpy as np
from pydantic import Field

from causal_openlock.contract.learner import Account, Brief, Learner, Step, View
from causal_openlock.contract.parameters import Count, Positive
from causal_openlock.errors import LearnerError, NotAvailableError
from causal_openlock.render.words import ANY, StoryName, Wording, feedback, room_now
from causal_openlock.schemas.fsm import IntArray
from causal_openlock.schemas.schema import DOOR
from causal_openlock.wording import counted, joined
from causal_openlock.world.room import position_names
from openlock_learners.language.kept_replies import key_of, replay
from openlock_learners.language.offered_actions import (
    HOW,
    HOW_IN_TEXT,
    Message,
    act_tool,
    acting,
    read_answer,
    read_structure,
    structure_format,
)
from openlock_learners.language.reply import Reply, was_cut
from openlock_learners.language.side_by_side import SideBySide

if TYPE_CHECKING:
    from openlock_learners.language.server import Server

OURS = ("model", "messages", "tools", "response_format", "stream", "n", "temperature", "seed")
"""Fields that the learner itself sends; ``settings`` may not name them."""


_MORE_ROOM = "answers that are cut off have more room with a larger max_tokens in settings, or "


@dataclass(frozen=True)
class LanguageModelParameters:
    """The model, its server, and how it is asked."""

    model: Annotated[str, "the model's name, as its server knows it"] = ""
    base_url: Annotated[str, "address of the server"] = "https://api.openai.com/v1"
    story: Annotated[StoryName, "levers, switches, symbols; any draws one for each subject"] = ANY
    temperature: Annotated[
        Annotated[float, Field(ge=0)] | None, "of sampling; null leaves it to the server"
    ] = 1.0
    settings: Annotated[
        dict[str, Any], "sent with every request as they are, such as {max_tokens: 300}"
    ] = field(default_factory=dict)
    tools: Annotated[bool, "whether the tool act is offered; otherwise text alone counts"] = True
    send_seed: Annotated[bool, "whether the subject's own seed is sent"] = True
    recent: Annotated[Count | None, "most answers that the model is reminded of; null for all"] = (
        None
    )
    ask_again: Annotated[
        int, Field(ge=0), "how often it is asked again after an answer that is not an action"
    ] = 2
    unanswered: Annotated[
        int, Field(ge=0), "most actions that a subject may leave unanswered in a condition"
    ] = 30
    ask_structure: Annotated[
        bool, "whether it is asked after each room which lever enables which"
    ] = False
    requests: Annotated[Count, "made at the same time, in each process"] = 8
    seconds: Annotated[Positive, "time limit of a request"] = 120.0
    retries: Annotated[int, Field(ge=0), "after 429, 5xx, stalls and cut connections"] = 5

    def __post_init__(self) -> None:
        for name in OURS:
            if name in self.settings:
                raise ValueError(f"settings cannot hold {name!r}, which the learner itself sends")
        try:
            json.dumps(self.settings, allow_nan=False)
        except (TypeError, ValueError):
            raise ValueError("settings can hold what JSON can, and no infinity") from None
        try:
            parts = urlsplit(self.base_url)
            known = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
        except ValueError:  # of a port that there cannot be
            known = False
        if not known:
            raise ValueError(
                "base_url is the address of a server, such as http://localhost:8000/v1"
            )
        if parts.username or parts.password or {*parse_qs(parts.query)} - {"api-version"}:
            raise ValueError(
                "base_url cannot hold a key, or anything behind ? but api-version; put a key in "
                "OPENAI_API_KEY"
            )


@dataclass
class _Subject:
    """One subject: its words, its conversation, and its transcript."""

    words: Wording
    seed: int
    talk: list[Message] = field(default_factory=list)
    said: int = 0  # how many messages of the conversation are in the transcript
    lines: list[dict[str, Any]] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    unanswered: int = 0
    unreadable: int = 0  # answers to which lever enables which
    chosen: int | None = None  # the action that it took, until it is told what that did
    spent: bool = False  # whether the last action was unanswered
    in_attempt: bool = False
    sizes: list[tuple[int, int]] = field(default_factory=list)
    """Characters of each request, and the tokens that the server counted for it."""

    def tell(self, text: str) -> None:
        """Add a message to the model: the result of its call, or a text."""
        calls = self.talk[-1].get("tool_calls") if self.talk else None
        if calls:
            self.talk.append({"role": "tool", "tool_call_id": calls[0]["id"], "content": text})
        else:
            self.talk.append({"role": "user", "content": text})

    def messages(self, recent: int | None) -> list[Message]:
        """The conversation as it is sent: with no more than ``recent`` answers of the model's."""
        first, *rest = self.talk
        if recent is None or len(rest) <= 2 * recent:
            return [dict(message) for message in self.talk]
        # An answer and what it led to always alternate, so what is left begins with an answer.
        kept = rest[-2 * recent :]
        left_out = "(What came then is left out here.)"
        return [{**first, "content": f"{first['content']}\n\n{left_out}"}, *kept]


class LanguageModel(Learner):
    """A language model that plays in words (extra ``llm``)."""

    Parameters = LanguageModelParameters
    parameters: LanguageModelParameters

    @classmethod
    def prior_attempts(cls, parameters: LanguageModelParameters) -> None:
        """Nobody knows what a model has read."""

    def begin(self, brief: Brief) -> None:
        """Draw the words of each subject."""
        if not self.parameters.model:
            raise LearnerError(
                "the learner llm needs the name of a model, such as parameters: {model: my-model}"
            )
        self.brief = brief
        self._open_connections()
        self._repeated = 0  # answers that had been given before
        self._subjects = [
            _Subject(
                Wording.draw(brief.positions, generator, self.parameters.story),
                int(generator.integers(2**31)),
            )
            for generator in brief.generators
        ]

    def _open_connections(self) -> None:
        self._server: Server | None = None
        self._replay, self._loop = replay(), SideBySide()

    def __getstate__(self) -> dict[str, Any]:
        """All but connections; the conversations are in it, and replies are stored elsewhere."""
        connections = "_server", "_replay", "_loop"
        return {name: part for name, part in vars(self).items() if name not in connections}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue the conversations over new connections."""
        vars(self).update(state)
        self._open_connections()

    # -- playing --------------------------------------------------------------------------------

    def act(self, view: View) -> IntArray:
        """``[B]`` the action that each subject's model answers with."""
        playing = np.flatnonzero(view.playing).tolist()
        for row in playing:
            if not self._subjects[row].talk:
                self._open(row, view)
        actions = np.zeros(self.brief.subjects, dtype=np.int64)
        actions[playing] = self._loop.run([self._answer(row, view) for row in playing])
        for row in playing:
            self._subjects[row].chosen = int(actions[row])
        return actions

    def _open(self, row: int, view: View) -> None:
        words = self._subjects[row].words
        how = HOW if self.parameters.tools else HOW_IN_TEXT
        rules = words.instructions(self.brief.action_limit, self.brief.attempt_limit)
        room = room_now(words, view, row, self.brief.trials)
        self._subjects[row].tell(f"{rules}\n\n{how}\n\n{room}")

    async def _answer(self, row: int, view: View) -> int:
        subject, where = self._subjects[row], _where(view, row)
        for again in range(self.parameters.ask_again + 1):
            if again:
                subject.tell(subject.words.no_action)
            request = self._request(subject)
            key, reply = await self._ask(subject, request)
            size = sum(len(str(one["content"])) for one in request["messages"])
            subject.sizes.append((size, reply["tokens"][0]))
            answer = read_answer(
                reply["message"], reply["finish"], subject.words, self.parameters.tools
            )
            subject.talk.append(answer.message)
            action = None if answer.action is None else self.brief.action_names[answer.action]
            read = {"action": action, "fault": answer.fault}
            self._keep(subject, {**where, "asked": "action", **read}, key, reply)
            subject.in_attempt = True
            if answer.action is not None:
                return answer.action
            subject.faults.append(str(answer.fault))
        return self._spend(row, view)

    def _spend(self, row: int, view: View) -> int:
        """Spend an unanswered action on something that changes nothing."""
        subject = self._subjects[row]
        subject.unanswered += 1
        subject.spent = True
        if subject.unanswered > self.parameters.unanswered:
            raise LearnerError(
                f"{self.parameters.model} left {counted(subject.unanswered, 'action')} unanswered "
                f"as one subject ({_counts(subject.faults)}); "
                + (_MORE_ROOM if "cut off" in subject.faults else "change how it is asked, or ")
                + "raise unanswered"
            )
        place = subject.words.order[0]
        action = place if view.observation[row, place] else self.brief.positions + place
        name = self.brief.action_names[action]
        subject.lines.append({**_where(view, row), "unanswered": name})
        return int(action)

    def learn(self, step: Step) -> None:
        """Tell each subject what its action led to; ask about rooms that are over."""
        playing = np.flatnonzero(step.view.playing).tolist()
        for row in playing:
            self._put_in_place(row, step)
        left = [row for row in playing if step.trial_over[row] and self.parameters.ask_structure]
        self._loop.run([self._ask_structure(row, step) for row in left])
        for row in playing:
            subject = self._subjects[row]
            text = feedback(subject.words, step, row, self.brief.trials)
            if subject.spent:
                text = (
                    f"You gave no action again, so this one is spent and changes nothing.\n{text}"
                )
            subject.tell(text)
            subject.chosen, subject.spent = None, False
            subject.in_attempt = not step.attempt_over[row]

    def _put_in_place(self, row: int, step: Step) -> None:
        """Have the conversation say what was done, where that is not the model's own answer.

        Whoever scores the model gives it what another subject did, and does not always ask it.
        """
        subject, action = self._subjects[row], int(step.action[row])
        if subject.chosen == action:
            return
        if not subject.talk:
            self._open(row, step.view)
        done = acting(subject.words, action, self.parameters.tools)
        if subject.chosen is None:
            subject.talk.append(done)
        else:
            subject.talk[-1] = done
        subject.spent = False

    # -- asking ---------------------------------------------------------------------------------

    def _request(self, subject: _Subject) -> dict[str, Any]:
        chosen = self.parameters
        request = {
            "model": chosen.model,
            "messages": subject.messages(chosen.recent),
            **chosen.settings,
        }
        if chosen.temperature is not None:
            request["temperature"] = chosen.temperature
        if chosen.send_seed:
            request["seed"] = subject.seed
        if chosen.tools:
            request["tools"] = [act_tool(subject.words)]
        return request

    async def _ask(self, subject: _Subject, request: dict[str, Any]) -> tuple[str, Reply]:
        key = key_of(request, subject.seed, len(subject.lines))
        reply = self._replay.get(key)
        self._repeated += reply is not None
        if reply is None:
            before = None if subject.in_attempt else self._replay.require_budget
            reply = await self._connected().ask(_as_sent(request), before)
            self._replay.put(key, reply)
        return key, reply

    def _connected(self) -> Server:
        """The server; the first request looks for it, so that a repetition needs none."""
        if self._server is None:
            self._replay.require_place()  # or what is answered, and paid for, would be lost
            try:
                from openlock_learners.language.server import Server
            except ImportError:
                raise NotAvailableError(
                    "the learner llm needs the package openai, which is not installed; install it "
                    "with pip install 'causal-openlock[llm]'"
                ) from None
            chosen = self.parameters
            self._server = Server(chosen.base_url, chosen.seconds, chosen.retries, chosen.requests)
            self._loop.at_the_end.append(self._server.close)
        return self._server

    async def _ask_structure(self, row: int, step: Step) -> None:
        """Ask which lever enables which; the conversation itself stays without the question."""
        subject = self._subjects[row]
        words = subject.words
        new, outcome = bool(step.new_solution[row]), step.outcome[row]
        aside = replace(subject, talk=[*subject.talk], in_attempt=True)
        aside.tell(f"{words.outcome(step.view.observation[row], outcome, new)}\n{words.question()}")
        request = self._request(aside)
        if "tools" in request:
            request["tool_choice"] = "none"
        request["response_format"] = structure_format(words)
        key, reply = await self._ask(aside, request)
        nodes = (*position_names(self.brief.positions), DOOR)
        pairs = read_structure(reply["message"], words, nodes)
        fault = None if pairs is not None else "malformed"
        subject.unreadable += pairs is None
        what = {"asked": "structure", "told": aside.talk[-1:], "enables": pairs, "fault": fault}
        self._keep(subject, {**_where(step.view, row), **what}, key, reply)

    # -- what is kept ---------------------------------------------------------------------------

    @staticmethod
    def _keep(subject: _Subject, what: dict[str, Any], key: str, reply: Reply) -> None:
        """Add a line to the transcript, with what has been told since the last one."""
        if what["asked"] == "action":
            what["told"] = subject.talk[subject.said : -1]
            subject.said = len(subject.talk)
        subject.lines.append({**what, "key": key, "reply": reply})

    def account(self) -> Account:
        """The transcripts, and a sentence if answers were not actions."""
        chosen = self.parameters
        transcripts = []
        for subject in self._subjects:
            replies = [line["reply"] for line in subject.lines if "reply" in line]
            head = {
                "model": chosen.model,
                "base_url": chosen.base_url,
                "temperature": chosen.temperature,
                "seed": subject.seed,
                **asdict(subject.words),
                "tokens": [sum(reply["tokens"][i] for reply in replies) for i in (0, 1)],
                "latency": round(sum(reply["latency"] for reply in replies), 3),
                "answers": len(replies),
                "faults": dict(Counter(subject.faults)),
                "unanswered": subject.unanswered,
                "unreadable": subject.unreadable,
            }
            rest = {"told": subject.talk[subject.said :]}  # what came of the last answer
            transcripts.append([head, *subject.lines, rest])
        faults = [fault for subject in self._subjects for fault in subject.faults]
        remarks = []
        if faults:
            spent = sum(subject.unanswered for subject in self._subjects)
            remarks.append(
                f"{counted(len(faults), 'answer was', 'answers were')} no action "
                f"({_counts(faults)}); {counted(spent, 'action')} stayed unanswered, and each was "
                "spent on what changes nothing"
            )
        if unreadable := sum(subject.unreadable for subject in self._subjects):
            remarks.append(
                f"{counted(unreadable, 'answer')} to which lever enables which could not be read"
            )
        if "cut off" in faults:
            remarks.append(_MORE_ROOM.removesuffix(", or "))
        if cut := sum(was_cut(subject.sizes) for subject in self._subjects):
            remarks.append(
                f"the server seems to have read only a part of the conversations of "
                f"{counted(cut, 'subject')}: they grew, and the tokens that it counts did not, so "
                "the model may never have seen the rules; give the server a larger context, or set "
                "recent (docs/howto/llm.md)"
            )
        if self._repeated:
            remarks.append(
                f"{counted(self._repeated, 'answer')} had been given before and came from "
                f"{self._replay.folder}; no server was asked for them"
            )
        return Account(tuple(transcripts), tuple(remarks))


def _where(view: View, row: int) -> dict[str, Any]:
    return {"trial": int(view.trial[row]), "attempt": int(view.attempt[row])}


def _counts(faults: list[str]) -> str:
    return joined([f"{many} {fault}" for fault, many in sorted(Counter(faults).items())])


def _as_sent(request: dict[str, Any]) -> dict[str, Any]:
    """A request as the library takes it; what it does not know goes into the body."""
    named = {name: request[name] for name in OURS if name in request}
    return {**named, "extra_body": {k: v for k, v in request.items() if k not in OURS}}
