"""The tool that a language model is offered, and the reading of its answers.

An action is a call of the tool ``act``; where a model calls none, the last line of its text counts.
What is neither is not guessed at: it is a *fault*, which has a name. A call is sent back with all
its own fields, as some servers want (thought signatures, reasoning), a text as text alone.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from string import ascii_uppercase
from typing import Any

import numpy as np

from causal_openlock.render.words import Wording
from causal_openlock.schemas.fsm import FloatArray

Message = dict[str, Any]
"""A message of a chat, as it is sent."""
Answer = tuple[Message, int | None, str]
"""A reply as it enters the conversation, the action that it names, and otherwise the fault."""

HOW = (
    "Answer with one action at a time: call the tool `act` with it. If you cannot call tools, end "
    "your answer with a line that holds the action and nothing else."
)
HOW_IN_TEXT = "Answer with one action at a time, on a last line that holds it and nothing else."
STRUCTURE = 'Answer with JSON alone: {"enables": [{"cause": NAME, "effect": NAME}, ...]}.'
EMPTY = "(no answer)"
"""Stands for an empty answer in the conversation, since servers refuse empty messages."""
WHOLE = ("", "stop", "tool_calls", "function_call", "tool_use", "end_turn", "stop_sequence", "eos")
"""Finish reasons of an answer that is whole; all others are of a part."""
REFUSED = ("content_filter", "safety", "recitation", "sensitive")
"""Finish reasons of an answer that a filter has stopped."""


def act_tool(words: Wording) -> dict[str, Any]:
    """The tool ``act(action)``, which takes one of the actions in words."""
    action = {"type": "string", "enum": words.choices, "description": "The action to take."}
    parameters = {
        "type": "object",
        "properties": {"action": action},
        "required": ["action"],
        "additionalProperties": False,
    }
    function = {"name": "act", "description": "Take one action.", "parameters": parameters}
    return {"type": "function", "function": function}


def read_answer(reply: Message, finish: str | None, words: Wording, tools: bool = True) -> Answer:
    r"""Read a model's message: the action that it chose, or why there is none.

    Of several calls the first counts: the others were chosen without knowing what it would do.

    ``reply`` is the message and ``finish`` why it ended, as the server gave them. Where no tool was
    offered, text alone counts.

    Example:
        >>> words = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
        >>> read_answer({"content": "I try the first one.\nPush oak."}, "stop", words)[1]
        0
        >>> read_answer({"content": "", "refusal": "I cannot."}, "stop", words)[2]
        'refused'
    """
    text, calls, refusal = _text(reply), reply.get("tool_calls"), str(reply.get("refusal") or "")
    spoken, ended = _without_thoughts(text), (finish or "").lower()
    # What is no proper call goes on as text: servers refuse calls that they cannot read.
    said = f"{text}\n{json.dumps(calls)}" if calls else text
    message = {"role": "assistant", "content": said.strip() or refusal or EMPTY}
    if refusal or ended in REFUSED:
        return message, None, "refused"
    if ended not in WHOLE or spoken is None:  # its last line may be half of an action
        return message, None, "cut off"
    if calls and tools and (action := _argument(calls)):
        chosen = words.read(action)
        return _given_back(reply, action), chosen, "" if chosen is not None else "out of range"
    chosen = words.read(spoken) if not calls else None
    return message, chosen, "" if chosen is not None else "malformed"


def _text(reply: Message) -> str:
    """Text of a message; some servers give it in parts, with thoughts among them."""
    content = reply.get("content") or ""
    if isinstance(content, list):
        parts = [part.get("text") for part in content if isinstance(part, dict)]
        content = "\n".join(part for part in parts if isinstance(part, str))
    return str(content)


def _without_thoughts(text: str) -> str | None:
    """A model's answer without its thoughts; None if it is still thinking."""
    spoken = text.rpartition("</think>")[2]
    return None if "<think>" in spoken else spoken


def _argument(calls: Any) -> str | None:
    """The action that the first call names, if it is one of ``act``, by any name of the tool.

    Models also call it ``functions.act`` and ``act<|channel|>commentary``.
    """
    try:
        function = calls[0]["function"]
        given = function["arguments"]
        for _ in range(2):  # JSON in text, or once more in text, or read already
            given = json.loads(given) if isinstance(given, str) else given
        name = function["name"].removeprefix("functions.").partition("<|")[0]
        return str(given["action"]) if name == "act" else None
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError):
        return None


def _given_back(reply: Message, action: str) -> Message:
    """A message that called ``act``, with all its own fields, for the conversation."""
    call = reply["tool_calls"][0]
    own = {name: value for name, value in reply.items() if value not in (None, [], "")}
    function = {"name": "act", "arguments": json.dumps({"action": action})}
    proper = {"type": "function", "id": "call", **call, "function": function}
    return {"content": "", **own, "role": "assistant", "tool_calls": [proper]}


def acting(words: Wording, action: int, tools: bool) -> Message:
    """An answer that takes an action, for one that the model did not give itself."""
    text = words.actions[action]
    if not tools:
        return {"role": "assistant", "content": text}
    return _given_back({"tool_calls": [{}]}, text)


def letters_question(words: Wording, letters: Sequence[int]) -> str:
    """The question for the next action by its letter: A stands for the first of these actions."""
    pairs = zip(ascii_uppercase, letters, strict=False)
    listed = "\n".join(f"{letter}: {words.actions[action]}" for letter, action in pairs)
    return f"Answer this time with the letter of your next action alone.\n{listed}"


def read_letters(logprobs: Mapping[str, float], letters: int) -> tuple[FloatArray, float]:
    """Probabilities of the first letters, and the probability of all other answers together.

    Tokens such as ``" A"``, ``a`` or ``A)`` count for A. A letter without a token gets an equal
    share of what is missing, but no more than the least likely token has, as it would be among them
    otherwise. Then all letters are divided by their sum.
    """
    odds, least = np.zeros(letters), np.exp(min([*logprobs.values(), 0.0]))
    for token, logprob in logprobs.items():
        named = re.fullmatch(r"[\W_Ġ]*([A-Za-z])[\W_]*", token)  # some servers write a blank as Ġ
        if named and (letter := ascii_uppercase.index(named[1].upper())) < letters:
            odds[letter] += np.exp(min(logprob, 0.0))
    missing, unseen = max(1.0 - float(odds.sum()), 0.0), odds == 0
    odds[unseen] = min(missing / max(unseen.sum(), 1), least)
    return (odds / odds.sum() if odds.any() else np.full(letters, 1 / letters)), missing


def read_structure(reply: Message, words: Wording, nodes: Sequence[str]) -> list[list[str]] | None:
    """The pairs that a model named, by ``nodes``: positions and the door; ``None`` if unreadable.

    >>> words = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
    >>> said = 'I believe: {"enables": [{"cause": "Oak", "effect": "door"}]}'
    >>> read_structure({"content": said}, words, ("P0", "P1", "P2", "door"))
    [['P0', 'door']]
    """
    node_of = dict(zip(map(_bare, words.nodes), nodes, strict=True))
    said = _without_thoughts(_text(reply)) or ""
    try:
        answer = said[said.rindex("{", 0, said.rindex('"enables"')) :]
        pairs = json.JSONDecoder().raw_decode(answer)[0]["enables"]
        named = [[node_of[_bare(pair[end])] for end in ("cause", "effect")] for pair in pairs]
    except (LookupError, TypeError, ValueError, AttributeError, RecursionError):
        return None
    return named if all(cause != nodes[-1] for cause, _ in named) else None


def _bare(name: str) -> str:
    return name.strip().lower().removeprefix("the ")
