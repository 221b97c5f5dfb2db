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
    assert f"a million attempts take {times}, and {size:.1f} MB of the disk" in page
