"""A language model as a subject, over the OpenAI-compatible chat interface (extra ``llm``).

It gets in words what a person gets in the browser (:mod:`causal_openlock.render.words`), in a
story, with names and in an order that are drawn for each subject, and answers with one action at a
time. One conversation, through all rooms of a condition, is the model's whole memory.

An answer that is not an action is never replaced by a guess. The model is informed and asked again,
up to a limit. After that the action counts as *unanswered*: it is spent on a lever that is moved to
where it is, which changes nothing, the model is informed, and it is counted. A subject that leaves
too many actions unanswered ends its cell with an error that says how many and why.

It gives no probabilities: the chat interface has none of whole answers. Where it is scored, it is
asked for a letter, and ``predictions`` are the probabilities of the letters that stand for actions;
what it does in words may be another matter. Everything that was said is kept in ``transcripts/`` of
the results folder, or in its scores: for each subject a line about it, and one for each answer,
with tokens, latency, and model and server as the reply named them.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from string import ascii_uppercase
from typing import Annotated, Any

import numpy as np

from causal_openlock.contract.learner import Account, Brief, Learner, Step, View
from causal_openlock.contract.parameters import Count, NotNegative, Positive, Whole
from causal_openlock.errors import LearnerError, NotAvailableError
from causal_openlock.render.words import ANY, StoryName, Wording, feedback, room_now
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import DOOR
from causal_openlock.wording import counted, joined
from causal_openlock.world.room import position_names
from openlock_learners.language.answers import (
    HOW,
    HOW_IN_TEXT,
    STRUCTURE,
    Message,
    act_tool,
    acting,
    letters_question,
    read_answer,
    read_letters,
    read_structure,
)
from openlock_learners.language.replies import Replies, Reply, Request, key_of

OURS = ("model", "messages", "tools", "stream", "n", "temperature")
"""Fields that the learner itself sends; ``settings`` may not name them."""
RULES, TURN = 1000, 80
"""Tokens of the rules, and of an answer with what it led to, as measured."""
ADDRESS = r"https?://[^/?#@\s]+(/[^?#]*)?(\?api-version=[^&#]*)?"
_LONG = 6000
"""Characters of a conversation from which on a cut is looked for: about 1,500 tokens."""


@dataclass(frozen=True)
class LanguageModelParameters:
    """The model, its server, and how it is asked."""

    model: Annotated[str, "the model's name, as its server knows it"] = ""
    base_url: Annotated[str, "address of the server"] = "https://api.openai.com/v1"
    story: Annotated[StoryName, "levers, switches, symbols; any draws one for each subject"] = ANY
    temperature: Annotated[NotNegative | None, "of sampling; null leaves it to the server"] = 1.0
    settings: Annotated[
        dict[str, Any], "sent with every request as they are, such as {max_tokens: 300}"
    ] = field(default_factory=dict)
    tools: Annotated[bool, "whether the tool act is offered; otherwise text alone counts"] = True
    recent: Annotated[Count | None, "most answers that the model is reminded of; null for all"] = (
        None
    )
    ask_again: Annotated[Whole, "how often, after an answer that is not an action"] = 2
    unanswered: Annotated[Whole, "most actions without an answer, in a condition"] = 30
    ask_structure: Annotated[bool, "whether it is asked which lever enables which"] = False
    requests: Annotated[Count, "made at the same time, in each process"] = 8
    seconds: Annotated[Positive, "how long a request may wait for the server"] = 120.0
    retries: Annotated[Whole, "after 429, 5xx, stalls and cut connections"] = 5

    def __post_init__(self) -> None:
        for name in OURS:
            if name in self.settings:
                raise ValueError(f"settings cannot hold {name!r}, which the learner itself sends")
        try:
            json.dumps(self.settings, allow_nan=False)
        except (TypeError, ValueError):
            raise ValueError("settings can hold what JSON can, and no infinity") from None
        if not re.fullmatch(ADDRESS, self.base_url):
            raise ValueError(
                "base_url is the address of a server, such as http://localhost:8000/v1, with "
                "nothing behind ? but api-version; a key belongs in OPENAI_API_KEY"
            )


@dataclass
class _Subject:
    """One subject: its words, its conversation, and its transcript."""

    words: Wording
    seed: int
    letters: list[int]  # the action that each letter stands for
    talk: list[Message] = field(default_factory=list)
    said: int = 0  # messages of the conversation that are in the transcript
    lines: list[dict[str, Any]] = field(default_factory=list)  # of the transcript, by answer
    repeated: int = 0  # answers that had been given before
    chosen: int | None = None  # the action that it took, until it is told what that did
    spent: bool = False  # whether that is an unanswered one

    def faults(self, asked: str) -> Counter[str]:
        """How many answers to what was ``asked`` had each fault."""
        return Counter(
            line["fault"] for line in self.lines if line["asked"] == asked and line["fault"]
        )

    @property
    def unanswered(self) -> int:
        """Actions that were spent, as no answer was one."""
        return sum("unanswered" in line for line in self.lines)

    def tokens(self, part: int) -> list[int]:
        """Tokens of each question (0), or of each answer (1)."""
        return [line["reply"]["tokens"][part] for line in self.lines]

    def by_letter(self, what: str) -> list[Any]:
        """``probabilities`` of letters, or what is ``missing``, in each answer in letters."""
        return [line[what] for line in self.lines if line["asked"] == "letter"]

    def message(self, text: str) -> Message:
        """The next message to the model: the result of its call, or a text."""
        if self.talk and (calls := self.talk[-1].get("tool_calls")):
            return {"role": "tool", "tool_call_id": calls[0]["id"], "content": text}
        return {"role": "user", "content": text}

    def tell(self, text: str) -> None:
        """Add a message to the conversation."""
        self.talk.append(self.message(text))


class LanguageModel(Learner):
    """A language model that plays in words (extra ``llm``)."""

    Parameters = LanguageModelParameters
    parameters: LanguageModelParameters

    @classmethod
    def prior_attempts(cls, parameters: LanguageModelParameters) -> None:
        """Nobody knows what a model has read."""

    @classmethod
    def prompt_tokens(cls, parameters: LanguageModelParameters, actions: int) -> int:
        """Estimate from the lengths of the rules and of a turn; each request repeats all turns."""
        growing = min(actions, parameters.recent or actions)  # then the oldest turn is left out
        turns = growing**2 // 2 + (actions - growing) * growing
        return RULES * actions + TURN * turns

    def begin(self, brief: Brief) -> None:
        """Draw the words of each subject."""
        if not self.parameters.model:
            raise LearnerError(
                "the learner llm needs the name of a model, such as parameters: {model: my-model}"
            )
        self.brief, story = brief, self.parameters.story
        self._subjects = [
            _Subject(
                Wording.draw(brief.positions, each, story),
                int(each.integers(2**31)),
                each.permutation(brief.actions).tolist(),
            )
            for each in brief.generators
        ]
        self._replies = Replies(self._connect)

    def _connect(self) -> Callable[[Request], Reply]:
        try:
            from openlock_learners.language.server import Server
        except ImportError:
            raise NotAvailableError(
                "the learner llm needs the package openai, which is not installed; install it with "
                "pip install 'causal-openlock[llm]'"
            ) from None
        chosen = self.parameters
        return Server(chosen.base_url, chosen.seconds, chosen.retries).ask

    def __getstate__(self) -> dict[str, Any]:
        """The conversations: replies are stored elsewhere."""
        return {name: part for name, part in vars(self).items() if name != "_replies"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Continue the conversations."""
        vars(self).update(state)
        self._replies = Replies(self._connect)

    def act(self, view: View) -> IntArray:
        """``[B]`` the action that each subject's model answers with."""
        playing = np.flatnonzero(view.playing).tolist()
        actions = np.zeros(self.brief.subjects, dtype=np.int64)
        with ThreadPoolExecutor(self.parameters.requests) as pool:
            actions[playing] = [*pool.map(lambda row: self._answer(row, view), playing)]
        return actions

    def _answer(self, row: int, view: View) -> int:
        """Ask a subject until its model answers with an action, up to the limit."""
        subject, tools = self._subjects[row], self.parameters.tools
        self._open(row, view)
        for again in range(self.parameters.ask_again + 1):
            if again:
                subject.tell(subject.words.no_action)
            line = self._ask(row, view, "action", subject.talk, subject.talk[subject.said :])
            message, action, fault = read_answer(
                line["reply"]["message"], line["reply"]["finish"], subject.words, tools
            )
            subject.talk.append(message)
            subject.said, subject.chosen = len(subject.talk), action
            line["action"] = None if action is None else self.brief.action_names[action]
            line["fault"] = fault or None
            if action is not None:
                return action
        return self._spend(row, view)

    def predictions(self, view: View) -> FloatArray:
        """``[B, A]`` probabilities of the letters that stand for actions, by one answer of each."""
        playing = np.flatnonzero(view.playing).tolist()
        odds = np.zeros((self.brief.subjects, self.brief.actions))
        with ThreadPoolExecutor(self.parameters.requests) as pool:
            answers = pool.map(lambda row: self._ask_letter(row, view), playing)
            for row, by_letter in zip(playing, answers, strict=True):
                odds[row, self._subjects[row].letters] = by_letter
        return odds

    def _ask_letter(self, row: int, view: View) -> FloatArray:
        """Ask a subject for a letter; the conversation itself stays without the question."""
        subject = self._subjects[row]
        self._open(row, view)
        *before, last = subject.talk
        question = letters_question(subject.words, subject.letters)
        # Some servers refuse two messages of the same role, one after the other.
        asked = {**last, "content": f"{last['content']}\n\n{question}"}
        line = self._ask(row, view, "letter", [*before, asked], [*before[subject.said :], asked])
        subject.said = len(subject.talk)
        odds, missing = read_letters(line["reply"].get("logprobs", {}), self.brief.actions)
        line |= {"probabilities": odds.round(6).tolist(), "missing": round(missing, 6)}
        return odds

    def _open(self, row: int, view: View) -> None:
        """Begin the conversation with the rules and the room, unless it has begun."""
        subject = self._subjects[row]
        if not subject.talk:
            rules = subject.words.instructions(self.brief.action_limit, self.brief.attempt_limit)
            how = HOW if self.parameters.tools else HOW_IN_TEXT
            room = room_now(subject.words, view, row, self.brief.trials)
            subject.tell(f"{rules}\n\n{how}\n\n{room}")

    def _spend(self, row: int, view: View) -> int:
        """Spend an unanswered action on something that changes nothing."""
        subject = self._subjects[row]
        place = subject.words.order[0]
        action = place if view.observation[row, place] else self.brief.positions + place
        subject.chosen, subject.spent = action, True
        subject.lines[-1]["unanswered"] = self.brief.action_names[action]
        if subject.unanswered > self.parameters.unanswered:
            raise LearnerError(
                f"{self.parameters.model} left {counted(subject.unanswered, 'action')} unanswered "
                f"as one subject ({_listed(subject.faults('action'))}); change how it is asked, "
                "raise unanswered, or give answers more room (max_tokens in settings)"
            )
        return action

    def learn(self, step: Step) -> None:
        """Tell each subject what its action led to; ask about rooms that are over."""
        playing = np.flatnonzero(step.view.playing).tolist()
        for row in playing:
            self._put_in_place(row, step)
        if self.parameters.ask_structure:
            left = [row for row in playing if step.trial_over[row]]
            with ThreadPoolExecutor(self.parameters.requests) as pool:
                [*pool.map(lambda row: self._ask_structure(row, step), left)]
        for row in playing:
            subject = self._subjects[row]
            spent = "You gave no action again, so this one is spent and changes nothing.\n"
            led_to = feedback(subject.words, step, row, self.brief.trials)
            subject.tell(f"{spent if subject.spent else ''}{led_to}")
            subject.chosen, subject.spent = None, False

    def _put_in_place(self, row: int, step: Step) -> None:
        """Have the conversation say what was done, where that is not the model's own answer.

        Whoever scores the model gives it what another subject did, and does not always ask it.
        """
        subject, action = self._subjects[row], int(step.action[row])
        if subject.chosen != action:
            self._open(row, step.view)
            if subject.chosen is not None:
                subject.talk.pop()
            subject.talk.append(acting(subject.words, action, self.parameters.tools))
            subject.spent = False

    def _ask_structure(self, row: int, step: Step) -> None:
        """Ask which lever enables which; the conversation itself stays without the question."""
        subject, new = self._subjects[row], bool(step.new_solution[row])
        words, nodes = subject.words, (*position_names(self.brief.positions), DOOR)
        outcome = words.outcome(step.view.observation[row], step.outcome[row], new)
        question = subject.message(f"{outcome}\n{words.question()}\n{STRUCTURE}")
        line = self._ask(row, step.view, "structure", [*subject.talk, question], [question])
        line["enables"] = read_structure(line["reply"]["message"], words, nodes)
        line["fault"] = "malformed" if line["enables"] is None else None

    def _ask(
        self, row: int, view: View, asked: str, talk: list[Message], told: list[Message]
    ) -> dict[str, Any]:
        """Ask for a reply, unless it is kept; the line of the transcript that holds it."""
        chosen, subject = self.parameters, self._subjects[row]
        request: Request = {
            "model": chosen.model,
            "messages": _last(talk, chosen.recent),
            "temperature": chosen.temperature,
            "seed": subject.seed,
        }
        if chosen.tools:
            request |= {"tools": [act_tool(subject.words)], "parallel_tool_calls": False}
        request |= chosen.settings
        if chosen.tools and asked != "action":
            request["tool_choice"] = "none"
        if asked == "letter":
            newer = "max_completion_tokens"
            limit = newer if chosen.settings.get(newer) else "max_tokens"
            request = {"logprobs": True, "top_logprobs": 20} | request | {limit: 1}
        request = {name: value for name, value in request.items() if value is not None}
        key = key_of(request, subject.seed, len(subject.lines))
        reply, repeated = self._replies.reply(key, request, logprobs=asked == "letter")
        subject.repeated += repeated
        line = {
            "trial": int(view.trial[row]),
            "attempt": int(view.attempt[row]),
            "asked": asked,
            "told": told,
            "characters": sum(len(str(message["content"])) for message in request["messages"]),
            "key": key,
            "reply": reply,
        }
        subject.lines.append(line)
        return line

    def account(self) -> Account:
        """The transcripts, and what the user has to know of answers and of the server."""
        transcripts = [
            [self._head(subject), *subject.lines, {"told": subject.talk[subject.said :]}]
            for subject in self._subjects
        ]
        return Account(tuple(transcripts), tuple(self._remarks()))

    def _head(self, subject: _Subject) -> dict[str, Any]:
        """The first line of a subject's transcript."""
        latency = sum(line["reply"]["latency"] for line in subject.lines)
        letters = {}
        if missing := subject.by_letter("missing"):
            means = np.mean(subject.by_letter("probabilities"), axis=0).round(6).tolist()
            by_letter = dict(zip(ascii_uppercase, means, strict=False))
            letters = {"letters": by_letter, "missing": float(np.mean(missing))}
        return {
            "model": self.parameters.model,
            "base_url": self.parameters.base_url,
            "temperature": self.parameters.temperature,
            "seed": subject.seed,
            **asdict(subject.words),
            "tokens": [sum(subject.tokens(0)), sum(subject.tokens(1))],
            "latency": round(latency, 3),
            "answers": len(subject.lines),
            "faults": subject.faults("action"),
            "unanswered": subject.unanswered,
            "unreadable": subject.faults("structure").total(),
            **letters,
        }

    def _remarks(self) -> Iterator[str]:
        """Sentences on what went wrong, and how often."""
        subjects = self._subjects
        faults = sum((subject.faults("action") for subject in subjects), Counter[str]())
        if many := faults.total():
            spent = counted(sum(subject.unanswered for subject in subjects), "action")
            yield (
                f"{counted(many, 'answer was', 'answers were')} no action ({_listed(faults)}); "
                f"{spent} stayed unanswered, and each was spent on what changes nothing"
            )
        if faults["cut off"]:
            yield "answers that are cut off have more room with a larger max_tokens in settings"
        if many := sum(subject.faults("structure").total() for subject in subjects):
            yield f"{counted(many, 'answer')} to which lever enables which could not be read"
        missing = [share for subject in subjects for share in subject.by_letter("missing")]
        if many := sum(share > 0.05 for share in missing):
            yield (
                f"in {many:,} of {counted(len(missing), 'answer')} more than 5% of the probability "
                f"was on no letter (mean of all: {np.mean(missing):.0%}); transcripts.jsonl of the "
                "scores has what the model says instead"
            )
        if many := sum(subject.tokens(0).count(0) for subject in subjects):
            yield f"the server did not count the tokens of {counted(many, 'question')}"
        if many := sum(map(_was_cut, subjects)):
            yield (
                "the server seems to have read only a part of the conversations of "
                f"{counted(many, 'subject')}: they grew, and the tokens that it counts did not, so "
                "the model may never have seen the rules; give the server a larger context, or set "
                "recent (docs/howto/llm.md)"
            )
        if many := sum(subject.repeated for subject in subjects):
            yield (
                f"{counted(many, 'answer')} had been given before and came from "
                f"{self._replies.folder}; no server was asked for them"
            )


