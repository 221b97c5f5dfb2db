"""What the page on growth says was measured is what is stored, and its arithmetic is right."""

from __future__ import annotations

import csv

import pytest

from support.places import ROOT

CORES = (4, 64, 1000)


@pytest.fixture(scope="module")
def page() -> str:
    return (ROOT / "docs" / "scale.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def measured() -> dict[tuple[str, str, int], float]:
    with (ROOT / "docs" / "figures" / "scale.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {(row["grows"], row["of"], int(row["size"])): float(row["value"]) for row in rows}


def rounded(value: float) -> str:
    """Two digits that count, in words from a million on."""
    scale, word = (1e6, " million") if value >= 1e6 else (1.0, "")
    return f"{float(f'{value / scale:.2g}'):,.10g}{word}"


@pytest.mark.parametrize("learner", ["random", "tabular_q", "bayes", "ddqn"])
def test_subjects_in_an_hour_follow_from_the_largest_cell(
    learner: str, page: str, measured: dict[tuple[str, str, int], float]
) -> None:
    size = max(size for grows, of, size in measured if (grows, of) == ("subjects", learner))
    seconds = measured["subjects", learner, size]
    each = seconds / size
    assert f"| {learner} | {size:,} | {rounded(seconds)} | {rounded(1000 * each)} |" in page
    hour = [rounded(3600 / each * cores) for cores in CORES]
    assert f"| {learner} | {' | '.join(hour)} |" in page


def test_workers_cost_what_the_page_says(
    page: str, measured: dict[tuple[str, str, int], float]
) -> None:
    for kind in ("processes", "Dask"):
        for many in (1, 2):
            seconds = measured["workers", f"{kind}, processor", many]
            assert f"| {kind} | {many} | {seconds:.0f} |" in page
        assert f"| {1000 * measured['workers', f'{kind}, own time a cell', 1]:.2g} ms |" in page
    bound = 60 / measured["workers", "Dask, own time a cell", 1]
    assert f"Dask that is {rounded(bound)} workers" in page


def test_the_record_costs_what_the_page_says(
    page: str, measured: dict[tuple[str, str, int], float]
) -> None:
    of = {name: measured["attempts", name, 10**6] for name in ("written", "read", "summarised")}
    size = measured["attempts", "on disk", 10**6] / 1e6
    times = "{written:.2f} s, {read:.2f} s and {summarised:.2f} s".format(**of)
    assert f"A million attempts take {times}, and {size:.1f} MB of the disk" in page


def test_growth_is_what_the_page_says(
    page: str, measured: dict[tuple[str, str, int], float]
) -> None:
    def times(grows: str, of: str, small: int, large: int) -> str:
        return f"{measured[grows, of, large] / measured[grows, of, small]:.1f}"

    said = " ".join(page.split())
    hundred = [times("subjects", of, 1, 100) for of in ("random", "tabular_q", "bayes")]
    assert f"takes {hundred[0]} times as long as one of a single subject with `random`" in said
    assert f"{hundred[1]} times with `tabular_q` and {float(hundred[2]):.0f} times" in said
    assert f"ten take {times('subjects', 'ddqn', 1, 10)} times as long as one" in said
    levers = max(times("levers", of, 3, 12) for of in ("random", "tabular_q", "ddqn"))
    assert f"up to {levers} times as much in a room of twelve levers" in said
    kinds = ("written", "read", "summarised")
    few = [times("attempts", of, 10**4, 10**5) for of in kinds]
    many = [times("attempts", of, 10**5, 10**6) for of in kinds]
    assert (
        f"writing takes {few[0]} times as long, reading {few[1]} and summarising {few[2]}" in said
    )
    assert f"to a million {many[0]}, {many[1]} and {many[2]} times" in said
