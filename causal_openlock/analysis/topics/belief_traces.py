"""Beliefs of learners that hold beliefs, in one of their trials.

It is the first trial of the first subject in the first condition; see
:mod:`~causal_openlock.analysis.results.traces`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.information import information_per_action, mean_information
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.traces import believers, replayed
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import Topic
from causal_openlock.errors import OpenLockError
from causal_openlock.wording import file_names

if TYPE_CHECKING:
    from causal_openlock.belief.trace import Trace

MOST = 3
"""Learners whose belief is shown: those that are listed first."""

LONGEST = 60
"""Trials of more attempts than this are not traced: it takes long, and few are shown."""


_PROSE = Prose(__name__)


def section(material: Material) -> Section | None:
    """A trace of each of the first learners that hold beliefs; None if there are none."""
    from causal_openlock.analysis.plots.belief import THRESHOLD, Part, plot_trace

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
    findings = [
        {
            "learner": name,
            "known_from": trace.known_from,
            "attempts": trace.actions[-1].attempt,
            "found": trace.found,
            "solutions": len(trace.truth.solutions),
        }
        for name, trace in traces.items()
    ]
    information = information_per_action(list(traces.values()))
    means = mean_information(information, ["learner", "attempt"]).drop(columns="subjects")
    formats = {"predicted": ".2f", "obtained": "+.2f"}
    return _PROSE.section(
        "beliefs",
        [_PROSE.table("belief_information", means, formats)],
        [
            _PROSE.plot(
                "belief", plot_trace, trace, {}, f"belief_{part}",
                f"results.plot.beliefs({trace.subject}, learner={name!r})",
                trace=trace, part=Part.of(trace), threshold=THRESHOLD,
            )
            for (name, trace), part in zip(
                traces.items(), file_names(traces).values(), strict=True
            )
        ],
        answer=_PROSE.sentence("answer", findings=findings),
        findings=findings,
        more=more,
        changed=changed,
    )  # fmt: skip


TOPIC = Topic("belief_traces", 140, section)