def _was_cut(subject: _Subject) -> bool:
    """Whether a server seems to cut off its prompts: much longer ones have hardly more tokens.

    Servers that count only what is new, and not what they remember, count few tokens of each
    character; that does not count as a cut.
    """
    sizes = [*zip((line["characters"] for line in subject.lines), subject.tokens(0), strict=True)]
    characters, tokens = max(sizes, default=(0, 0))
    if characters < _LONG or tokens < 0.7 * max(of_each for _, of_each in sizes) or not tokens:
        return False
    # Of a short prompt that was read, a token has a few characters; otherwise nothing is counted.
    whole = [(size, own) for size, own in sizes if size <= 0.6 * characters and size <= 10 * own]
    return any(own >= 0.9 * tokens for _, own in whole)


def _last(talk: list[Message], recent: int | None) -> list[Message]:
    """The conversation with the last ``recent`` answers of the model; None for all."""
    first, *rest = talk
    if recent is None or len(rest) <= 2 * recent:
        return talk
    # An answer and what it led to always alternate, so what is left begins with an answer.
    left_out = f"{first['content']}\n\n(What came then is left out here.)"
    return [{**first, "content": left_out}, *rest[-2 * recent :]]


def _listed(faults: Counter[str]) -> str:
    return joined([f"{many} {fault}" for fault, many in sorted(faults.items())])
