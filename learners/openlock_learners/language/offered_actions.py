"""The tool that a language model is offered, and the reading of its answers.

An action is a call of the tool ``act``; where a model calls none, the last line of its text counts.
What is neither is not guessed at: it is a *fault*, which has a name.

Servers write the same in different ways, and some want back what they gave: a call is sent back
with all its own fields (thought signatures, reasoning), a text as text alone.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from causal_openlock.render.words import Wording

Fault = Literal["malformed", "refused", "out of range", "cut off"]
Message = dict[str, Any]
"""A message of a chat, as it is sent."""

HOW = (
    "Answer with one action at a time: call the tool `act` with it. If you cannot call tools, end "
    "your answer with a line that holds the action and nothing else."
)
EMPTY = "(no answer)"
"""Stands for an empty answer in the conversation, since servers refuse empty messages."""
_CUT = ("length", "max_tokens", "MAX_TOKENS")
"""Finish reasons of an answer that was cut off."""
_NAMES = "think|thinking|thought|reasoning"
_TAG = re.compile(rf"<(/?)(?:{_NAMES})>|\[(/?)THINK\]|◁(/?)think▷|<\|channel\|>", re.IGNORECASE)
"""The beginning or, with a stroke, the end of a thought."""
_FINAL = "<|channel|>final<|message|>"
HOW_IN_TEXT = "Answer with one action at a time, on a last line that holds it and nothing else."


class Answer(NamedTuple):
    """A reply as it was understood.

    Attributes:
        message: The reply as it enters the conversation: a proper call, or text.
        action: The index of the action, or ``None``.
        fault: Why there is no action.
    """

    message: Message
    action: int | None
    fault: Fault | None


def act_tool(words: Wording) -> dict[str, Any]:
    """The tool ``act(action)``, which takes one of the actions in words."""
    action = {"type": "string", "enum": words.choices, "description": "The action to take."}
    return {
        "type": "function",
        "function": {
            "name": "act",
            "description": "Take one action.",
            "parameters": {
                "type": "object",
                "properties": {"action": action},
                "required": ["action"],
                "additionalProperties": False,
            },
        },
    }


def read_answer(reply: Message, finish: str | None, words: Wording, tools: bool = True) -> Answer:
    r"""Read a model's message: the action that it chose, or why there is none.

    Args:
        reply: The message as the server gave it.
        finish: Why it ended, as the server gave it.
        words: What actions are called.
        tools: Whether the tool was offered; otherwise text alone counts.

    Example:
        >>> words = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
        >>> read_answer({"content": "I try the first one.\nPush oak."}, "stop", words).action
        0
        >>> read_answer({"content": "", "refusal": "I cannot."}, "stop", words).fault
        'refused'
    """
    calls, text = _calls(reply), _text(reply)
    if tools and len(calls) == 1 and (action := _argument(calls[0])) is not None:
        chosen = words.read(action)
        message = _given_back(reply, calls[0], action)
        return Answer(message, chosen, None if chosen is not None else "out of range")
    # What is no proper call goes on as text: servers refuse calls that they cannot read.
    said = "\n".join([text, *(json.dumps(call) for call in calls)]).strip()
    refusal = str(reply.get("refusal") or "")
    message = {"role": "assistant", "content": said or refusal or EMPTY}
    if refusal or finish == "content_filter":
        return Answer(message, None, "refused")
    spoken = without_thoughts(text)
    if finish in _CUT or spoken is None:  # its last line may be a thought, or half of an action
        return Answer(message, None, "cut off")
    chosen = words.read(spoken) if not calls else None
    return Answer(message, chosen, None if chosen is not None else "malformed")


def without_thoughts(text: str) -> str | None:
    """A model's answer without its thoughts; None if it is still thinking.

    >>> without_thoughts("<think>elm?</think> Push oak."), without_thoughts("<think> Push oak.")
    ('Push oak.', None)
    """
    text = text.rpartition(_FINAL)[2]
    said: list[str] = []
    begin, thinking = 0, False
    for tag in _TAG.finditer(text):
        ends = "/" in tag.groups()
        if ends and not thinking:  # the thought began in the prompt
            said.clear()
        elif not ends and not thinking:
            said.append(text[begin : tag.start()])
        begin, thinking = tag.end(), not ends
    return None if thinking else "".join([*said, text[begin:]]).strip()


def acting(words: Wording, action: int, tools: bool) -> Message:
    """An answer that takes an action, for one that the model did not give itself."""
    text = words.actions[action]
    return _acting(text, "", "call") if tools else {"role": "assistant", "content": text}


def _acting(action: str, text: str, identifier: str) -> Message:
    """A message that calls ``act``."""
    function = {"name": "act", "arguments": json.dumps({"action": action})}
    call = {"id": identifier, "type": "function", "function": function}
    return {"role": "assistant", "content": text, "tool_calls": [call]}


def _given_back(reply: Message, call: dict[str, Any], action: str) -> Message:
    """A message that called ``act``, with all its own fields, for the conversation."""
    own = {name: value for name, value in reply.items() if value not in (None, [], "")}
    own.pop("function_call", None)
    function, arguments = call["function"], call["function"]["arguments"]
    if not isinstance(arguments, str):
        arguments = json.dumps({"action": action})
    whole = {
        **call,
        "id": str(call.get("id") or "call"),
        "type": "function",
        "function": {**function, "arguments": arguments},
    }
    return {"content": "", **own, "role": "assistant", "tool_calls": [whole]}


def plainly(message: Message) -> Message:
    """A message with the fields that every server knows, and no others.

    >>> plainly({"role": "assistant", "content": "Push oak.", "reasoning_content": "elm?"})
    {'role': 'assistant', 'content': 'Push oak.'}
    """
    if message["role"] != "assistant":
        return message
    calls, text = _calls(message), _text(message)
    if len(calls) == 1 and (action := _argument(calls[0])) is not None:
        return _acting(action, text, str(calls[0]["id"]))
    return {"role": "assistant", "content": "" if text == EMPTY else text}


def _calls(reply: Message) -> list[dict[str, Any]]:
    """The calls of a message; those of the older interface have no list and no identifier."""
    calls, older = reply.get("tool_calls"), reply.get("function_call")
    if isinstance(calls, list):
        return [one for one in calls if isinstance(one, dict)]
    return [{"function": older}] if isinstance(older, dict) else []


def _text(reply: Message) -> str:
    """Text of a message; some servers give it in parts, with thoughts among them."""
    content = reply.get("content")
    if isinstance(content, list):
        parts = [one.get("text") for one in content if isinstance(one, dict)]
        content = "\n".join(one for one in parts if isinstance(one, str))
    return content if isinstance(content, str) else ""


def _argument(call: dict[str, Any]) -> str | None:
    """The action that a call of ``act`` names, if it is one."""
    function = call.get("function")
    if not isinstance(function, dict) or function.get("name") != "act":
        return None
    try:
        found = function["arguments"]
        for _ in range(2):  # JSON in text, or once more in text, or read already
            found = json.loads(found) if isinstance(found, str) else found
        action = found["action"]
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    return action if isinstance(action, str) else None


def structure_format(words: Wording) -> dict[str, Any]:
    """The form of the answer to which enables which: pairs of a cause and an effect."""
    pair = {
        "type": "object",
        "properties": {
            "cause": {"type": "string", "enum": list(words.names)},
            "effect": {"type": "string", "enum": list(words.nodes)},
        },
        "required": ["cause", "effect"],
        "additionalProperties": False,
    }
    schema = {
        "type": "object",
        "properties": {"enables": {"type": "array", "items": pair}},
        "required": ["enables"],
        "additionalProperties": False,
    }
    wanted = {"name": "structure", "strict": True, "schema": schema}
    return {"type": "json_schema", "json_schema": wanted}


def read_structure(reply: Message, words: Wording, nodes: Sequence[str]) -> list[list[str]] | None:
    """The pairs that a model named, by ``nodes``: positions and the door; ``None`` if unreadable.

    >>> words = Wording("levers", ("oak", "elm", "fir"), (0, 1, 2))
    >>> said = '{"enables": [{"cause": "oak", "effect": "the door"}]}'
    >>> read_structure({"content": said}, words, ("P0", "P1", "P2", "door"))
    [['P0', 'door']]
    """
    known = dict(zip(words.nodes, nodes, strict=True))
    try:
        said = without_thoughts(_text(reply)) or ""
        fenced = said.removeprefix("```json").removeprefix("```").removesuffix("```")
        pairs = json.loads(fenced)["enables"]
        named = [[known[pair["cause"]], known[pair["effect"]]] for pair in pairs]
    except (KeyError, TypeError, ValueError, RecursionError):
        return None
    return named if all(cause != nodes[-1] for cause, _ in named) else None
