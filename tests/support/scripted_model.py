"""A language model that follows a script, in the place of the network.

A script gives, for the body of a request and its number, a message, an exception of the network, or
``(status, text, headers)`` of a reply.
"""

import json
import math
import time
import zlib
from threading import Lock
from typing import Any

import httpx2

URL = "http://localhost:8000/v1"
NETWORK = "httpx2.HTTPTransport.handle_request"
Body = dict[str, Any]
USAGE = {"prompt_tokens": 100, "completion_tokens": 5}


def choices(body):
    """The actions that the tool of a request takes."""
    return body["tools"][0]["function"]["parameters"]["properties"]["action"]["enum"]


def call(action, name="act"):
    function = {"name": name, "arguments": json.dumps({"action": action})}
    return {
        "role": "assistant",
        "tool_calls": [{"id": "c1", "type": "function", "function": function}],
    }


def says(text, **also):
    return {"role": "assistant", "content": text, **also}


def some_action(body, _):
    """An action that depends on everything in the request and nothing else."""
    listed = choices(body)
    return call(listed[zlib.crc32(json.dumps(body, sort_keys=True).encode()) % len(listed)])


def letters_in(messages):
    """The action in words that each letter of the question stands for."""
    listed = messages[-1]["content"].rpartition(" alone.\n")[2]
    return dict(line.split(": ") for line in listed.splitlines())


def logprobs(chances):
    """Log-probabilities of the only token of an answer, as OpenAI gives them."""
    likeliest = [{"token": token, "logprob": math.log(p)} for token, p in chances.items()]
    return {"content": [{**likeliest[0], "top_logprobs": likeliest}]}


def completion(message, finish="stop", usage=USAGE, logprobs=None):
    """A reply that holds a message, which ended for this reason."""
    reply = {
        "model": "scripted-1",
        "system_fingerprint": "fp_7",
        "choices": [
            {"index": 0, "message": message, "finish_reason": finish, "logprobs": logprobs}
        ],
        "usage": usage,
    }
    return 200, json.dumps(reply), {"Server": "Scripted/1"}


class ScriptedModel:
    """Keeps what was asked, and how many requests were under way at the same time.

    Takes the place of the network: ``monkeypatch.setattr(NETWORK, ScriptedModel())``.
    """

    def __init__(self, script=some_action):
        self.script = script
        self.asked: list[Body] = []
        self.requests: list[httpx2.Request] = []
        self.most = self._now = 0
        self._lock = Lock()

    def __call__(self, request):
        with self._lock:
            number = len(self.asked)
            self.asked.append(json.loads(request.content))
            self.requests.append(request)
            self._now += 1
            self.most = max(self.most, self._now)
        time.sleep(0.001)
        with self._lock:
            self._now -= 1
        said = self.script(self.asked[number], number)
        if isinstance(said, Exception):
            raise said
        if isinstance(said, dict):
            said = completion(said, "tool_calls" if said.get("tool_calls") else "stop")
        status, content, headers = said
        return httpx2.Response(status, content=content, headers=headers)

    @property
    def keys(self):
        return {request.headers.get("Authorization") for request in self.requests}
