"""Beliefs of learners that hold beliefs, in one of their trials.

It is the first trial of the first subject in the first condition; see
:mod:`~causal_openlock.analysis.results.traces`.
"""

from __future__ import annotations

from collections.abc import Mapping

import pandas as pd

from causal_openlock.analysis.plots.belief import THRESHOLD, plot_trace
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.traces import believers, replayed
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Section, Topic, drawn, sentences
from causal_openlock.belief.trace import Trace
from causal_openlock.errors import OpenLockError
from causal_openlock.wording import counted, file_names, joined

MOST = 3  #: learners whose belief is shown: those that are listed first
LONGEST = 60  #: trials of more attempts than this are not traced: it takes long, and few are shown


def section(material: Material) -> Section | None:
    """A trace of each of the first learners that hold beliefs; None if there are none."""
    traces: dict[str, Trace] = {}
    changed: list[str] = []
    more: list[str] = []
    for name, spec in believers(material).items():
        if len(traces) >= MOST or spec.protocol.attempt_limit > LONGEST:
            more.append(name)
            continue
        try:
            traces[name] = replayed(material, learner=name)
        except OpenLockError:
            changed.append(name)  # it, or its parameters, are not those of the learner as it is now
    if not traces:
        return None
    text = (
        " ".join(_finding(name, trace) for name, trace in traces.items()),
        "Shown is the first trial of the first subject in the first condition, played once more "
        "with the recorded actions. causal-openlock trace shows any other trial.",
        f"Other learners that hold beliefs, not shown here: {joined(more)}." if more else "",
        "Not shown, as their code or parameters have changed since: "
        f"{', '.join(changed)}." if changed else "",
    )  # fmt: skip
    # The first screen has what surprises: a learner that knows the structure and does not use it.
    answer = sentences(
        *(
            f"In the trial shown under Beliefs, {_finding(name, trace)}"
            for name, trace in traces.items()
            if trace.known_from and trace.found < len(trace.truth.solutions)
        )
    )
    caption = (
        "What one subject did, attempt by attempt; the bits missing to certainty about the room; "
        "the information expected of each action by itself and the information that it gave, which "
        "agree on average over rooms as probable as the subject believes; and the marginal "
        f"probability of each arrow that was ever more probable than {THRESHOLD:.0%}, true arrows "
        "above the line. Below, the structure that is most probable in the end next to the true "
        "one, levers called by their positions. What a learner forgets after an attempt counts "
        "against its last action."
    )
    plots = []
    for name, part in file_names(traces).items():
        call = f"results.plot.beliefs({traces[name].subject}, learner={name!r})"
        title = f"What {name} believed"
        plots.append(drawn(f"belief_{part}", plot_trace, traces[name], title, caption, call))
    paragraphs = tuple(filter(None, text))
    return Section("beliefs", "Beliefs", paragraphs, (_information(traces),), tuple(plots), answer)


def _finding(name: str, trace: Trace) -> str:
    """What a learner believed and found, as a sentence."""
    solutions, found = len(trace.truth.solutions), trace.found
    believed = (
        f"holds the true structure most probable from the end of attempt {trace.known_from} on"
        if trace.known_from
        else "does not hold the true structure most probable in the end"
    )
    share = "all" if found == solutions else f"only {found} of" if found else "none of"
    attempts = counted(trace.actions[-1].attempt, "attempt")
    return f"{name} {believed} and finds {share} {solutions} solutions in {attempts}."


def _information(traces: Mapping[str, Trace]) -> Table:
    """Bits that the actions of each attempt gave on average."""
    actions = pd.concat([trace.table().assign(learner=name) for name, trace in traces.items()])
    # Entropies of different hypotheses cannot be compared.
    actions["gain_obtained"] = actions["gain_obtained"].where(actions["renewed"] == "")
    frame = actions.groupby(["learner", "attempt"], sort=False).agg(
        actions=("number", "size"),
        predicted=("gain_predicted", "mean"),
        obtained=("gain_obtained", "mean"),
    )
    caption = (
        "Bits that an action was expected to give and that it gave, on average over the actions of "
        "an attempt: by how much less is missing to certainty after it. Negative where an answer "
        "left the subject less certain. Actions after which hypotheses were drawn again do not "
        "count as having given anything."
    )
    title = "Information gained per action"
    return Table("belief_information", title, frame.reset_index(), {"obtained": "+.2f"}, caption)


TOPIC = Topic("belief_traces", 140, section)
