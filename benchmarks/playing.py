"""People in the browser: how fast their clicks are answered, and whether any is lost by a crash.

A hundred players on loopback each click about every second, some ten times as fast as people do,
who look, think, and wait for the arm. Meanwhile their first trials end, and the record of each is
written. Half-way through, the server is killed and started again. A player whose click was not
answered sends it again, as the page does. In the end what is on file must be what was answered,
click by click.

The players share the machine with the server, so the times include the client's own.
"""

from __future__ import annotations

import asyncio
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from measure import Row, Target

PLAYERS = 100
SECONDS = 10.0
"""For how long they play on each side of the crash."""
PAUSE = 1.0
"""Seconds between two clicks of a player, on average."""
NEAR_THE_END = 88
"""After so many clicks of its 90 a player's first trial is nearly over."""
ANSWER = 0.05
"""Seconds within which 99 of 100 clicks must be answered."""


def playing(repeats: int) -> Iterator[Row]:
    """The 99th percentile of the time to an answer, with a crash in each turn."""
    times: list[float] = []
    lost = clicks = 0
    slowest, back = 0.0, []
    for _ in range(min(repeats, 3)):  # a turn takes half a minute
        turn = asyncio.run(_turn())
        times.append(turn.percentile(99))
        slowest = max(slowest, max(turn.seconds))
        lost += turn.lost
        clicks += len(turn.seconds)
        back.append(turn.back)
    yield Row(
        "playing",
        f"a click is answered (p99), {PLAYERS} players",
        "s",
        times,
        target=Target("at most", ANSWER, on="ours"),
        broken=f"{lost} clicks lost" if lost else "",
        note=(
            f"{clicks:,} clicks, the slowest {1000 * slowest:.0f} ms; {lost} lost when the server "
            f"was killed; it was back after {max(back):.1f} s"
        ),
    )


@dataclass
class Turn:
    """What came of one turn.

    Attributes:
        seconds: From each click to its answer, while the server was up.
        lost: Clicks that were answered and are not on file, or are there otherwise.
        back: Seconds from the crash to the first answer after it.
    """

    seconds: list[float] = field(default_factory=list)
    lost: int = 0
    back: float = 0.0

    def percentile(self, percent: int) -> float:
        """The time within which so many of a hundred clicks were answered."""
        ordered = sorted(self.seconds)
        return ordered[min(len(ordered) * percent // 100, len(ordered) - 1)]


async def _turn() -> Turn:
    turn = Turn()
    with TemporaryDirectory() as folder:
        server, port = _start(Path(folder), 0)
        players = [Player(port, turn, number) for number in range(PLAYERS)]
        try:
            await asyncio.gather(*(player.join() for player in players))
            await asyncio.gather(*(player.hurry() for player in players))
            await asyncio.gather(*(player.play(SECONDS) for player in players))
            # Killed with calls under way: every player has just clicked.
            calls = [asyncio.create_task(player.click(timed=False)) for player in players]
            await asyncio.sleep(0.01)
            server.send_signal(signal.SIGKILL)
            server.wait()
            began = time.perf_counter()
            server, _ = _start(Path(folder), port)
            turn.back = time.perf_counter() - began
            await asyncio.gather(*calls)
            await asyncio.gather(*(player.play(SECONDS) for player in players))
        finally:
            server.send_signal(signal.SIGINT)
            server.wait()
        turn.lost = _lost(Path(folder), players)
    return turn


def _start(folder: Path, port: int) -> tuple[subprocess.Popen[str], int]:
    words = ["play", "--condition", "CC4", "--no-practice", "--no-browser"]
    server = subprocess.Popen(
        [sys.executable, "-m", "causal_openlock", *words, "--out", folder, "--port", str(port)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert server.stdout is not None
    found = re.search(r":(\d+)/", server.stdout.readline())
    assert found is not None
    return server, int(found[1])


class Player:
    """Clicks at random, with a connection that is kept open."""

    def __init__(self, port: int, turn: Turn, number: int) -> None:
        self.port, self.turn, self.number = port, turn, number
        self.random = random.Random(number)
        self.name = ""
        self.at = 0
        self.answered: list[int] = []
        self.streams: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    async def join(self) -> None:
        """Get a session."""
        self.name = (await self._call("/join", {}))["id"]

    async def hurry(self) -> None:
        """Click until the end of the first trial is near, so that records are written meanwhile."""
        for _ in range(NEAR_THE_END - self.number % 20):
            await self.click(timed=False)

    async def play(self, seconds: float) -> None:
        """Click until the time is over."""
        until = time.perf_counter() + seconds
        while time.perf_counter() < until:
            await asyncio.sleep(self.random.uniform(0, 2 * PAUSE))
            await self.click()

    async def click(self, timed: bool = True) -> None:
        """One click, sent again until it is answered; refused if it was on file already."""
        action = self.random.randrange(15)
        call = {"turn": self.at, "action": action, "reaction": 1}
        while True:
            began = time.perf_counter()
            try:
                await self._call("/act", call)
                break
            except (OSError, EOFError):
                self.streams = None
                await asyncio.sleep(0.2)
        if timed:
            self.turn.seconds.append(time.perf_counter() - began)
        self.answered.append(action)
        self.at += 1

    async def _call(self, path: str, body: dict[str, Any]) -> Any:
        if self.streams is None:
            self.streams = await asyncio.open_connection("127.0.0.1", self.port)
        reader, writer = self.streams
        content = json.dumps(body).encode()
        writer.write(
            f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\n"
            f"Authorization: Bearer {self.name}\r\nContent-Length: {len(content)}\r\n\r\n".encode()
            + content
        )
        head = (await reader.readuntil(b"\r\n\r\n")).decode()
        length = re.search(r"content-length: (\d+)", head, re.IGNORECASE)
        assert length is not None
        said = json.loads(await reader.readexactly(int(length[1])))
        status = head.split()[1]
        # Out of turn is the answer to a click that was on file when the server died.
        assert status == "200" or (status == "409" and said["now"]["turn"] == self.at + 1), said
        return said


def _lost(folder: Path, players: list[Player]) -> int:
    """How many clicks differ between what was answered and what is on file."""
    from causal_openlock.experiment.protocol import PROTOCOLS, Condition
    from causal_openlock.experiment.reactions import read_reactions
    from causal_openlock.play.people import People
    from causal_openlock.schemas.finding import find_schema

    home = People(folder, [Condition.named("CC4", find_schema)], PROTOCOLS["human"])
    subjects = [home._find(player.name).cell.first_subject for player in players]
    home.close()
    rows = read_reactions(folder).to_pandas()
    kept = {subject: own["action"].tolist() for subject, own in rows.groupby("subject")}
    lost = 0
    for subject, player in zip(subjects, players, strict=True):
        mine = kept.get(subject, [])
        differing = sum(a != b for a, b in zip(mine, player.answered, strict=False))
        lost += differing + abs(len(mine) - len(player.answered))
    return lost
