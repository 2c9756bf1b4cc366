"""Ratio of a library's time through a wrapper to its time in the lane direct, at equal settings, both right."""

import pytest
from measured_rows import measured, row

from bench.derived.wrapper_share import wrapper_share
from bench.messages.task import Row

EPS = '{"eps": 1e-8}'
SAME = {("daqp", "qpsolvers"): (1, 8.0, 2.0, 4.0)}
"""Problems, time, time in the lane direct and their ratio, by wrapper."""


def timed_row(us: float, **known: object) -> Row:
    """A row at a setting that both lanes have."""
    return row(**{"settings": EPS, "setting": EPS, "solve_us_p50": us, **known})


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        pytest.param(
            [
                one
                for problem, direct, through in (("p1", 2.0, 20.0), ("p2", 4.0, 20.0), ("p3", 1.0, 30.0))
                for one in (timed_row(direct, problem=problem), timed_row(through, problem=problem, lane="qpsolvers"))
            ],
            {("daqp", "qpsolvers"): (3, 20.0, 2.0, 10.0)},
            id="the median of the ratios over the problems",
        ),
        pytest.param(
            [timed_row(1.0, update_us=1.0), timed_row(2.0, update_us=4.0, lane="cvxpy")],
            {("daqp", "cvxpy"): (1, 6.0, 2.0, 3.0)},
            id="update and solve count in both lanes",
        ),
        pytest.param(
            [
                timed_row(2.0),
                timed_row(8.0, lane="qpsolvers", settings='{"raise_error": false, "eps": 1e-8}'),
                timed_row(9.0, lane="cvxpy", settings='{"eps": 1e-5}'),
            ],
            SAME,
            id="at identical settings only, apart from those of error reporting",
        ),
        pytest.param(
            [
                row(is_default=True),
                row(lane="qpsolvers", is_default=True),
                row(lane="cvxpy", is_default=True, settings='{"raise_error": false}'),
            ],
            {},
            id="a default without a value, which each package interprets",
        ),
        pytest.param(
            [
                timed_row(2.0),
                timed_row(8.0, lane="qpsolvers"),
                timed_row(1.0, problem="p2"),
                timed_row(90.0, problem="p2", lane="qpsolvers", cost_gap=2e-3),
                timed_row(1.0, problem="p3", timed_gap=1.0),
                timed_row(70.0, problem="p3", lane="qpsolvers"),
                timed_row(50.0, problem="p4", lane="qpsolvers"),
            ],
            SAME,
            id="problems on which both are right to a thousandth",
        ),
        pytest.param(
            [timed_row(2.0, status="cached"), timed_row(8.0, lane="qpsolvers")], {}, id="a cheat is never right"
        ),
        pytest.param(
            [timed_row(2.0), timed_row(8.0, lane="qpsolvers", problem_set="orders")], {}, id="a namesake in another set"
        ),
        pytest.param(
            [
                timed_row(2.0),
                timed_row(8.0, lane="qpsolvers"),
                timed_row(0.1, start="warm"),
                timed_row(0.2, scaling="raw"),
                timed_row(99.0, scaling="raw", lane="qpsolvers"),
                row(problem="p2"),
            ],
            SAME,
            id="cold rows of the first scaling only",
        ),
        pytest.param(
            [timed_row(2.0, solver="highspy"), timed_row(8.0, solver="highs", lane="qpsolvers")],
            {("highs", "qpsolvers"): (1, 8.0, 2.0, 4.0)},
            id="the name that a library has in the lane direct",
        ),
        pytest.param([timed_row(2.0), timed_row(8.0, lane="kernel")], {}, id="our compiled lane is nobody's wrapper"),
    ],
)
def test_the_share_of_a_wrapper(
    rows: list[Row], expected: dict[tuple[str, str], tuple[int, float, float, float]]
) -> None:
    found = {
        (line.solver, line.lane): (line.problems, line.us, line.direct_us, line.ratio)
        for line in wrapper_share(measured(rows)).itertuples()
    }
    assert found == expected
