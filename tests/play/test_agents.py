"""Agents that play through the tools of a server: over stdio, over HTTP, and after a kill."""

import asyncio
import os
import random
import signal
import subprocess
import sys
from contextlib import asynccontextmanager

import pytest
from mcp.client.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

import causal_openlock as ol
from causal_openlock.experiment.beside_record import read_answers
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.play.agents import LAST, Agents, Subject, options_of
from causal_openlock.play.game import Refused
from causal_openlock.play.recruiting import read_identifiers
from causal_openlock.render.words import Wording, feedback, room_now
from causal_openlock.storage.store import Store
from causal_openlock.world.randomness import generators
from support.play_clients import people

ENVIRONMENT = {**os.environ, "PYTHONUNBUFFERED": "1"}
LATENT = ("CC", "CE", "L0", "L1", "P0", "role", "schema", "cause of", "common")


def over_stdio(folder, *words):
    """A client of a command that is started for it."""
    command = ["-m", "causal_openlock", "serve", "CC3", "--out", str(folder), *words]
    return Client(
        stdio_client(StdioServerParameters(command=sys.executable, args=command, env=ENVIRONMENT))
    )


async def call(client, tool, **given):
    """The text that a tool answers, and whether it says that something was wrong."""
    answer = await client.call_tool(tool, given)
    return answer.content[0].text, answer.is_error


async def actions_of(client):
    """The names that a subject has for its actions."""
    (act,) = [tool for tool in (await client.list_tools()).tools if tool.name == "act"]
    return act.input_schema["properties"]["action"]["enum"]


async def play(client, luck, most=10_000):
    """Act at random to the end; what was done, and all that was told."""
    choices, done, told = await actions_of(client), [], [(await call(client, "look"))[0]]
    while LAST not in told[-1] and len(done) < most:
        done.append(luck.choice(choices))
        text, wrong = await call(client, "act", action=done[-1])
        assert not wrong
        told.append(text)
    return done, told


@asynccontextmanager
async def within(folder, *conditions, ask=False, mode="auto"):
    """A client in this process, with the people that it is one of."""
    home = people(folder, *conditions, **options_of("mine", 0, ask))
    try:
        async with Client(Agents(home, "me").server, mode=mode) as client:
            yield client, home
    finally:
        home.close()


def same_in_a_session(done, condition="CC3", label="mine"):
    """The record of a session in which the same is done, and what it says in words."""
    session = Session(
        find_condition(condition), PROTOCOLS["human"], [0], learner=label, experiment="agents"
    )
    (luck,) = generators(0, f"words/{condition}", [0])
    words = Wording.draw(session.brief.positions, luck)
    told = [room_now(words, session.view, 0, session.brief.trials)]
    for action in done:
        step = session.step([words.read(action)])
        told.append(feedback(words, step, 0, session.brief.trials))
    return untimed(session.record()), told


def untimed(record):
    return record.drop_columns(["wall_time"]).to_pylist()


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_an_agent_is_told_what_a_session_tells_and_leaves_its_record(tmp_path, mode):
    async def played():
        async with within(tmp_path, mode=mode) as (client, _):
            return await play(client, random.Random(1))

    done, told = asyncio.run(played())
    record, expected = same_in_a_session(done)
    assert told[0].endswith(expected[0])
    assert told[1:-1] == expected[1:-1]
    assert told[-1] == f"{expected[-1]}\n\n{LAST}"
    assert untimed(Store(tmp_path).record()[0]) == record
    assert not [text for text in told for latent in LATENT if latent in text]


def test_nonsense_changes_nothing_and_tells_nothing(tmp_path):
    async def told():
        async with within(tmp_path) as (client, home):
            before = await call(client, "look")
            answers = [
                await call(client, "act", action="open sesame"),
                await call(client, "act"),
                await call(client, "act", action=3),
                await call(client, "act", action=(await actions_of(client))[0], why="x"),
                await call(client, "open", solution=True),
                await call(client, "explain", enables=[]),
            ]
            assert await call(client, "look") == before
            (game,) = home._games
            assert game.turn == 0
            return answers

    for text, wrong in asyncio.run(told()):
        assert wrong
        assert "nothing was done" in text.lower()


