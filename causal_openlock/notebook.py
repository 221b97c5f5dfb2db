"""HTML that notebooks show for schemas, rooms, trials, experiments, learners and results.

IPython keeps formatters by the name of a type and loads nothing for them, so nothing else in the
package knows about display: importing :mod:`causal_openlock` where IPython runs registers what
is here (:func:`register_formatters`). Everything shown is one piece of HTML: pictures are inline
SVG, nothing is loaded from elsewhere.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from causal_openlock.wording import counted, first_line

if TYPE_CHECKING:
    from causal_openlock.analysis.report.writing import Report
    from causal_openlock.comparison.results import Results
    from causal_openlock.contract.learner import Learner
    from causal_openlock.envs.playable import Picture, PlayableRoom
    from causal_openlock.experiment.experiment import Experiment, LearnerSpec
    from causal_openlock.render.film import Shot
    from causal_openlock.render.watch import WatchedTrial
    from causal_openlock.schemas.schema import Schema
    from causal_openlock.world.room import Room

MOST_SOLUTIONS = 12
LARGEST = 600_000
"""Characters of a strip of pictures after which no more pictures are added to it."""

_CARD = "display:inline-block;background:#fff;color:#000;padding:0.6em;max-width:100%"
_ROW = "display:flex;flex-wrap:wrap;gap:0.5em;align-items:flex-start"
_LEFT = "text-align:left;vertical-align:top"


def schema_html(schema: Schema) -> str:
    """A schema: its graph, and the solutions that follow from it."""
    solutions = schema.solutions
    lines = [escape(" ".join([*levers, "door"])) for levers in solutions[:MOST_SOLUTIONS]]
    if len(solutions) > MOST_SOLUTIONS:
        lines.append(f"and {len(solutions) - MOST_SOLUTIONS} more")
    listed = f"{counted(len(solutions), 'solution')}:<br>" + "<br>".join(lines)
    title = schema.name if schema.title == schema.name else f"{schema.name}: {schema.title}"
    return _card(title, _schema_svg(schema), f"<div>{listed}</div>")


def room_html(room: Room) -> str:
    """A room at the start of an attempt, and the position of each lever."""
    from causal_openlock.render.scene import Look
    from causal_openlock.render.svg import room_svg

    title = f"{room.schema.name} in {room.layout.name}"
    look = Look.of_observation(room.observation[0], room.positions)
    places = room.layout.as_mapping(room.schema).items()
    listed = ", ".join(f"{lever} {place}" for lever, place in places)
    return _card(title, _inline(room_svg(look, title=title)), f"<div>{escape(listed)}</div>")


def picture_html(shown: Picture, title: str = "") -> str:
    """A room and its console; of :class:`Seen`, also the action and its result."""
    from causal_openlock.render.scene import Look
    from causal_openlock.render.svg import room_svg

    look = Look.of_observation(shown.observation, len(shown.observation) // 2 - 1)
    title = title or getattr(shown, "title", "A room")
    return _card(title, _inline(room_svg(look, shown.panel, title)))


def playable_html(room: PlayableRoom) -> str:
    """A room to try out, as it is now, and how to act in it."""
    card = picture_html(room.picture, f"{room.schema.name} in {room.layout.name}")
    names = ", ".join(name.removeprefix("push ") for name in room.actions[: room.positions])
    return card.removesuffix("</div>") + f"<div>push or pull {names}; or push door</div></div>"


def opened_html(opened: Any) -> str:
    """The link of a room that is open in the browser."""
    url = escape(opened.url)
    return _card(repr(opened).strip("<>"), f'<div><a href="{url}" target="_blank">{url}</a></div>')


def watched_html(watched: WatchedTrial) -> str:
    """A trial as a strip of pictures, one after each action; of a long one the first."""
    shots = [shot for shot in watched.shots if shot.action or shot is watched.shots[0]]
    body, shown = "", 0
    while shown < len(shots) and len(body) < LARGEST:
        body += _moment(watched, shots[shown], small=True)
        shown += 1
    if more := len(shots) - shown:
        body += f"<div>and {counted(more, 'more action')}</div>"
    return _card(watched.title, f'<div style="{_ROW}">{body}</div>', _legend(watched))


def _legend(watched: WatchedTrial) -> str:
    words = "Arrows are what it believes, the darker the more probable; dashed: the true schema."
    return f"<small>{words}</small>" if watched.trace else ""


def _moment(watched: WatchedTrial, shot: Shot, small: bool = False) -> str:
    """A moment of a trial: the room, and what the learner believes."""
    from causal_openlock.belief.trace import belief_in_words
    from causal_openlock.render.svg import room_svg
    from causal_openlock.render.watch import belief_svg, in_words

    parts = [_inline(room_svg(shot.look, None if small else shot.panel, in_words(shot)))]
    words = in_words(shot)
    if (belief := watched.belief(shot)) and watched.trace:
        parts.append(_inline(belief_svg(belief, watched.trace)))
        words += f"; {belief_in_words(belief)}"
    pictures = f'<div style="{_ROW}">{"".join(parts)}</div>'
    if small:
        size = r'width="[\d.]+in" height="[\d.]+in"'
        pictures = re.sub(size, 'style="width:14em;height:auto"', pictures)
    caption = f"<figcaption>{escape(words)}</figcaption>"
    style = f"margin:0.3em;width:{15 * len(parts)}em;font-size:80%" if small else "margin:0"
    return f'<figure style="{style}">{pictures}{caption}</figure>'


def experiment_html(experiment: Experiment) -> str:
    """An experiment: who plays what, and how much work that is."""
    heads = ["name", "learner", "protocol", "reward", "subjects", "changed parameters"]
    rows = [
        [
            *map(escape, (entry.name, entry.learner, entry.protocol.name, entry.reward.name)),
            str(entry.subjects),
            escape(", ".join(f"{name} {value}" for name, value in _changed(entry).items())),
        ]
        for entry in experiment.learners
    ]
    names = ", ".join(condition.name for condition in experiment.conditions)
    cells = counted(len(experiment.cells()), "cell")
    summary = f"conditions {names}; seed {experiment.seed}; {cells}"
    title = experiment.title or experiment.name
    return _card(title, _table(heads, rows), f"<div>{escape(summary)}</div>")


def _changed(entry: LearnerSpec) -> dict[str, Any]:
    """The hyper-parameters that differ from their defaults."""
    from causal_openlock.contract.registry import changed_parameters

    if entry.recorded is not None:  # showing results runs no code that they name
        return entry.parameters
    return changed_parameters(entry.learner, entry.parameters)


def learner_html(learner: Learner) -> str:
    """A learner: what it is, and its hyper-parameters; those that differ from defaults are bold."""
    from causal_openlock.contract.one_subject import PerSubjectAdapter
    from causal_openlock.contract.registry import parameter_table

    kind = learner.single if isinstance(learner, PerSubjectAdapter) else type(learner)
    parameters = learner.parameters
    rows = []
    for row in parameter_table(type(parameters)):
        value = getattr(parameters, row.name)
        shown = escape(str(value))
        shown = shown if value == row.default else f"<b>{shown}</b>"
        rows.append([escape(row.name), shown, escape(row.meaning)])
    table = _table(["parameter", "value", "meaning"], rows) if rows else ""
    return _card(kind.__name__, f"<div>{escape(first_line(kind.__doc__))}</div>", table)


def results_html(results: Results) -> str:
    """Results: the table of each protocol, and below it what a reader should know."""
    from causal_openlock.analysis.results.by_condition import in_cell
    from causal_openlock.analysis.table import number

    def small(texts: Sequence[str]) -> str:
        first, *rest = map(escape, texts or [""])
        return "".join([first, *(f"<br><small>{text}</small>" for text in rest)])

    parts = []
    for table in results.by_condition:
        heads = ["attempts", *(f"{name}, {measured}" for name, measured in table.columns)]
        rows = [
            [f"<i>{escape(name)}</i>", *("" if one is None else number(one) for one in row)]
            for name, row in table.beside.items()
        ]
        rows += [
            [f"<b>{escape(learner)}</b>", *(small(in_cell(row)) for row in cells)]
            for learner, cells in table.rows.items()
        ]
        parts.append(f"<div>protocol {escape(table.protocol)}</div>{_table(heads, rows)}")
    known = escape(" ".join(results.warnings))
    about = (
        "Mean attempts to find every solution, in small type their 95% interval if subjects differ."
    )
    return _card(results.experiment.title, *parts, f"<div><small>{about} {known}</small></div>")


def report_html(report: Report) -> str:
    """The page of a report, in a frame."""
    page = escape(report.path.read_text(encoding="utf-8"))
    look = "width:100%;height:40em;border:1px solid #ccc;background:#fff"
    return f'<iframe style="{look}" srcdoc="{page}"></iframe><div>{escape(str(report.path))}</div>'


SHOWN_AS = {
    ("causal_openlock.schemas.schema", "Schema"): schema_html,
    ("causal_openlock.world.room", "Room"): room_html,
    ("causal_openlock.envs.playable", "PlayableRoom"): playable_html,
    ("causal_openlock.envs.playable", "Picture"): picture_html,
    ("causal_openlock.play.background", "OpenedRoom"): opened_html,
    ("causal_openlock.render.watch", "WatchedTrial"): watched_html,
    ("causal_openlock.experiment.experiment", "Experiment"): experiment_html,
    ("causal_openlock.contract.learner", "Learner"): learner_html,
    ("causal_openlock.comparison.results", "Results"): results_html,
    ("causal_openlock.analysis.report.writing", "Report"): report_html,
}
"""Formatter of the instances of each type and of its subclasses."""


def register_formatters() -> None:
    """Register every formatter with IPython, where it runs, by name of type: nothing is loaded."""
    from IPython.core.getipython import get_ipython

    shell: Any = get_ipython()
    if shell:
        html = shell.display_formatter.formatters["text/html"]
        for (module, name), formatter in SHOWN_AS.items():
            html.for_type_by_name(module, name, formatter)


# -- pieces of HTML -------------------------------------------------------------------------------


def _card(title: str, *parts: str) -> str:
    """A heading and what is below it, dark on white whatever the notebook's colours are."""
    return f'<div style="{_CARD}"><b>{escape(title)}</b>{"".join(parts)}</div>'


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells that are HTML already."""

    def line(tag: str, cells: Iterable[str]) -> str:
        return "<tr>" + "".join(f'<{tag} style="{_LEFT}">{c}</{tag}>' for c in cells) + "</tr>"

    head, body = line("th", map(escape, heads)), "".join(line("td", row) for row in rows)
    return f"<table><thead>{head}</thead><tbody>{body}</tbody></table>"


def _schema_svg(schema: Schema) -> str:
    import matplotlib as mpl

    from causal_openlock.render.graph import draw_schema

    text = io.StringIO()
    nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
    with mpl.rc_context():
        mpl.rcdefaults()  # whatever a notebook has set for figures of its own
        mpl.rcParams.update({"svg.fonttype": "none", "svg.hashsalt": schema.name})
        figure: Any = draw_schema(schema).figure
        figure.savefig(text, format="svg", metadata=nothing)
    return _inline(text.getvalue())


def _inline(svg: str) -> str:
    """An SVG document for inside a page."""
    # matplotlib's style sheet would hold for the whole page.
    svg, styled = re.subn(r"<style.*?</style>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    if styled:
        svg = svg.replace("<svg ", '<svg style="stroke-linejoin: round; stroke-linecap: butt" ', 1)
    return f"<div>{svg}</div>"
