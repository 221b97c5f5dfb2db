"""Arguments of a wrong type: one sentence that names what is taken, and no traceback."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import causal_openlock as ol
from causal_openlock.analysis.results.material import Material
from causal_openlock.belief.trace import Trace
from causal_openlock.errors import OpenLockError

GRAPH = {"A": ["door"]}
schema: Any = ol.schema
make: Any = ol.make_experiment
sample_size: Any = ol.sample_size
worth: Any = ol.schema_worth
steps: Any = ol.knowledge_steps
plot: Any = ol.plot_knowledge_steps
plot_style: Any = ol.plot_style
compare: Any = ol.compare


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: make(["CC3"], ["random"], reward=3), "3 is not a reward"),
        (lambda: ol.make_experiment(["CC3"], ["random"], attempt_limit=2**70), "to 9,223"),
        (lambda: ol.make_experiment(["CC3"], ["random"], subjects=2**70), "10000000"),
        (lambda: schema(GRAPH, gates=["any"]), "gates are {node: gate}"),
        (lambda: schema(GRAPH, strengths=[1]), "strengths are {(cause, effect): strength}"),
        (lambda: schema(GRAPH, inert=3), "inert levers are a list"),
        (lambda: sample_size(sd=5, subjects=40, alpha=0.9), "alpha has to be"),
        (lambda: sample_size(2, sd=5, alpha=1e-300), "alpha has to be"),
        (lambda: sample_size(2, sd=5, alpha=None), "alpha has to be"),
        (lambda: plot(x=3), "plot_knowledge_steps has no argument x; did you mean ax?"),
        (lambda: plot_style(3), "plot_style takes a PlotStyle, and not int"),
        (lambda: plot_style(rc=3), "rc is settings of matplotlib, {name: value}, not 3"),
        (lambda: compare("CC3", "oracle", out=3), "a folder is given by its path, not by int"),
        (lambda: compare("default", subjects=1, out=3), "given by its path, not by int"),
    ],
)
def test_a_wrong_type_is_one_sentence(call: Callable[[], object], said: str) -> None:
    with pytest.raises(OpenLockError) as caught:
        call()
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: make(3, "random"), "3 is not a condition"),
        (lambda: make("CC3", 3), "3 is not a learner"),
        (lambda: ol.watch("oracle", "CC3", layout=3), "3 is not a layout"),  # type: ignore[arg-type]
        (lambda: ol.open_results(3), "given by its path, not by int"),  # type: ignore[arg-type]
    ],
)
def test_what_is_named_wrongly_is_one_sentence(call: Callable[[], object], said: str) -> None:
    with pytest.raises(OpenLockError) as caught:
        call()
    assert said in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_a_condition_and_a_learner_need_no_list() -> None:
    made = ol.make_experiment("CC3", "random")
    assert made.identity == ol.make_experiment(["CC3"], ["random"]).identity


FIGURES = {name for name in dir(ol) if name.startswith("plot_")}


@pytest.mark.parametrize(
    "name", sorted(FIGURES - {"plot_style", "plot_understanding", "plot_knowledge_steps"})
)
def test_a_plot_function_refuses_what_it_cannot_draw_in_a_sentence(name: str) -> None:
    figure: Any = getattr(ol, name)
    for values, kind in (((3,), "int"), ((), "NoneType")):
        with pytest.raises(OpenLockError, match=f"{name} draws .*, and not {kind}"):
            figure(*values)
    given = object.__new__(Trace if name == "plot_trace" else Material)
    with pytest.raises(OpenLockError, match=f"{name} has no argument conditionz"):
        figure(given, conditionz=["CC4"])


def test_many_settings_of_a_protocol_still_have_a_name() -> None:
    settings = {"attempt_limit": 10, "baseline_trials": 2, "training_trials": 3, "action_limit": 5}
    made = ol.make_experiment(["CC3"], ["random"], protocol={**settings, "train_loops": 2})
    again = ol.make_experiment(["CC3"], ["random"], protocol={**settings, "train_loops": 3})
    names = [one.learners[0].protocol.name for one in (made, again)]
    assert all(name.startswith("human_") and len(name) <= 64 for name in names)
    assert names[0] != names[1]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: worth("CC3", among=3), "among is schemas"),
        (lambda: worth("CC3", among={"CE3": "2"}), "the weight of CE3"),
        (lambda: worth("CC3", among=["grammar", "CE3"]), "grammar stands alone"),
        (lambda: worth("CC3", "grammar", concentration="x"), "a concentration has to be"),
        (lambda: worth("CC3", "grammar", after="CE3"), "after is a list of schemas"),
        (lambda: worth("CC3", "CE3", action_limit=140), "more than 63 actions"),
        (lambda: steps("CC3"), "conditions are a list of names"),
        (lambda: steps([3]), "nothing is known of people in 3"),
        (lambda: steps(["chain3"]), "nothing is known of people in chain3"),
        (lambda: plot(steps(["CC3"])), "CC4, CE4 and CE3 are missing"),
        (lambda: plot(3), "draws steps, which knowledge_steps returns, and not int"),
    ],
)
def test_what_knowledge_is_worth_takes_what_it_can(call: Callable[[], object], said: str) -> None:
    with pytest.raises(OpenLockError) as caught:
        call()
    assert said in str(caught.value)


def test_a_condition_that_is_named_twice_is_counted_once() -> None:
    assert len(steps(["CC3", "CC3"])) == len(steps(["CC3"]))


@pytest.mark.parametrize("name", ["CC4", "CC3-CC4", "shown-CC3-CC4"])
def test_a_condition_in_place_of_an_experiment_is_told_how_it_is_played(name: str) -> None:
    with pytest.raises(OpenLockError, match=f"is played by: compare --condition {name}$"):
        ol.find_experiment(name)
    with pytest.raises(OpenLockError, match=r"or give the path of a .yaml file$"):
        ol.find_experiment(f"{name}-CC9")