def test_what_enables_what_is_kept_as_people_answer_it(tmp_path):
    async def told():
        async with within(tmp_path, ask=True) as (client, home):
            subject = Subject(home, "me")
            room = subject.game.session.truth.rooms[0]
            solutions = [room.action_of(levers) for levers in room.schema.solutions]
            for action in [action for one in solutions for action in one]:
                text, _ = await call(client, "act", action=subject.words.actions[action])
            assert "call the tool `explain`" in text
            asked = subject.game.view()["levers"]
            names = [subject.words.nodes[place] for place in (*asked, -1)]
            white = next(name for name in subject.words.names if name not in names)
            for pair in ({"cause": names[0], "effect": white}, {"cause": "nobody"}, 3):
                assert (await call(client, "explain", enables=[pair]))[1]
            assert "Nothing was done" in (await call(client, "act", action="push the door"))[0]
            pairs = [{"cause": names[0], "effect": names[-1]}]
            text, wrong = await call(client, "explain", enables=pairs)
            assert not wrong
            assert "2 of 5" in text
            return asked[0]

    cause = asyncio.run(told())
    answers = read_answers(tmp_path).to_pandas()
    assert set(answers["learner"]) == {"mine"}
    assert answers["enables"].sum() == 1
    assert set(answers[answers["enables"]]["cause"]) == {cause}


def test_rooms_that_are_shown_are_watched_before_the_own_ones(tmp_path):
    async def told():
        async with within(tmp_path, "shown-CC3-CC4") as (client, home):
            refused, _ = await call(client, "act", action=(await actions_of(client))[0])
            (game,) = home._games
            assert game.session.shown is None
            return refused

    text = asyncio.run(told())
    assert text.startswith("Nothing was done.")
    assert "You watch what somebody does" in text
    assert text.count("> ") >= 6 * 2 * 3
    assert "7 of 7, attempt 1" in text.splitlines()[-3]


def test_what_was_shown_is_told_again_and_a_question_outlives_the_server(tmp_path):
    async def looked(**options):
        async with within(tmp_path, "shown-CC3-CC4", **options) as (client, _):
            tools = [tool.name for tool in (await client.list_tools()).tools]
            return (await call(client, "look"))[0], tools

    first = asyncio.run(looked(ask=True))
    assert asyncio.run(looked(ask=False)) == first
    assert first[0].count("> ") >= 6 * 2 * 3
    assert "explain" in first[1]


@pytest.mark.parametrize("name", ["", " ", "x" * 400, "{name}", "'=1", "a\nb", "a/b"])
def test_names_that_can_be_none_are_refused(tmp_path, name):
    home = people(tmp_path, **options_of("mine", 0, False))
    with pytest.raises(Refused, match="the name of a subject"):
        Subject(home, name)
    home.close()


@pytest.mark.slow
def test_over_stdio_a_killed_server_loses_nothing_and_its_subject_continues(tmp_path):
    killed, folder = [], tmp_path / "agents"

    async def begun():
        async with over_stdio(folder, "--as", "mine", "--name", "one") as client:
            done, _ = await play(client, random.Random(2), most=40)
            found = subprocess.run(
                ["pgrep", "-f", str(folder)], capture_output=True, text=True, check=True
            )
            killed.extend(found.stdout.split())
            os.kill(int(killed[0]), signal.SIGKILL)
            return done

    async def ended():
        async with over_stdio(folder, "--as", "mine", "--name", "one") as client:
            return await play(client, random.Random(3))

    done = asyncio.run(begun())
    more, told = asyncio.run(ended())
    assert len(done) == 40
    assert "attempt 14" in told[0]
    record, _ = same_in_a_session([*done, *more])
    assert untimed(Store(folder).record()[0]) == record


@pytest.mark.slow
def test_fifty_sessions_over_http_are_fifty_subjects_side_by_side(tmp_path):
    async def one(url, name, most):
        async with Client(f"{url}{name}") as client:
            return await play(client, random.Random(name), most)

    async def all_of(url, names, most=10_000):
        return await asyncio.gather(*(one(url, name, most) for name in names))

    names = [f"subject-{number}" for number in range(50)]
    with ol.serve("CC3", label="mine", out=tmp_path) as opened:
        begun = asyncio.run(all_of(opened.url, names, most=3))
        ended = asyncio.run(all_of(opened.url, names[:1]))
    assert len({first[1][0] for first in begun}) == 50  # words of their own
    given = {row["name"]: number for number, row in read_identifiers(tmp_path).items()}
    record = Store(tmp_path).record()[0].to_pandas()
    for name, (first, _), (rest, _) in zip(names, begun, ended, strict=False):
        own = record[record["subject"] == given[name]]
        assert own["actions"].map(len).sum() == len(first) + len(rest)
        assert len(rest) > 3
    assert sorted(given.values()) == [*range(50)]


@pytest.mark.slow
def test_an_agent_stands_in_every_table_beside_learners(tmp_path):
    async def played():
        async with within(tmp_path / "agents", ask=False) as (client, _):
            await play(client, random.Random(4))

    asyncio.run(played())
    asked = {"subjects": 2, "workers": 0, "out": tmp_path / "both"}
    results = ol.compare(["CC3"], ["win_stay"], beside=[tmp_path / "agents"], **asked)
    assert {"mine", "win_stay"} == set(results.learners)
    assert "mine" in set(results.leaderboard["learner"])
