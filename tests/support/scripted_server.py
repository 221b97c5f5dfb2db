"""A server with the chat interface whose model follows a script, on a port of its own."""

from __future__ import annotations

import json
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Body = dict[str, Any]
Script = Callable[[Body, int], Any]
"""From the body of a request and its number: a message, or one of the kinds of trouble below."""


class Trouble:
    """Instead of an answer."""


class Status(Trouble):
    def __init__(self, code: int, body: str = "", **headers: str) -> None:
        self.code, self.body, self.headers = code, body, headers


class Cut(Trouble):
    """Promise more than is sent, and hang up."""


class Drip(Trouble):
    """Send a blank now and then, and never an answer."""


class Ended:
    """A message that ended for a reason, of so many tokens of a prompt."""

    def __init__(self, message: Body, finish: str = "stop", prompt: int = 100) -> None:
        self.message, self.finish, self.prompt = message, finish, prompt


def choices(body: Body) -> list[str]:
    """The actions that the tool of a request takes."""
    function = body["tools"][0]["function"]
    return function["parameters"]["properties"]["action"]["enum"]


def call(action: str, name: str = "act", **also: Any) -> Body:
    function = {"name": name, "arguments": json.dumps({"action": action, **also})}
    return {
        "role": "assistant",
        "tool_calls": [{"id": "c1", "type": "function", "function": function}],
    }


def says(text: str | None, **also: Any) -> Body:
    return {"role": "assistant", "content": text, **also}


def some_action(body: Body, number: int) -> Body:
    """An action that depends on everything in the request and nothing else."""
    listed = choices(body)
    return call(listed[zlib.crc32(json.dumps(body, sort_keys=True).encode()) % len(listed)])


class ScriptedServer:
    """What was asked, and how many requests were under way at the same time."""

    def __init__(self, script: Script) -> None:
        self.script = script
        self.asked: list[Body] = []
        self.keys: list[str | None] = []
        self.paths: list[str] = []
        self.most = self._now = 0
        self.closing = threading.Event()
        self._lock = threading.Lock()

    def answer(self, handler: BaseHTTPRequestHandler) -> None:
        body = json.loads(handler.rfile.read(int(handler.headers["Content-Length"])))
        with self._lock:
            number = len(self.asked)
            self.asked.append(body)
            self.paths.append(handler.path)
            self.keys.append(handler.headers["Authorization"])
            self._now += 1
            self.most = max(self.most, self._now)
        try:
            self._send(handler, self.script(body, number))
        except OSError:  # the client has lost patience
            handler.close_connection = True
        finally:
            with self._lock:
                self._now -= 1

    def _send(self, handler: BaseHTTPRequestHandler, said: Any) -> None:
        if isinstance(said, Status):
            content, code, headers = said.body.encode(), said.code, said.headers
        elif isinstance(said, Trouble):
            handler.send_response(200)
            handler.send_header("Content-Length", "1000")
            handler.end_headers()
            while isinstance(said, Drip) and not self.closing.wait(0.02):
                handler.wfile.write(b" ")
            handler.close_connection = True
            return
        else:
            if not isinstance(said, Ended):
                said = Ended(said, "tool_calls" if said.get("tool_calls") else "stop")
            reply = {
                "id": "r",
                "object": "chat.completion",
                "created": 0,
                "model": "scripted-1",
                "system_fingerprint": "fp_7",
                "choices": [{"index": 0, "message": said.message, "finish_reason": said.finish}],
                "usage": {"prompt_tokens": said.prompt, "completion_tokens": 5},
            }
            content, code, headers = json.dumps(reply).encode(), 200, {}
        handler.send_response(code)
        for name, value in {"Content-Type": "application/json", **headers}.items():
            handler.send_header(name.replace("_", "-"), value)
        handler.send_header("Content-Length", str(len(content)))
        handler.end_headers()
        handler.wfile.write(content)


@contextmanager
def scripted(script: Script = some_action) -> Iterator[tuple[ScriptedServer, str]]:
    """A server, and its address."""
    server = ScriptedServer(script)

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        server_version, sys_version = "Scripted/1", ""

        def do_POST(self) -> None:
            server.answer(self)

        def log_message(self, *_: Any) -> None:
            pass

    http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    http.daemon_threads = True
    thread = threading.Thread(target=http.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield server, f"http://127.0.0.1:{http.server_port}/v1"
    finally:
        server.closing.set()
        http.shutdown()
        http.server_close()
        thread.join()
