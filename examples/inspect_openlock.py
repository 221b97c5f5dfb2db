"""OpenLock as a task for Inspect: in how many rooms does a model find every solution?

Serve the rooms, with ``pip install 'causal-openlock[mcp]'``::

    causal-openlock serve CC4 --as my_agent --http 8631 --out results/agents

and evaluate, in another environment, with ``pip install causal-openlock inspect_ai 'mcp<2'``, as
Inspect speaks to servers by an earlier version of ``mcp``, and the package of the model::

    inspect eval inspect_openlock.py --model openai/gpt-5-mini -T subjects=10

Each sample is a subject, under a name of its own. What it did is the record in ``results/agents``.
"""

from __future__ import annotations

import csv
from pathlib import Path

from anyio import sleep
from inspect_ai import Task, task
from inspect_ai.agent import as_solver, react
from inspect_ai.dataset import Sample
from inspect_ai.scorer import Score, Scorer, Target, mean, scorer, stderr
from inspect_ai.solver import Generate, Solver, TaskState, solver
from inspect_ai.tool import mcp_server_http

import causal_openlock as ol

PROMPT = "You are in an experiment. Call the tool `look`, then `act` until nothing is left to do."


@task
def openlock(subjects: int = 4, folder: str = "results/agents", port: int = 8631) -> Task:
    """One subject in each sample, in the rooms that are served at this port."""
    samples = [Sample(input=PROMPT, id=number) for number in range(1, subjects + 1)]
    return Task(samples, solver=plays(port), scorer=rooms_solved(folder), message_limit=2000)


@solver
def plays(port: int) -> Solver:
    """Act through the tools of the subject of this sample."""

    async def solve(state: TaskState, generate: Generate) -> TaskState:
        rooms = mcp_server_http(url=f"http://127.0.0.1:{port}/{state.uuid}")
        return await as_solver(react(tools=[rooms]))(state, generate)

    return solve


@scorer(metrics=[mean(), stderr()])
def rooms_solved(folder: str) -> Scorer:
    """The share of rooms in which the subject found every solution, from the record."""

    async def score(state: TaskState, target: Target) -> Score:
        await sleep(3)  # the record is written within a second or two after the last action
        with (Path(folder) / "recruited.csv").open(newline="") as file:
            joined = {row["name"]: int(row["join"]) for row in csv.DictReader(file)}
        trials = ol.open_results(folder).trials
        own = trials[trials["subject"] == joined[state.uuid]]
        return Score(value=float(own["solved"].mean()), explanation=f"of {len(own)} rooms")

    return score
