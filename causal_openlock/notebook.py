"""HTML that notebooks show for schemas, rooms, trials, experiments, learners and results.

IPython keeps formatters by the name of a type and loads nothing for them: importing
:mod:`causal_openlock` where IPython runs registers those here (:func:`register_formatters`).
Pictures are inline SVG, nothing is loaded from elsewhere.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from html import escape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from causal_openlock.wording import counted, first_line

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.analysis.report.writing import Report
    from causal_openlock.comparison.results import Results
    from causal_openlock.contract.learner import Learner
    from causal_openlock.envs.playable import PlayableRoom, Seen
    from causal_openlock.experiment.declare import Experiment
    from causal_openlock.render.film import Shot
    from causal_openlock.render.watch import WatchedTrial
    from causal_openlock.schemas.schema import Schema
    from causal_openlock.world.room import Room

LARGEST = 600_000  # characters of a strip of pictures, to which no more pictures are added
_CARD = "display:inline-block;background:#fff;color:#000;padding:0.6em;max-width:100%"
_ROW = "display:flex;flex-wrap:wrap;gap:0.5em;align-items:flex-start"


def schema_html(schema: Schema) -> str:
    """A schema: its graph, and the solutions that follow from it."""
    from causal_openlock.render.graph import heading, save_schema_figure, solutions_text

    with TemporaryDirectory() as folder:
        path = Path(folder, "graph.svg")
        save_schema_figure(schema, path)
        svg = path.read_text(encoding="utf-8")
    # matplotlib's style sheet would hold for the whole page.
    graph = re.sub(r"<(style|metadata).*?</\1>", "", svg, flags=re.DOTALL)
    graph = graph.replace("<svg ", '<svg style="stroke-linejoin: round; stroke-linecap: butt" ', 1)
    return _card(heading(schema), _inline(graph), _text(*solutions_text(schema)))


def room_html(room: Room) -> str:
    """A room at the start of an attempt, and the position of each lever."""
    places = room.layout.as_mapping(room.schema).items()
    listed = ", ".join(f"{lever} {place}" for lever, place in places)
    title = f"{room.schema.name} in {room.layout.name}"
    return _room(title, room.observation[0], None, _text(listed))


def seen_html(seen: Seen) -> str:
    """An action in a room, its result, and the console."""
    return _room(seen.title, seen.observation, seen.panel)


def playable_html(room: PlayableRoom) -> str:
    """A room to try out, as it is now, and how to act in it."""
    names = ", ".join(name.removeprefix("push ") for name in room.actions[: room.positions])
    title = f"{room.schema.name} in {room.layout.name}"
    how = _text(f"push or pull {names}; or push door")
    return _room(title, room.observation, room.panel, how)


def opened_html(opened: Any) -> str:
    """The link of a room that is open in the browser."""
    url = escape(opened.url)
    return _card(repr(opened).strip("<>"), f'<div><a href="{url}" target="_blank">{url}</a></div>')


def watched_html(watched: WatchedTrial) -> str:
    """A trial as a strip of pictures, one after each action; of a long one the first."""
    shots = [shot for shot in watched.shots if shot.action or shot is watched.shots[0]]
    strip = [_moment(watched, shots[0])]
    while len(strip) < len(shots) and sum(map(len, strip)) < LARGEST:
        strip.append(_moment(watched, shots[len(strip)]))
    if more := len(shots) - len(strip):
        strip.append(_text(f"and {counted(more, 'more action')}"))
    legend = "Arrows are what it believes, the darker the more probable; dashed: the true schema."
    below = [f"<small>{legend}</small>"] if watched.trace else []
    return _card(watched.title, f'<div style="{_ROW}">{"".join(strip)}</div>', *below)


def _moment(watched: WatchedTrial, shot: Shot) -> str:
    """A moment of a trial: the room, and what the learner believes."""
    from causal_openlock.belief.trace import belief_in_words
    from causal_openlock.render.paint import room_svg
    from causal_openlock.render.watch import belief_svg, in_words

    words = in_words(shot)
    pictures = [_inline(room_svg(shot.look, None, words))]
    if (belief := watched.belief(shot)) and watched.trace:
        pictures.append(_inline(belief_svg(belief, watched.trace)))
        words += f"; {belief_in_words(belief)}"
    size = r'width="[\d.]+in" height="[\d.]+in"'
    row = re.sub(size, 'style="width:14em;height:auto"', "".join(pictures))
    style = f"margin:0.3em;width:{15 * len(pictures)}em;font-size:80%"
    caption = f"<figcaption>{escape(words)}</figcaption>"
    return f'<figure style="{style}"><div style="{_ROW}">{row}</div>{caption}</figure>'


def experiment_html(experiment: Experiment) -> str:
    """An experiment: who plays what, and how much work that is."""
    from causal_openlock.analysis.report.described import described, pairs
    from causal_openlock.contract.registry import changed_parameters

    learners = described(experiment)["Learners"]
    learners["Parameters"] = [
        # Showing results runs no code that they name.
        pairs(
            spec.parameters if spec.recorded else changed_parameters(spec.learner, spec.parameters)
        )
        or "defaults"
        for spec in experiment.learners
    ]
    names = ", ".join(condition.name for condition in experiment.conditions)
    cells = counted(len(experiment.cells()), "cell")
    summary = _text(f"conditions {names}; seed {experiment.seed}; {cells}")
    return _card(experiment.title or experiment.name, _table(learners), summary)


def learner_html(learner: Learner) -> str:
    """A learner: what it is, and its hyper-parameters, with defaults where they differ."""
    import pandas as pd

    from causal_openlock.contract.one_subject import PerSubjectAdapter
    from causal_openlock.contract.registry import parameter_table

    kind = learner.single if isinstance(learner, PerSubjectAdapter) else type(learner)
    rows = []
    for parameter in parameter_table(type(learner.parameters)):
        value = getattr(learner.parameters, parameter.name)
        default = "" if value == parameter.default else f" (default {parameter.default})"
        rows.append((parameter.name, f"{value}{default}", parameter.meaning))
    table = _table(pd.DataFrame(rows, columns=["parameter", "value", "meaning"])) if rows else ""
    return _card(kind.__name__, _text(first_line(kind.__doc__)), table)


def results_html(results: Results) -> str:
    """Results: the leaderboard of each protocol, and below it what a reader should know."""
    from causal_openlock.analysis.topics.leaderboard import leaderboard_tables

    parts = []
    for table in leaderboard_tables(results.leaderboard).values():
        parts += [_text(table.title), _left(table.html()), _small(table.caption)]
    return _card(results.experiment.title, *parts, *map(_small, results.warnings))


def report_html(report: Report) -> str:
    """The page of a report, in a frame."""
    page = escape(report.path.read_text(encoding="utf-8"))
    look = "width:100%;height:40em;border:1px solid #ccc;background:#fff"
    return f'<iframe style="{look}" srcdoc="{page}"></iframe>{_text(str(report.path))}'


SHOWN_AS: dict[str, Callable[[Any], str]] = {
    "causal_openlock.schemas.schema.Schema": schema_html,
    "causal_openlock.world.room.Room": room_html,
    "causal_openlock.envs.playable.PlayableRoom": playable_html,
    "causal_openlock.envs.playable.Seen": seen_html,
    "causal_openlock.play.background.OpenedRoom": opened_html,
    "causal_openlock.render.watch.WatchedTrial": watched_html,
    "causal_openlock.experiment.declare.Experiment": experiment_html,
    "causal_openlock.contract.learner.Learner": learner_html,
    "causal_openlock.comparison.results.Results": results_html,
    "causal_openlock.analysis.report.writing.Report": report_html,
}  #: formatter of the instances of each type and of its subclasses


def register_formatters() -> None:
    """Register every formatter with IPython, where it runs, by name of type: nothing is loaded."""
    from IPython.core.getipython import get_ipython

    shell: Any = get_ipython()
    if shell:
        html = shell.display_formatter.formatters["text/html"]
        for kind, formatter in SHOWN_AS.items():
            html.for_type_by_name(*kind.rsplit(".", 1), formatter)


# -- pieces of HTML -------------------------------------------------------------------------------


def _card(title: str, *parts: str) -> str:
    """A heading and what is below it, dark on white whatever the notebook's colours are."""
    return f'<div style="{_CARD}"><b>{escape(title)}</b>{"".join(parts)}</div>'


def _text(*lines: str) -> str:
    return f"<div>{'<br>'.join(map(escape, lines))}</div>"


def _small(text: str) -> str:
    return f"<div><small>{escape(text)}</small></div>"


def _table(frame: pd.DataFrame) -> str:
    from causal_openlock.analysis.table import Table

    return _left(Table("", "", frame, verbatim=True).html())


def _left(table: str) -> str:
    """A table without the page's style: texts stand on the left, small type below."""
    left = re.sub(r' class="(?:name|text)"', ' style="text-align:left"', table)
    return left.replace("<small>", "<br><small>")


def _room(title: str, observation: Any, panel: Any, *below: str) -> str:
    """A room as an observation shows it, with or without its console."""
    from causal_openlock.render.paint import room_svg
    from causal_openlock.render.scene import Look

    look = Look.of_observation(observation, len(observation) // 2 - 1)
    return _card(title, _inline(room_svg(look, panel, title)), *below)


def _inline(svg: str) -> str:
    """An SVG document for inside a page."""
    return f"<div>{svg[svg.index('<svg') :]}</div>"
