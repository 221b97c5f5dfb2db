"""The order in which cells are given to workers."""

from concurrent.futures import Executor, Future
from typing import Any

import pytest

from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.running.workers import ExternalExecutor


class Noting(Executor):
    """Notes cells and plays none."""

    def __init__(self):
        self.given: list[str] = []

    def submit(self, job, /, *arguments, **_):
        self.given.append(arguments[0].spec.name)
        future: Future[Any] = Future()
        future.set_result([])
        return future


@pytest.mark.parametrize(
    ("workers", "order"),
    [
        (9, ["ddqn", "oracle", "random", "semi_markov_ddqn", "bayes_net_ddqn"]),
        # Those of the first two are known once they have ended.
        (2, ["ddqn", "oracle", "semi_markov_ddqn", "bayes_net_ddqn", "random"]),
    ],
)
def test_one_cell_compiles_while_others_play_what_needs_no_compiling(
    tmp_path, monkeypatch, workers, order
):
    file = tmp_path / "order.yaml"
    file.write_text(
        "name: order\nconditions: [CC3]\nsubjects: 1\n"
        "learners: [ddqn, semi_markov_ddqn, bayes_net_ddqn, oracle, random]\n"
    )
    noting = Noting()
    ended: list[Future[Any]] = []
    done = ExternalExecutor.done

    def free(_):
        return len(noting.given) - len(ended) < workers

    def note(self, future):
        ended.append(future)
        return done(self, future)

    monkeypatch.setattr(ExternalExecutor, "free", free)
    monkeypatch.setattr(ExternalExecutor, "done", note)
    run(read_experiment(file), tmp_path / "out", executor=noting)
    assert noting.given == order
