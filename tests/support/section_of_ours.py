"""A section of the report as somebody might add it: see test_sections.py."""

from __future__ import annotations

from matplotlib.figure import Figure

from causal_openlock.analysis.decisions import Decided
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section, SectionPlot
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic


def section(material: Material, _: Decided) -> Section | None:
    """How much each learner was paid, on average; None for an empty record."""
    if not material.record.num_rows:
        return None
    frame = material.record.select(["learner", "reward"]).to_pandas()
    paid = frame.groupby("learner", observed=True)["reward"].mean().reset_index()
    paid["learner"] = paid["learner"].astype(str)
    paid = paid.sort_values("learner", ignore_index=True)
    paid = paid.assign(share=0.125, better=True, per_1000=1234567.0, nothing=float("nan"))
    figure = Figure(figsize=(3, 2))
    figure.subplots().plot([0, 1], [0, 1])
    table = Table(
        "paid",
        "Pay & <reward>",
        paid,
        {"reward": "+.3f", "share": ".1%", "per_1000": ",.0f", "nothing": ".2f"},
        "Means over attempts ± nothing, 100% of them.",
    )
    text = (f"{len(paid)} learners & one < two.",)
    plot = SectionPlot("paid", "Pay", "A line.", figure)
    return Section("paid", "What was paid", text, (table,), (plot,))


TOPIC = Topic("paid", 1, section, columns=("reward",))
