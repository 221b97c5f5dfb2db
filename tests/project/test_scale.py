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
    said = " ".join(page.split())
    for many, words, digits, place in (
        (10**6, "A million attempts", 2, 1),
        (10**7, "ten million", 1, 0),
    ):
        of = [measured["attempts", name, many] for name in ("written", "read", "summarised")]
        first, second, third = (f"{seconds:.{digits}f} s" for seconds in of)
        size = f"{measured['attempts', 'on disk', many] / 1e6:.{place}f} MB"
        assert f"{words} take {first}, {second} and {third}, and {size}" in said


def test_growth_is_what_the_page_says(
    page: str, measured: dict[tuple[str, str, int], float]
) -> None:
    def times(grows: str, of: str, small: int, large: int) -> str:
        return f"{measured[grows, of, large] / measured[grows, of, small]:.1f}"

    said = " ".join(page.split())
    learners = ("random", "tabular_q", "ddqn", "bayes")
    hundred = [times("subjects", of, 1, 100) for of in learners]
    assert f"takes {hundred[0]} times as long as one of a single subject with `random`" in said
    trained, belief = (f"{float(one):.0f}" for one in hundred[2:])
    assert (
        f"{hundred[1]} times with `tabular_q`, {trained} times with `ddqn` and {belief} times"
        in said
    )
    for of in ("bayes", "ddqn"):
        each = [1000 * measured["subjects", of, many] / many for many in (1, 10, 100, 1000)]
        assert "{:.0f}, {:.0f}, {:.0f} and {:.0f} ms with `{}`".format(*each, of) in said
    levers = max(times("levers", of, 3, 12) for of in ("random", "tabular_q", "ddqn"))
    assert f"up to {levers} times as much in a room of twelve levers" in said
    kinds = ("written", "read", "summarised")
    few = [times("attempts", of, 10**5, 10**6) for of in kinds]
    many = [times("attempts", of, 10**6, 10**7) for of in kinds]
    assert (
        f"writing takes {few[0]} times as long, reading {few[1]} and summarising {few[2]}" in said
    )
    assert f"to ten million {many[0]}, {many[1]} and {many[2]} times" in said
