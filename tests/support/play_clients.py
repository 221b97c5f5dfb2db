"""Playing as the page does: servers in processes of their own, calls, and what solves a room."""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import urllib.request
from contextlib import contextmanager
from secrets import token_urlsafe

from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.play.people import People
from support.waiting import HANGS


def people(folder, *conditions, **options):
    """People in a folder, under the protocol of people."""
    chosen = [find_condition(name) for name in conditions or ("CC3",)]
    return People(folder, chosen, PROTOCOLS["human"], **options)


def solving(home, name):
    """The actions of each solution of the room that a person is in."""
    truth = home.game(name).session.truth
    room = truth.rooms[int(truth.room[0])]
    return [room.action_of(levers) for levers in room.schema.solutions]


def walk_through(home, name, trials=None):
    """Find every solution of every room at once; returns what was done."""
    done = []
    while (state := home.view(name))["stage"] == "room" and trials != 0:
        for actions in solving(home, name):
            for action in actions:
                state = home.take(name, state["turn"], action=action, reaction=700)["next"]
                done.append(action)
        trials = None if trials is None else trials - 1
    return done


def asked(url, path, **sent):
    """What the server answers."""
    who = sent.pop("id", None)
    body = json.dumps(sent).encode() if sent or path == "join" else None
    headers = {"Authorization": f"Bearer {who}"} if who else {}
    request = urllib.request.Request(url + path, body, headers)
    with urllib.request.urlopen(request, timeout=20) as answer:
        return json.load(answer)


def play_one_lever(url):
    """Join, and solve a room in which the only grey lever unlocks the door."""
    me = token_urlsafe(24)
    room = asked(url, "join", id=me)
    assert (room["stage"], room["room"]["solutions_left"]) == ("room", 1)
    grey = room["room"]["observation"].index(1, 7) - 7
    for turn, action in enumerate((grey, 14)):
        after = asked(url, "turn", id=me, turn=turn, action=action, reaction=None)
    assert after["new_solution"]


class Server:
    """A server in a process of its own."""

    def __init__(self, folder, *words, port=0):
        command = [sys.executable, "-m", "causal_openlock", "play", "--out", str(folder)]
        self.process = subprocess.Popen(
            [*command, "--port", str(port), "--no-browser", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
        said = self.process.stdout.readline()
        found = re.search(r"http://([\d.]+):(\d+)/", said)
        if found is None:
            self.process.kill()
            raise AssertionError(said + self.process.communicate()[1])
        self.url, self.host, self.port = found[0], found[1], int(found[2])

    def kill(self):
        """End it as a power cut would."""
        self.process.send_signal(signal.SIGKILL)
        self.process.communicate()

    def stop(self):
        """End it as Ctrl-C does; returns what it said on standard error."""
        self.process.send_signal(signal.SIGINT)
        said = self.process.communicate(timeout=HANGS)[1]
        assert self.process.returncode == 0, said
        return said


@contextmanager
def serving(folder, *words, port=0):
    """A server that is gone after the block."""
    server = Server(folder, *words, port=port)
    try:
        yield server
    finally:
        if server.process.poll() is None:
            server.kill()


class Caller:
    """Calls a server; keeps everything that it answers."""

    def __init__(self, port, host="127.0.0.1"):
        self.connection = http.client.HTTPConnection(host, port, timeout=HANGS)
        self.port = port
        self.answers = []

    def call(self, path, body=None, name=None, headers=None):
        """Status and answer; a body makes it a POST."""
        head = dict(headers or {})
        if name is not None:
            head["Authorization"] = f"Bearer {name}"
        sent = body if body is None or isinstance(body, bytes) else json.dumps(body).encode()
        self.connection.request("GET" if body is None else "POST", path, sent, head)
        answer = self.connection.getresponse()
        text = answer.read().decode()
        self.answers.append(f"{answer.headers}{text}")
        self.headers = answer.headers
        is_json = answer.headers["Content-Type"] == "application/json"
        return answer.status, json.loads(text) if is_json else text

    def join(self):
        """A new session."""
        name = token_urlsafe(24)
        assert self.call("/join", {}, name)[0] == 200
        return name
