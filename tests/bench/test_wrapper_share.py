"""The wrapper's share: the time of a library through a package over that of its own object, at identical settings, both
right."""

from measured_rows import measured, row

from bench.derived.wrapper_share import in_lane_direct, wrapper_share
from bench.messages.task import Row

EPS = '{"eps": 1e-8}'


def asked(us: float, **known: object) -> Row:
    """A row at the setting that both lanes have."""
    return row(**{"settings": EPS, "setting": EPS, "solve_us_p50": us, **known})


def shares(rows: list[Row]) -> dict[tuple[str, str], tuple[int, float, float, float]]:
    """Problems, time, time in the lane direct and their ratio by wrapper."""
    return {
        (line.solver, line.lane): (line.problems, line.us, line.direct_us, line.ratio)
        for line in wrapper_share(measured(rows)).itertuples()
    }


def test_the_share_is_the_median_of_the_ratios_over_the_problems() -> None:
    rows = [
        one
        for problem, direct, through in (("p1", 2.0, 20.0), ("p2", 4.0, 20.0), ("p3", 1.0, 30.0))
        for one in (asked(direct, problem=problem), asked(through, problem=problem, lane="qpsolvers"))
    ]
    assert shares(rows) == {("daqp", "qpsolvers"): (3, 20.0, 2.0, 10.0)}


def test_update_and_solve_count_in_both_lanes() -> None:
    assert shares([asked(1.0, update_us=1.0), asked(2.0, update_us=4.0, lane="cvxpy")]) == {
        ("daqp", "cvxpy"): (1, 6.0, 2.0, 3.0)
    }


def test_lanes_are_compared_at_identical_settings_only_whatever_says_how_a_failure_is_said() -> None:
    rows = [
        asked(2.0),
        asked(8.0, lane="qpsolvers", settings='{"raise_error": false, "eps": 1e-8}'),
        asked(9.0, lane="cvxpy", settings='{"eps": 1e-5}'),
    ]
    assert shares(rows) == {("daqp", "qpsolvers"): (1, 8.0, 2.0, 4.0)}


def test_a_default_that_says_nothing_is_left_out_since_each_package_makes_of_it_what_it_will() -> None:
    assert (
        shares(
            [
                row(is_default=True),
                row(lane="qpsolvers", is_default=True),
                row(lane="cvxpy", is_default=True, settings='{"raise_error": false}'),
            ]
        )
        == {}
    )


def test_problems_are_compared_on_which_both_are_right_to_a_thousandth() -> None:
    rows = [
        asked(2.0),
        asked(8.0, lane="qpsolvers"),
        asked(1.0, problem="p2"),
        asked(90.0, problem="p2", lane="qpsolvers", cost_gap=2e-3),
        asked(1.0, problem="p3", timed_gap=1.0),
        asked(70.0, problem="p3", lane="qpsolvers"),
        asked(50.0, problem="p4", lane="qpsolvers"),
    ]
    assert shares(rows) == {("daqp", "qpsolvers"): (1, 8.0, 2.0, 4.0)}
    assert shares([asked(2.0, status="cached"), asked(8.0, lane="qpsolvers")]) == {}


def test_a_problem_of_the_same_name_in_another_set_is_another_problem() -> None:
    assert shares([asked(2.0), asked(8.0, lane="qpsolvers", problem_set="orders")]) == {}


def test_only_cold_rows_of_the_first_scaling_count() -> None:
    rows = [
        asked(2.0),
        asked(8.0, lane="qpsolvers"),
        asked(0.1, start="warm"),
        asked(0.2, scaling="raw"),
        asked(99.0, scaling="raw", lane="qpsolvers"),
    ]
    assert shares([*rows, row(problem="p2")]) == {("daqp", "qpsolvers"): (1, 8.0, 2.0, 4.0)}


def test_a_library_is_found_under_the_name_that_it_has_in_the_lane_direct() -> None:
    assert [in_lane_direct(name) for name in ("highs", "proxqp", "osqp")] == ["highspy", "proxsuite", "osqp"]
    rows = [asked(2.0, solver="highspy"), asked(8.0, solver="highs", lane="qpsolvers")]
    assert shares(rows) == {("highs", "qpsolvers"): (1, 8.0, 2.0, 4.0)}


def test_our_compiled_lane_is_nobodys_wrapper() -> None:
    assert shares([asked(2.0), asked(8.0, lane="kernel")]) == {}
