"""The short table: its cells and columns, and the lanes on a terminal; the committed run has order and times."""

import pytest
from measured_rows import ladder, measured, row, steps

from bench.derived.misses import misses
from bench.derived.ranking import PACE, Line, Result, ranking, short_table
from bench.messages.task import Row
from bench.messages.verdict import Tier

NAN = float("nan")


def cells(rows: list[Row], terminal: bool = False) -> dict[str, list[str]]:
    """The cells of each line for 1e-3, 1e-6, 1e-9, 1e-12, then the stage and the default."""
    shown = short_table(ranking(measured(rows)), "", terminal).rows
    return {str(line[0]): [str(cell) for cell in line[2:]] for line in shown}


def test_a_tier_that_is_not_reached_has_no_time_but_the_number_of_problems_that_are_right() -> None:
    rows = ladder({"p1": [1e-12, 1e-12], "p2": [1e-12, 1e-12], "p3": [NAN, 1e-5]})
    assert cells(rows)["daqp"] == ["1", "✗2/3 p3", "✗2/3 p3", "✗2/3 p3", "–"]
    assert cells(rows, terminal=True)["daqp"] == ["1", "✗2/3", "✗2/3", "✗2/3", "–"]


def test_a_tier_that_applies_to_no_problem_has_no_column_and_one_without_a_result_has_a_dash() -> None:
    noisy = ladder({"p1": [1e-14]}, noise_um=0.01, stage_excess=0.0)
    assert short_table(ranking(measured(ladder({"p1": [1e-14]}))), "").headings[2:] == [
        "to 1e-3",
        "to 1e-6",
        "to 1e-9",
        "to 1e-12",
        "default gap",
    ]
    other = ladder({"p1": [1e-14], "p2": [1e-14]}, solver="osqp", noise_um=0.0)
    assert short_table(ranking(measured([*noisy, *other])), "").headings[-2] == "stage"
    assert cells([*noisy, *other])["osqp"][-2] == "–"


def test_a_terminal_shows_the_lanes_with_a_ladder_or_without_such_lanes_all() -> None:
    rows = [
        row(),
        row(solver="quadprog", lane="qpsolvers"),
        row(solver="clarabel", lane="cvxpy"),
        row(solver="box_active_set", lane="kernel"),
    ]
    assert set(cells(rows)) == {"daqp", "quadprog", "clarabel", "box_active_set†"}
    assert set(cells(rows, terminal=True)) == {"daqp", "box_active_set†"}
    assert set(cells(rows[1:3], terminal=True)) == {"quadprog", "clarabel"}


def test_only_cold_rows_of_the_first_scaling_are_in_the_table() -> None:
    rows = [
        *ladder({"p1": [1e-14]}, solve_us_p50=5.0),
        row(start="warm", solve_us_p50=1.0),
        row(scaling="raw", solve_us_p50=2.0),
        row(solver="raw_alone", scaling="raw"),
        row(solver="warm_alone", start="warm"),
    ]
    (line,) = ranking(measured(rows))
    assert (line.name, line.results[Tier.HIGH].us) == ("daqp", 5.0)


def test_the_papers_method_has_no_pace_if_it_supports_none_of_the_problems() -> None:
    refused = [{**one, "status": "unsupported", "cost_gap": NAN} for one in steps({"p1": [0.5, 1e-4]})]
    assert PACE not in [line.name for line in ranking(measured([row(), *refused]))]


@pytest.mark.parametrize(
    ("us", "wide", "narrow"),
    [
        (0.934, "0.934", "0.93"),
        (6.57, "6.57", "6.57"),
        (1900.0, "1900", "1900"),
        (1.9e6, "1.9e6", "1.9 s"),
        (25_000.0, "25000", "25 ms"),
    ],
)
def test_a_time_is_in_microseconds_and_short_on_a_terminal(us: float, wide: str, narrow: str) -> None:
    line = Line("daqp", "daqp", "direct", {Tier.HIGH: Result(us, 3, 3, "s0")}, NAN)
    assert short_table([line], "").rows[0][2] == wide
    assert short_table([line], "", terminal=True).rows[0][2] == narrow


def test_a_miss_is_listed_with_its_problem_and_figures_the_nearest_lanes_first_and_hopeless_ones_not() -> None:
    rows = [
        *ladder({"p1": [1e-12], "p2": [1e-12], "p3": [1e-12]}, solver="right"),
        *ladder({"p1": [1e-12], "p2": [1e-5], "p3": [1e-4]}, solver="a"),
        *ladder({"p1": [1e-12], "p2": [1e-5], "p3": [1e-12]}, solver="near"),
        *ladder({"p1": [1.0], "p2": [1.0], "p3": [1.0]}, solver="hopeless"),
    ]
    table = misses(measured(rows))
    assert table[["solver", "problem"]].values.tolist() == [["near", "p2"], ["a", "p2"], ["a", "p3"]]
    assert table.iloc[0].cost_gap == 1e-5
